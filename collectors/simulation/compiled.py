"""Functions as machine code, kept in the user's cache or, if there is none, compiled again by every process.

By itself Numba keeps them beside the source file, and fails on import where neither that folder nor the user's home can
be written.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from svfl_data.system.cache_folder import cache_folder

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Decorator: compile a function at its first call.

    Floats are added and multiplied in the order of the source, without fused operations, so that every processor
    computes the same.
    """
    folder = cache_folder("numba")
    settings: Any = numba.config  # whose attributes come from the environment
    usual = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder or "")  # read when a function is decorated
    try:
        return cast(Function, numba.njit(cache=folder is not None)(function))
    finally:
        settings.CACHE_DIR = usual
