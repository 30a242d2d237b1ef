"""Transforms from raw wrench readings to usable ones, which are recorded with the episode and applied when reading.

The raw stream in the file stays as the sensor gave it. `Meta.transforms` lists the transforms in the order in which
they are applied, each as a JSON object with a `name` and its parameters. A file without such a list is tared with its
own tare, if it has one.
"""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Protocol

import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import LARGEST

GRAVITY = 9.80665  # m/s^2, standard gravity (CGPM 1901)


class Transform(Protocol):
    """Protocol of one step from raw to usable readings. It is causal: a row never depends on a later one."""

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Return the transformed stream, and leave the input unchanged.

        Args:
            wrench: The whole wrench stream, shape (M, 6), [N] and [N m], base axes, about the sensor origin.
            episode: Episode of the stream, which gives times, tare and proprioception.

        Returns:
            The transformed stream, same shape, units, axes and reference point.
        """


@dataclass(frozen=True)
class Tare:
    """Transform that subtracts an offset.

    Attributes:
        offset: Force and torque to subtract, shape (6,), [N] and [N m], base axes, about the sensor origin. None for
            the tare of the episode.

    Example:
        >>> processed_wrench(dataset[0], [Tare((0.0, 0.0, 1.0, 0.0, 0.0, 0.0))]).shape
        (600, 6)
    """

    offset: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Check the offset.

        Raises:
            UsageError: If the offset is not six finite numbers.
        """
        if self.offset is not None and (len(self.offset) != 6 or not np.isfinite(self.offset).all()):
            raise UsageError(f"tare: the offset must be six finite numbers (N and N m), got {list(self.offset)}")

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Return the wrench stream minus the offset; see `Transform.apply`."""
        return wrench - (episode.tare if self.offset is None else np.asarray(self.offset))


@dataclass(frozen=True)
class LowPass:
    """First-order low-pass filter, y' = 2 pi f_c (u - y), solved exactly for readings held constant in between.

    The filter is causal and has a lag of 1 / (2 pi f_c) seconds. It is correct for irregular time stamps, because each
    reading has its own gain 1 - exp(-2 pi f_c dt). The first output is the first reading.

    Attributes:
        cutoff_hz: Corner frequency f_c, [Hz], at which the amplitude falls to 1/sqrt(2).

    Example:
        >>> processed_wrench(dataset[0], [LowPass(cutoff_hz=20.0)]).shape
        (600, 6)
    """

    cutoff_hz: float

    def __post_init__(self) -> None:
        """Check the corner frequency.

        Raises:
            UsageError: If the corner frequency is not positive and finite.
        """
        if not 0 < self.cutoff_hz < np.inf:
            raise UsageError(f"low_pass: the corner frequency must be positive, got {self.cutoff_hz:g} Hz")

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Return the wrench stream with each component filtered; see `Transform.apply`."""
        elapsed = np.clip(np.diff(episode.wrench_t_ns), 0, None) / 1e9  # a clock that runs backwards counts as no time
        gains = -np.expm1(-2 * np.pi * self.cutoff_hz * elapsed)
        out = np.array(wrench, dtype=np.float64)
        for row, gain in enumerate(gains, start=1):
            out[row] = out[row - 1] + gain * (out[row] - out[row - 1])
        return out


@dataclass(frozen=True)
class Gravity:
    """Transform that subtracts the weight of what hangs below the sensor.

    The gripper must point straight down and turn about base z. A stored tare already contains the weight at the yaw at
    which the tare was read. After this transform, a tare must be the offset of the sensor alone, so give that offset
    explicitly: `Tare(offset)`.

    Attributes:
        mass_kg: Mass below the sensor, [kg].
        centre_m: Centre of mass relative to the sensor origin, (x, y, z), [m], gripper axes (base axes rotated by the
            yaw).

    Example:
        >>> weight = Gravity(mass_kg=0.4, centre_m=(0.0, 0.0, 0.05))
        >>> processed_wrench(dataset[0], [weight]).shape
        (600, 6)
    """

    mass_kg: float
    centre_m: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check mass and centre of mass.

        Raises:
            UsageError: If the mass is negative or not finite, or the centre is not three finite numbers.
        """
        if not 0 <= self.mass_kg < np.inf or len(self.centre_m) != 3 or not np.isfinite(self.centre_m).all():
            raise UsageError(
                f"gravity: needs a mass of at least 0 kg and a centre (x, y, z) in m, "
                f"got {self.mass_kg:g} and {list(self.centre_m)}"
            )

    def apply(self, wrench: np.ndarray, episode: Episode) -> np.ndarray:
        """Return the wrench stream minus the weight at the centre of mass; see `Transform.apply`.

        The centre of mass is rotated by the yaw of the latest observation at or before each reading.
        """
        row = np.searchsorted(episode.t_ns, episode.wrench_t_ns, side="right") - 1
        yaw = episode.proprio[np.maximum(row, 0), 4].astype(np.float64)
        x, y, _ = self.centre_m
        across = np.cos(yaw) * x - np.sin(yaw) * y  # base x and y of the centre; the height of a weight has no lever
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
"""Class of each transform by the name under which the transform is recorded."""


def as_record(transform: Tare | LowPass | Gravity) -> dict[str, Any]:
    """Return the record of a transform for `Meta.transforms`: its name and its parameters as JSON values.

    Args:
        transform: Transform to record. Parameters that are None are left out of the record.
    """
    name = next(name for name, kind in TRANSFORMS.items() if kind is type(transform))
    parameters = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(transform).items()}
    return {"name": name, **{key: value for key, value in parameters.items() if value is not None}}


def from_record(record: dict[str, Any], where: str) -> Transform:
    """Return the transform that a record of `Meta.transforms` describes.

    An impossible record is an error, because a transform must not be left out silently.

    Args:
        record: Name and parameters of the transform.
        where: Name of the episode in the error.

    Raises:
        FormatError: If the name or a parameter is unknown, or a number is impossible.
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
    """Return the recorded transforms of an episode in order, or its own tare, if it has one, if it records none.

    Raises:
        FormatError: If a recorded transform is unknown or has an impossible parameter.
    """
    records = episode.meta.transforms or ([as_record(Tare())] if episode.has("tare") else [])
    return [from_record(record, episode.name) for record in records]


def processed_wrench(episode: Episode, then: Iterable[Transform] = ()) -> np.ndarray:
    """Return the wrench stream of an episode after its recorded transforms.

    Args:
        episode: Episode whose wrench stream is read.
        then: Further transforms, which are applied after the recorded ones.

    Returns:
        Processed wrench readings, shape (M, 6), float32, [N] and [N m], base axes, about the sensor origin.

    Raises:
        FormatError: If a recorded transform is unknown or has an impossible parameter.

    Example:
        >>> processed_wrench(dataset[0]).shape
        (600, 6)
    """
    wrench = np.asarray(episode.wrench, dtype=np.float64)
    for transform in [*recorded_transforms(episode), *then]:
        wrench = transform.apply(wrench, episode)
    return wrench.astype(np.float32)
