"""One-line errors that state which extra of this package installs a missing library.

Importing `svfl_data` adds an import finder after Python's own finders. Python asks this finder only for modules that no
other finder has found. The finder raises its error only if a module of our packages does the import, so that other
libraries still see an ordinary failed import.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import FrameType

from svfl_data.errors import SvflError

EXTRAS = {
    "PIL": ("real", "view"),
    "cv2": ("sim", "real"),
    "fpdf": ("real",),
    "gymnasium": ("sim",),
    "hid": ("teleop",),
    "joblib": ("models",),
    "lightning": ("models",),
    "matplotlib": ("models",),
    "mlflow": ("mlflow",),
    "numba": ("sim",),
    "onnx": ("onnx",),
    "onnxruntime": ("onnx",),
    "onnxscript": ("onnx",),
    "pupil_apriltags": ("real",),
    "pybullet": ("sim",),
    "pybullet_data": ("sim",),
    "pygame": ("teleop",),
    "ray": ("ray",),
    "rerun": ("view",),
    "scipy": ("models", "real"),
    "tensorboard": ("tensorboard",),
    "torch": ("models",),
    "wandb": ("wandb",),
    "yaml": ("models",),
}
"""Extras of pyproject.toml that install each module, by the name of the module; a test compares both."""
LAST_PYTHON = {"sim": ("pybullet", (3, 11))}
"""Extras that end with a Python: the library that has no wheels for later ones, and the last version that it has."""
OURS = ("svfl_data", "svfl_models", "collectors")


class MissingPackageError(SvflError, ModuleNotFoundError):
    """A library that belongs to an extra is not installed."""


def needs(module: str) -> str:
    """Return which library is missing and how to install it, as the end of a message that begins with who needs it.

    Args:
        module: Name of the module as it is imported. A submodule stands for its library.

    Returns:
        The words, such as ``needs torch, which is not installed; run: pip install 'svfl[models]'``. Where none of the
        library's extras can be had for this Python they say which one can be used instead.
    """
    library, python = module.partition(".")[0], sys.version_info[:2]
    words = f"needs {library}, which is not installed"
    extras = EXTRAS.get(library, ())
    ended = {extra: LAST_PYTHON[extra] for extra in extras if extra in LAST_PYTHON and python > LAST_PYTHON[extra][1]}
    if ways := [f"pip install 'svfl[{extra}]'" for extra in extras if extra not in ended]:
        return f"{words}; run: {' or '.join(ways)}"
    for extra, (ending, last) in ended.items():
        return (
            f"{words}; its extra needs {ending}, which has no wheels for Python {_dotted(python)}: with Python "
            f"{_dotted(last)} run: pip install 'svfl[{extra}]'"
        )
    return words


class Explaining(MetaPathFinder):
    """Import finder that raises `MissingPackageError` if one of our modules imports a library that is not installed."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> None:
        """Find nothing, and raise an error if one of our modules imports a library that an extra installs.

        Raises:
            MissingPackageError: If one of our modules asks for such a library. The message says which module needs the
                library and how to install it.
        """
        if fullname in EXTRAS and (asking := _asking()).partition(".")[0] in OURS:
            raise MissingPackageError(f"{asking} {needs(fullname)}", name=fullname)


def explain_missing() -> None:
    """Add the finder `Explaining` after all other import finders, unless it is there already."""
    if not any(isinstance(finder, Explaining) for finder in sys.meta_path):
        sys.meta_path.append(Explaining())


def _dotted(version: tuple[int, ...]) -> str:
    return ".".join(map(str, version))


def _asking() -> str:
    """Return the name of the module whose import statement is being executed."""
    frame: FrameType | None = sys._getframe(2)
    while frame and frame.f_globals.get("__name__", "").startswith("importlib"):
        frame = frame.f_back
    return str(frame.f_globals.get("__name__", "")) if frame else ""
