"""Labels of the steps of an episode: contact and reward."""

from collections.abc import Sequence

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.sampling.windows import latest
from svfl_data.schema.episode import Episode
from svfl_data.signals.contact import CONTACT

MOVED_M, MOVED_COSINE = 5e-4, np.cos(np.deg2rad(1.0) / 2)
"""Limits of the motion of an object within a step, 0.5 mm and 1 degree (as the cosine of half the angle). An object
that moves or turns farther counts as touched."""


def pressed(episode: Episode, contact_n: float) -> np.ndarray:
    """Return whether the force at each observation exceeds a threshold, shape (N+1,), bool.

    The force is that of the last reading at or before the observation; without such a reading the result is false. VTT
    labels contact in the same way but from the whole wrench; here it is the force alone, because newtons and newton
    metres have no common norm.

    Args:
        episode: The episode, of N steps.
        contact_n: Threshold on the norm of the tared force, [N].
    """
    force = np.linalg.norm(episode.tared_wrench[:, :3], axis=1)
    rows = [latest(episode.wrench_t_ns, now) for now in episode.t_ns]
    return np.array([row >= 0 and force[row] > contact_n for row in rows])


def touched(episode: Episode, annotated: bool) -> np.ndarray:
    """Return whether there is contact between each observation and the next, shape (N,), bool.

    Args:
        episode: The episode, of N steps.
        annotated: Whether contact is read from the episode's annotations (``svfl-data relabel --contact``). Otherwise
            it is read from the pose of the simulated or tracked object: an object that moves is touched.
    """
    before, after = episode.t_ns[:-1], episode.t_ns[1:]
    if annotated:
        contacts = [one for one in episode.meta.annotations if one.get("name") == CONTACT]
        overlaps = [(one["start_ns"] <= after) & (one["end_ns"] > before) for one in contacts]
        return np.any(overlaps, axis=0) if overlaps else np.zeros(len(before), dtype=bool)
    rows = [max(0, latest(episode.object_t_ns, now)) for now in episode.t_ns]
    place, turn = episode.object_pose[rows, :3], episode.object_pose[rows, 3:]
    moved = np.linalg.norm(np.diff(place, axis=0), axis=1) > MOVED_M
    return moved | (np.abs((turn[1:] * turn[:-1]).sum(axis=1)) < MOVED_COSINE)


def rewards(episode: Episode) -> np.ndarray:
    """Return 1 for the last action of an episode that succeeded and 0 for all others, shape (N,), float32."""
    reward = np.zeros(len(episode), dtype=np.float32)
    reward[-1:] = float(episode.meta.success)
    return reward


def contacts_annotated(episodes: Sequence[Episode], where: object) -> bool:
    """Return whether contacts are read from annotations, which is the case if any episode has annotations of contact.

    Otherwise contacts are read from the pose of the object.

    Args:
        episodes: All episodes of a dataset.
        where: Path of the dataset, for the error message.

    Raises:
        DatasetError: If no episode has annotations of contact, and an episode was recorded without the object's pose.
    """
    if any(one.get("name") == CONTACT for episode in episodes for one in episode.meta.annotations):
        return True
    for episode in episodes:
        if not (episode.has("object_pose") and episode.has("object_t_ns")):
            raise DatasetError(
                f"{where}: nothing says when there is contact: no episode has annotations of it, and {episode.name} "
                f"was recorded without an object's pose; svfl-data relabel {where} --contact makes annotations"
            )
    return False
