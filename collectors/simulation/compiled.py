"""Decorator that compiles functions to machine code, kept in the user's cache folder.

Without a cache folder, every process compiles the functions again. By default Numba keeps machine code beside the
source file, and fails on import where neither that folder nor the user's home can be written.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

from svfl_data.system.cache_folder import cache_folder

Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Decorate a function so that Numba compiles it at its first call.

    Floats are added and multiplied in the order of the source, without fused operations, so that every processor
    computes the same.
    """
    folder = cache_folder("numba")
    settings: Any = numba.config  # typed as Any because its attributes are set from environment variables
    usual = settings.CACHE_DIR
    settings.CACHE_DIR = str(folder or "")  # Numba reads it when a function is decorated
    try:
        return cast(Function, numba.njit(cache=folder is not None)(function))
    finally:
        settings.CACHE_DIR = usual
