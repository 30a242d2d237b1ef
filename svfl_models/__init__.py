"""Networks that are equivariant to planar rotations and reflections, and the programs that train them."""
