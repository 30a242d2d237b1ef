"""From raw wrench readings to usable ones: transforms that are recorded with the episode, never applied to the file.

The raw stream stays as the sensor gave it. What is done to it when reading is a list in `Meta.transforms`, in order,
each a JSON object with a `name` and its parameters; a file without the list is tared with its own tare.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.schema.fields import LARGEST

GRAVITY = 9.80665  # m/s^2, standard gravity (CGPM 1901)


class Transform(Protocol):
    """One step from raw to usable readings; causal: a row never depends on a later one."""

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Transform the whole stream, shape (M, 6), [N] and [N m]; the input is left alone."""


@dataclass(frozen=True)
class Tare:
    """Subtract an offset.

    Attributes:
        offset: Force and torque, (6,), [N] and [N m], base axes, about the sensor origin; None is the episode's tare.

    Example:
        >>> processed_wrench(dataset[0], [Tare((0.0, 0.0, 1.0, 0.0, 0.0, 0.0))]).shape
        (600, 6)
    """

    offset: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Check the offset.

        Raises:
            UsageError: If it is not six numbers.
        """
        if self.offset is not None and (len(self.offset) != 6 or not np.isfinite(self.offset).all()):
            raise UsageError(f"tare: the offset must be six finite numbers (N and N m), got {list(self.offset)}")

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Subtract the offset."""
        return wrench - (episode.tare if self.offset is None else np.asarray(self.offset))


@dataclass(frozen=True)
class LowPass:
    """First-order low-pass, y' = 2 pi f_c (u - y), solved exactly between readings held constant.

    Causal; a lag of 1 / (2 pi f_c) seconds; correct on irregular timestamps, where each reading has its own gain
    1 - exp(-2 pi f_c dt). The first output is the first reading.

    Attributes:
        cutoff_hz: Corner frequency, [Hz]; readings fall to 1/sqrt(2) there.

    Example:
        >>> processed_wrench(dataset[0], [LowPass(cutoff_hz=20.0)]).shape
        (600, 6)
    """

    cutoff_hz: float

    def __post_init__(self) -> None:
        """Check the frequency.

        Raises:
            UsageError: If it is not positive.
        """
        if not 0 < self.cutoff_hz < np.inf:
            raise UsageError(f"low_pass: the corner frequency must be positive, got {self.cutoff_hz:g} Hz")

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Filter each component."""
        elapsed = np.clip(np.diff(episode.wrench_t_ns), 0, None) / 1e9  # a clock that runs backwards holds the output
        gains = -np.expm1(-2 * np.pi * self.cutoff_hz * elapsed)
        out = np.array(wrench, dtype=np.float64)
        for row, gain in enumerate(gains, start=1):
            out[row] = out[row - 1] + gain * (out[row] - out[row - 1])
        return out


@dataclass(frozen=True)
class Gravity:
    """Subtract the weight of what hangs below the sensor; the gripper points straight down and turns about base z.

    A stored tare already contains the weight at the yaw where it was read. After this transform a tare must be the
    offset of the sensor alone, so give it explicitly: `Tare(offset)`.

    Attributes:
        mass_kg: Mass below the sensor, [kg].
        centre_m: Its centre of mass from the sensor origin, (x, y, z), [m], gripper axes (base axes turned by the yaw).

    Example:
        >>> weight = Gravity(mass_kg=0.4, centre_m=(0.0, 0.0, 0.05))
        >>> processed_wrench(dataset[0], [weight]).shape
        (600, 6)
    """

    mass_kg: float
    centre_m: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check mass and centre.

        Raises:
            UsageError: If the mass is negative or the centre is not three numbers.
        """
        if not 0 <= self.mass_kg < np.inf or len(self.centre_m) != 3 or not np.isfinite(self.centre_m).all():
            raise UsageError(
                f"gravity: needs a mass of at least 0 kg and a centre (x, y, z) in m, "
                f"got {self.mass_kg:g} and {list(self.centre_m)}"
            )

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Subtract m g at the centre of mass, turned by the yaw of the latest observation."""
        row = np.searchsorted(episode.t_ns, episode.wrench_t_ns, side="right") - 1
        yaw = episode.proprio[np.maximum(row, 0), 4].astype(np.float64)
        x, y, _ = self.centre_m
        across = np.cos(yaw) * x - np.sin(yaw) * y  # the centre's base x and y; its height has no lever on a weight
        along = np.sin(yaw) * x + np.cos(yaw) * y
        weight = np.zeros_like(wrench, dtype=np.float64)
        weight[:, 2] = -self.mass_kg * GRAVITY
        weight[:, 3] = along * weight[:, 2]  # r x F with F along z: (y Fz, -x Fz, 0)
        weight[:, 4] = -across * weight[:, 2]
        return wrench - weight


TRANSFORMS: dict[str, type[Tare] | type[LowPass] | type[Gravity]] = {
    "tare": Tare,
    "low_pass": LowPass,
    "gravity": Gravity,
}
"""The transforms by the name under which they are recorded."""


def as_record(transform: Tare | LowPass | Gravity) -> dict[str, Any]:
    """What `Meta.transforms` stores: the name and the parameters, as JSON values."""
    name = next(name for name, kind in TRANSFORMS.items() if kind is type(transform))
    parameters = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(transform).items()}
    return {"name": name, **{key: value for key, value in parameters.items() if value is not None}}


def from_record(record: dict[str, Any], where: str) -> Transform:
    """The transform that a record of `Meta.transforms` describes.

    Args:
        record: Name and parameters.
        where: What to name in the error.

    Raises:
        FormatError: If the name or a parameter is unknown, or a number impossible; a transform must not be left out
            silently.
    """
    try:
        numbers = [value for key, value in record.items() if key != "name"]
        if any(np.abs(value).max() > LARGEST for value in numbers):
            raise ValueError(f"numbers up to {LARGEST:g} are possible")
        parameters: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in record.items()
        }
        return TRANSFORMS[parameters.pop("name")](**parameters)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, UsageError) as error:
        known = ", ".join(TRANSFORMS)
        raise FormatError(
            f"{where}: cannot apply the recorded transform {record} ({error!r}); known are {known}"
        ) from error


def recorded_transforms(episode: Episode) -> list[Transform]:
    """The transforms of an episode, in order; its own tare if it records none."""
    records = episode.meta.transforms or [as_record(Tare())]
    return [from_record(record, episode.name) for record in records]


def processed_wrench(episode: Episode, then: Iterable[Transform] = ()) -> np.ndarray:
    """The wrench stream after the recorded transforms.

    Args:
        episode: Where to read.
        then: Further transforms, applied after the recorded ones.

    Returns:
        Shape (M, 6), float32, [N] and [N m], base axes, about the sensor origin.

    Raises:
        FormatError: If a recorded transform is unknown.

    Example:
        >>> processed_wrench(dataset[0]).shape
        (600, 6)
    """
    wrench = np.asarray(episode.wrench, dtype=np.float64)
    for transform in [*recorded_transforms(episode), *then]:
        wrench = transform.apply(wrench, episode)
    return wrench.astype(np.float32)
