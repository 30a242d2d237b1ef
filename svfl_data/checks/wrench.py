"""Checks that every wrench looks like the readings of a working, tared sensor."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from svfl_data.checks.finding import Finding, error, longest_run, note, seconds, travel_m, warning
from svfl_data.schema.action_fields import EXPERT_ACTION
from svfl_data.schema.episode import Episode
from svfl_data.schema.field_words import WRENCH_UNITS, component_names, wrench_groups

CLIPPED_READINGS = 8  # so many readings in a row at the same extreme, while other components change, are clipped
CLIPPED_LOAD = np.array([10.0, 10.0, 10.0, 0.5, 0.5, 0.5])  # N and N m from the tare; a sensor clips far from rest
STUCK_S, STUCK_READINGS = 0.1, 20  # a sensor is stuck if all six components stay equal for this time and number
MOVED_M = 0.005  # a gripper that moves this far changes the readings of a working sensor
TARE_MISFIT = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # N and N m by which mean readings may differ from the tare


@dataclass(frozen=True, eq=False)
class Sensor:
    """Readings of one wrench sensor of an episode.

    Attributes:
        path: Dataset path of the readings.
        names: Names of the six components.
        wrench: Readings, shape (M, 6), [N] and [N m].
        t_ns: Times of the readings, shape (M,), [ns].
        tare: Offset of the readings, shape (6,), [N] and [N m]. None if it was not recorded.
    """

    path: str
    names: list[str]
    wrench: np.ndarray
    t_ns: np.ndarray
    tare: np.ndarray | None

    @property
    def tare_path(self) -> str:
        """Dataset path of the tare."""
        return f"{self.path.rpartition('/')[0]}/tare"


def sensors(episode: Episode) -> list[Sensor]:
    """Return the wrench sensors of an episode, that of ``streams/wrench`` first."""
    found = []
    for group in wrench_groups(episode.arrays, episode.declarations):
        path, field = f"{group}/wrench", episode.declarations.at(f"{group}/wrench")
        tare = episode.arrays.get(f"{group}/tare")
        tare = tare if tare is not None and tare.shape == (6,) else None
        assert field is not None
        clock = episode.arrays[f"{group}/t_ns"]
        found.append(Sensor(path, component_names(field, (6,)), episode.arrays[path], clock, tare))
    return found


def check_saturation(episode: Episode) -> Iterator[Finding]:
    """Check that no component is clipped, that is, held at its extreme value while other components change."""
    for sensor in sensors(episode):
        wrench = sensor.wrench
        if len(wrench) < CLIPPED_READINGS:
            continue
        rest = np.median(wrench, axis=0) if sensor.tare is None else sensor.tare
        alive = np.concatenate([[True], (np.diff(wrench, axis=0) != 0).any(axis=1)])
        for column, (name, unit) in enumerate(zip(sensor.names, WRENCH_UNITS, strict=True)):
            values = wrench[:, column]
            for extreme in (values.max(), values.min()):
                if abs(extreme - rest[column]) < CLIPPED_LOAD[column]:
                    continue
                row, length = longest_run((values == extreme) & alive)
                if length >= CLIPPED_READINGS:
                    words = (
                        f"{name} is saturated: {length} readings in a row at its extreme of {extreme:.4g} {unit}, "
                        f"from {seconds(sensor.t_ns[row])}"
                    )
                    yield error(episode, sensor.path, row, words)


def check_stuck(episode: Episode) -> Iterator[Finding]:
    """Check that no sensor repeats a reading while the gripper moves.

    At rest, repeated readings are only noted, since a simulated sensor without noise repeats its readings then.
    """
    for sensor in sensors(episode):
        yield from _stuck(episode, sensor)


def _stuck(episode: Episode, sensor: Sensor) -> Iterator[Finding]:
    wrench, t_ns, path = sensor.wrench, sensor.t_ns, sensor.path
    if len(wrench) and not wrench.any():
        yield warning(episode, path, None, "every reading is zero: was there a sensor?")
        return
    row, repeats = longest_run((np.diff(wrench, axis=0) == 0).all(axis=1))
    start, end = (int(t_ns[row]), int(t_ns[row + repeats])) if repeats else (0, 0)
    if repeats + 1 < STUCK_READINGS or end - start < STUCK_S * 1e9:
        return
    moved = travel_m(episode, start, end)
    words = f"{repeats + 1} identical readings in a row from {seconds(start)} to {seconds(end)}"
    if moved is None:
        yield warning(episode, path, row, f"{words}; whether the gripper moved was not recorded")
    elif moved > MOVED_M:
        yield error(episode, path, row, f"stuck sensor: {words}, while the gripper moved by {moved * 1e3:.0f} mm")
    else:
        yield note(episode, path, row, f"{words}, with the gripper at rest: a simulated or a stuck sensor")


def check_tare(episode: Episode) -> Iterator[Finding]:
    """Check that every sensor has a tare, which agrees with its mean reading before the first motion."""
    start = first_motion_ns(episode)
    for sensor in sensors(episode):
        if sensor.tare is None:
            yield warning(episode, sensor.path, None, "has no tare: its readings are shown and used as they are")
        else:
            yield from _tare(episode, sensor, sensor.tare, start)


def _tare(episode: Episode, sensor: Sensor, tare: np.ndarray, start: int) -> Iterator[Finding]:
    before = sensor.wrench[sensor.t_ns <= start].astype(np.float64)
    if not len(before):
        yield note(episode, sensor.tare_path, None, "no reading before the first motion: the tare cannot be checked")
        return
    if not sensor.wrench.any():
        return
    misfit = np.abs(before.mean(axis=0) - tare)
    limit = TARE_MISFIT + 5 * before.std(axis=0) / np.sqrt(len(before))
    if (misfit <= limit).all():
        return
    column = int((misfit / limit).argmax())
    what = "does not fit" if tare.any() else "is missing (all zero)"
    words = (
        f"the tare {what}: {sensor.names[column]} reads {before[:, column].mean():.3g} {WRENCH_UNITS[column]} on "
        f"average before the first motion ({seconds(start)}), the tare is {tare[column]:.3g} {WRENCH_UNITS[column]}"
    )
    yield warning(episode, sensor.tare_path, column, words)


def first_motion_ns(episode: Episode) -> int:
    """Return the time of the observation at which the first motion is commanded, or of the last one, [ns].

    Commands that are changes move the arm where they are not zero; other commands where they differ from the first one.
    Grippers, which are commanded by their opening beside changes of the arm, do not count.

    Args:
        episode: Episode with at least one observation.
    """
    rows = [len(episode)]
    for path, actions in episode.arrays.items():
        field = episode.declarations.at(path)
        if not path.startswith("actions/") or path == EXPERT_ACTION or field is None or actions.dtype.kind not in "iuf":
            continue
        delta = np.array(field.delta, dtype=np.bool_)
        moves = actions[..., delta] if delta.any() else actions - actions[:1]
        rows += np.flatnonzero(moves.any(axis=tuple(range(1, moves.ndim))))[:1].tolist()
    return int(episode.t_ns[min(rows)])
