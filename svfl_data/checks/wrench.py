"""Checks that the wrench looks like the readings of a working, tared sensor."""

from collections.abc import Iterator

import numpy as np

from svfl_data.checks.finding import Finding, error, longest_run, note, seconds, travel_m, warning
from svfl_data.schema.episode import Episode

PATH, TARE = "streams/wrench/wrench", "streams/wrench/tare"
COMPONENTS = ("fx", "fy", "fz", "mx", "my", "mz")
UNITS = ("N", "N", "N", "N m", "N m", "N m")

CLIPPED_READINGS = 8  # so many readings in a row at the same extreme, while other components change, are clipped
CLIPPED_LOAD = np.array([10.0, 10.0, 10.0, 0.5, 0.5, 0.5])  # N and N m from the tare; a sensor clips far from rest
STUCK_S, STUCK_READINGS = 0.1, 20  # a sensor is stuck if all six components stay equal for this time and number
MOVED_M = 0.005  # a gripper that moves this far changes the readings of a working sensor
TARE_MISFIT = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # N and N m by which mean readings may differ from the tare


def check_saturation(episode: Episode) -> Iterator[Finding]:
    """Check that no component is clipped, that is, held at its extreme value while other components change."""
    wrench = episode.wrench
    if len(wrench) < CLIPPED_READINGS:
        return
    alive = np.concatenate([[True], (np.diff(wrench, axis=0) != 0).any(axis=1)])
    for column, (name, unit) in enumerate(zip(COMPONENTS, UNITS, strict=True)):
        values = wrench[:, column]
        for extreme in (values.max(), values.min()):
            if abs(extreme - episode.tare[column]) < CLIPPED_LOAD[column]:
                continue
            row, length = longest_run((values == extreme) & alive)
            if length >= CLIPPED_READINGS:
                words = (
                    f"{name} is saturated: {length} readings in a row at its extreme of {extreme:.4g} {unit}, "
                    f"from {seconds(episode.wrench_t_ns[row])}"
                )
                yield error(episode, PATH, row, words)


def check_stuck(episode: Episode) -> Iterator[Finding]:
    """Check that the sensor does not repeat a reading while the gripper moves.

    At rest, repeated readings are only noted, since a simulated sensor without noise repeats its readings then.
    """
    wrench, t_ns = episode.wrench, episode.wrench_t_ns
    if len(wrench) and not wrench.any():
        yield warning(episode, PATH, None, "every reading is zero: was there a sensor?")
        return
    row, repeats = longest_run((np.diff(wrench, axis=0) == 0).all(axis=1))
    start, end = (int(t_ns[row]), int(t_ns[row + repeats])) if repeats else (0, 0)
    if repeats + 1 < STUCK_READINGS or end - start < STUCK_S * 1e9:
        return
    moved = travel_m(episode, start, end)
    words = f"{repeats + 1} identical readings in a row from {seconds(start)} to {seconds(end)}"
    if moved > MOVED_M:
        yield error(episode, PATH, row, f"stuck sensor: {words}, while the gripper moved by {moved * 1e3:.0f} mm")
    else:
        yield note(episode, PATH, row, f"{words}, with the gripper at rest: a simulated or a stuck sensor")


def check_tare(episode: Episode) -> Iterator[Finding]:
    """Check that the tare agrees with the mean reading of the sensor before the first motion."""
    moving = np.flatnonzero(episode.action[:, 1:].any(axis=1))
    start = int(episode.t_ns[moving[0]]) if len(moving) else int(episode.t_ns[-1])
    before = episode.wrench[episode.wrench_t_ns <= start].astype(np.float64)
    if not len(before):
        yield note(episode, TARE, None, "no reading before the first motion: the tare cannot be checked")
        return
    if not episode.wrench.any():
        return
    misfit = np.abs(before.mean(axis=0) - episode.tare)
    limit = TARE_MISFIT + 5 * before.std(axis=0) / np.sqrt(len(before))
    if (misfit <= limit).all():
        return
    column = int((misfit / limit).argmax())
    what = "does not fit" if episode.tare.any() else "is missing (all zero)"
    words = (
        f"the tare {what}: {COMPONENTS[column]} reads {before[:, column].mean():.3g} {UNITS[column]} on average "
        f"before the first motion ({seconds(start)}), the tare is {episode.tare[column]:.3g} {UNITS[column]}"
    )
    yield warning(episode, TARE, column, words)
