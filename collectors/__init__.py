"""Collectors: everything that produces episodes."""

import svfl_data  # noqa: F401 - says which extra installs a library that is not there
