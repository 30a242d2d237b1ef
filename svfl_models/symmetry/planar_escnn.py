"""The only module that imports escnn, and that works around its missing dependency for 3-D groups.

escnn 1.0.11 imports ``lie_learn.representations.SO3.wigner_d`` unconditionally, although only its SO(3) and O(3)
groups call it. lie-learn 0.0.2, the newest release, is built for numpy 1 and cannot be used beside the numpy 2 that the
rest of this toolkit needs. Where lie-learn cannot be imported, stand-in modules take its place: planar groups work, and
a 3-D group that asks for Wigner matrices gets a `NotImplementedError` that says why. Where lie-learn can be imported,
nothing is replaced.

escnn itself can do without the other packages that it declares (py3nj, pymanopt, autograd). Its warning about py3nj,
which concerns SO(3) only, is silenced. The tables that it computes are stored as `escnn_cache` describes.
"""

import importlib
import importlib.util
import sys
import warnings
from types import ModuleType
from typing import NoReturn

from svfl_models.symmetry.escnn_cache import kept_by_the_user

MODULES = (
    "lie_learn",
    "lie_learn.representations",
    "lie_learn.representations.SO3",
    "lie_learn.representations.SO3.wigner_d",
)


def stand_in_for_lie_learn() -> list[str]:
    """Replace those lie-learn modules that escnn imports and that cannot be imported by stand-ins.

    Returns:
        Names of the modules that were replaced; the list is empty where the real package works.
    """
    replaced = []
    for name in MODULES:
        try:
            importlib.import_module(name)
        except ImportError:
            module = ModuleType(name, "Stand-in of svfl for planar groups; see svfl_models.symmetry.planar_escnn.")
            module.wigner_D_matrix = _no_wigner_matrices  # type: ignore[attr-defined]
            module.__path__ = []
            sys.modules[name] = module
            replaced.append(name)
    return replaced


def _no_wigner_matrices(*_: object, **__: object) -> NoReturn:
    raise NotImplementedError(
        "3-D rotation groups need lie-learn, which this environment lacks; planar groups (C_N, D_N) work without it"
    )


if importlib.util.find_spec("escnn") is None:
    raise ImportError("escnn is not installed; run: pip install --no-deps escnn==1.0.11")
stand_in_for_lie_learn()
with warnings.catch_warnings(), kept_by_the_user():
    warnings.filterwarnings("ignore", message="`py3nj` package not found", category=UserWarning)
    from escnn.group import Representation
    from escnn.gspaces import GSpace2D, flipRot2dOnR2, rot2dOnR2
    from escnn.nn import FieldType, R2Conv

__all__ = [
    "FieldType",
    "GSpace2D",
    "R2Conv",
    "Representation",
    "flipRot2dOnR2",
    "rot2dOnR2",
    "stand_in_for_lie_learn",
]
