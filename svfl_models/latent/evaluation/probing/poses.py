"""Pose of the task's object, as a target of probes."""

import numpy as np
from scipy.spatial.transform import Rotation

from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.windows import latest
from svfl_data.symmetry import Part, act
from svfl_models.latent.evaluation.frames import Frames

POSE_PARTS = (Part("vector", (0, 1)), Part("invariant", (2,)), Part("angle", (3,)))


def object_poses(dataset: Dataset, frames: Frames, camera: str) -> np.ndarray | None:
    """Return the pose of the object in each frame of a dataset, in image-aligned axes.

    Args:
        dataset: Dataset that the frames are from.
        frames: The frames.
        camera: Name of the camera whose axes are used.

    Returns:
        x, y relative to the workspace centre and z, [m], and yaw, [rad], shape (F, 4). None if an episode was recorded
        without the object's pose.

    Raises:
        FormatError: If an episode is damaged.
    """
    poses = np.empty((len(frames), 4))
    for index in frames.episode.unique().tolist():
        reader = dataset.episode(index)
        if "streams/object/pose" not in reader or "streams/object/t_ns" not in reader:
            return None
        rows = frames.episode == index
        t_ns, object_t_ns = reader["observations/t_ns"][()], reader["streams/object/t_ns"][()]
        pose = reader["streams/object/pose"][()][
            [max(0, latest(object_t_ns, now)) for now in t_ns[frames.step[rows].numpy()]]
        ]
        axis = Rotation.from_quat(pose[:, 3:]).as_matrix()[:, :2, 0]  # the object's x axis in base axes
        position = pose[:, :3].copy()
        position[:, :2] -= reader["workspace"][()][:2].mean(axis=1)
        planar = np.concatenate([position, np.arctan2(axis[:, 1], axis[:, 0])[:, None]], axis=1)
        poses[rows.numpy()] = act(reader[f"cameras/{camera}/image_axes"][()], planar, POSE_PARTS)
    return poses


def repeats_per_turn(dataset: Dataset) -> int:
    """Return how often the object of a dataset looks the same in a full turn.

    The yaw of the object is only defined up to this period.

    A box with a square base repeats at every quarter turn, any other box at every half turn. If the size is not
    recorded, the blocks of the ``centering`` task and of tasks called ``block_...`` count as square; any other object
    (a mug, a drawer) does not repeat.
    """
    if dataset.indices:
        first = dataset.episode(dataset.indices[0])
        if "streams/object/half_extents" in first:
            half = first["streams/object/half_extents"][()]
            return 4 if np.isclose(half[0], half[1], rtol=1e-3) else 2
    return 4 if str(dataset.info["task"]).startswith("block") or dataset.info["task"] == "centering" else 1
