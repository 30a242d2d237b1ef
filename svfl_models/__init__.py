"""Networks that are symmetric under planar rotations and reflections, and the programs that train them."""
