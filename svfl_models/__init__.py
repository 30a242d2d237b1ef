"""Networks that are equivariant to planar rotations and reflections, and the programs that train them."""

import svfl_data  # noqa: F401 - says which extra installs a library that is not there
