"""Specification of what is taken from an episode at a step: images of cameras, windows of streams, and vectors."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from numbers import Integral, Real
from typing import Any

from svfl_data.errors import UsageError
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.fields import CAMERA, FIELDS, camera_names

WINDOW = 64
"""Number of readings in a wrench window (Kohler et al., CoRL 2023, section 5 and appendix: the last 64 readings)."""
PROPRIO, WRENCH = "observations/proprio", "streams/wrench/wrench"
ACTIONS, EXPERT_ACTION = "actions/", "actions/expert_action"
STANDARD_GROUPS = frozenset(one.group for one in FIELDS if CAMERA not in one.path) - {"streams/wrench"}


@dataclass(frozen=True)
class Window:
    """So many readings of a stream, the last ones at or before a step.

    Attributes:
        length: Number of readings, at least 1.
        rate_hz: Rate for which the window is meant, [Hz]: 64 readings are 128 ms at 500 Hz, but 640 ms at 100 Hz. An
            episode whose stream has another rate is refused. None accepts every rate.
        resample: Whether a stream of another rate is resampled instead: the latest reading at or before each of
            `length` moments, 1 / `rate_hz` apart.

    Example:
        >>> Window(64, rate_hz=500.0).length
        64
    """

    length: int = 1
    rate_hz: float | None = None
    resample: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.length, Integral) or self.length < 1:
            raise UsageError(f"a window has {self.length!r} readings; it must be a whole number, at least 1")
        if self.rate_hz is not None and not (isinstance(self.rate_hz, Real) and self.rate_hz > 0):
            raise UsageError(f"a window has a rate of {self.rate_hz!r} Hz; it must be a number above 0")
        if self.resample and self.rate_hz is None:
            raise UsageError("a window that is resampled needs a rate")


@dataclass(frozen=True)
class InputSpec:
    """What is taken from an episode at a step.

    Attributes:
        cameras: Names of the cameras. All images that a camera has are taken: the latest ones at or before the step.
        frames: Number of images per camera, at least 1.
        windows: Window of each stream, by the path of its array. Arrays of one group have windows of one kind.
        vectors: Paths of the arrays below ``observations/`` of which the row of the step is taken.

    Example:
        >>> InputSpec(cameras=("front",), windows={"streams/wrench/wrench": Window(64, 500.0)}).frames
        1
    """

    cameras: tuple[str, ...] = ()
    frames: int = 1
    windows: Mapping[str, Window] = field(default_factory=dict)
    vectors: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise UsageError(f"frames is {self.frames}; it must be at least 1")
        for path in self.windows:
            if not path.startswith(("streams/", "observations/")):
                raise UsageError(f"{path!r} has no window; windows are of arrays below streams/NAME/ or observations/")
        for path in self.vectors:
            if not path.startswith("observations/"):
                raise UsageError(
                    f"{path!r} is no vector of a step; those are below observations/, streams have windows"
                )
        groups: dict[str, Window] = {}
        for path, window in self.windows.items():
            group = path.rpartition("/")[0]
            if groups.setdefault(group, window) != window:
                raise UsageError(f"{path} has another window than other arrays of {group}; they share one clock")

    @classmethod
    def of(
        cls,
        paths: Collection[str],
        declarations: Declarations,
        cameras: Sequence[str] | None = None,
        frames: int = 1,
        windows: Mapping[str, Window | int] | None = None,
        vectors: Sequence[str] | None = None,
    ) -> "InputSpec":
        """Return a specification, in which everything that is not given is taken from what was recorded.

        Args:
            paths: Dataset paths of the recorded arrays.
            declarations: Declarations of the arrays.
            cameras: Names of the cameras; by default all.
            frames: Number of images per camera.
            windows: Window of each stream, or its number of readings, by path; by default 64 readings of every array
                called ``wrench``, and the latest reading of every other stream of the user's own.
            vectors: Paths below ``observations/``; by default all.
        """
        numeric = [path for path in paths if (one := declarations.at(path)) and one.grows and _is_number(one.dtype)]
        if windows is None:
            streams = [path for path in numeric if path.startswith("streams/") and not path.endswith("/t_ns")]
            chosen = [path for path in streams if path.rpartition("/")[0] not in STANDARD_GROUPS]
            sizes = {path.rpartition("/")[0]: WINDOW for path in chosen if path.endswith("/wrench")}
            windows = {path: sizes.get(path.rpartition("/")[0], 1) for path in chosen}
        if vectors is None:
            vectors = [path for path in numeric if path.startswith("observations/") and not path.endswith("/t_ns")]
        found = {path: one if isinstance(one, Window) else Window(one) for path, one in windows.items()}
        names = camera_names(paths) if cameras is None else cameras
        return cls(tuple(names), frames, found, tuple(vectors))

    @property
    def groups(self) -> dict[str, Window]:
        """Window of each group of streams, such as ``streams/wrench``."""
        return {path.rpartition("/")[0]: window for path, window in self.windows.items()}

    def plain(self) -> dict[str, Any]:
        """Return the specification as plain values for files."""
        return asdict(self)


def paper_inputs(camera: str = "", rate_hz: float | None = None, window: int = WINDOW) -> InputSpec:
    """Return the specification of the paper's inputs: a camera, the wrench window and proprioception.

    Args:
        camera: Name of the camera; empty if no images are taken.
        rate_hz: Rate of the wrench readings, [Hz]; None accepts every rate.
        window: Number of readings of the wrench window.
    """
    return InputSpec((camera,) if camera else (), windows={WRENCH: Window(window, rate_hz)}, vectors=(PROPRIO,))


def _is_number(dtype: str) -> bool:
    return dtype.startswith(("int", "uint", "float", "bool"))
