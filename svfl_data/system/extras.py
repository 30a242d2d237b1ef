"""Which extra of this package installs a library that is not there, said in one line.

Importing `svfl_data` adds a finder behind Python's own: it is asked only for modules that Python has not found, and
speaks up only if one of our packages imports one, so that other libraries still find out for themselves what there is.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from types import FrameType

from svfl_data.errors import SvflError

EXTRAS = {
    "PIL": ("view",),
    "cv2": ("sim", "real"),
    "gymnasium": ("sim",),
    "hid": ("teleop",),
    "joblib": ("models",),
    "lightning": ("models",),
    "matplotlib": ("models",),
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
    "torch": ("models",),
}
"""Module and the extras of pyproject.toml that install it; a test compares."""
OURS = ("svfl_data", "svfl_models", "collectors")


class MissingPackageError(SvflError, ModuleNotFoundError):
    """A library that belongs to an extra is not installed."""


def needs(module: str) -> str:
    """What is missing and how to install it, to follow the name of who needs it.

    Args:
        module: As it is imported; a submodule stands for its library.
    """
    library = module.partition(".")[0]
    ways = " or ".join(f"pip install 'svfl[{extra}]'" for extra in EXTRAS.get(library, ()))
    return f"needs {library}, which is not installed" + (f"; run: {ways}" if ways else "")


class Explaining(MetaPathFinder):
    """The finder that raises `MissingPackageError` where one of our modules imports a library that is not there."""

    def find_spec(self, fullname: str, path: Sequence[str] | None, target: object = None) -> None:
        """Find nothing, and say so if it was one of us who asked.

        Raises:
            MissingPackageError: With who needs it and how to install it.
        """
        if fullname in EXTRAS and (asking := _asking()).partition(".")[0] in OURS:
            raise MissingPackageError(f"{asking} {needs(fullname)}", name=fullname)


def explain_missing() -> None:
    """Put the finder behind all others, once."""
    if not any(isinstance(finder, Explaining) for finder in sys.meta_path):
        sys.meta_path.append(Explaining())


def _asking() -> str:
    """Name of the module whose import statement is being executed."""
    frame: FrameType | None = sys._getframe(2)
    while frame and frame.f_globals.get("__name__", "").startswith("importlib"):
        frame = frame.f_back
    return str(frame.f_globals.get("__name__", "")) if frame else ""
