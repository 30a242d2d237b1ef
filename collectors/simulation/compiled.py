"""Functions as machine code, kept in the user's cache or, if there is none, compiled again by every process.

By itself Numba keeps them beside the source file, and fails on import where neither that folder nor the user's home can
be written.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numba

from svfl_data.cache_folder import cache_folder

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Decorator: compile a function at its first call.

    Floats are added and multiplied in the order of the source, without fused operations, so that every processor
    computes the same.
    """
    settings: Any = numba.config  # Numba declares no types for them
    folder, usual = cache_folder("numba"), settings.CACHE_DIR
    settings.CACHE_DIR = str(folder or "")  # read when a function is decorated
    try:
        decorated: Any = numba.njit(cache=folder is not None)(function)
        return decorated  # it is called as the function is
    finally:
        settings.CACHE_DIR = usual
