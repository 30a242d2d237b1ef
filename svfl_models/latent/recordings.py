"""Episodes as latent pretraining uses them: in memory, checked, labelled and in image-aligned axes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.recording.consistency import check_agreement
from svfl_data.sampling.batch import age_key
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.named_camera import camera_of_dataset, camera_with_depth
from svfl_data.schema.action_bounds import planar_limits
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.input_spec import PROPRIO, WRENCH, paper_inputs
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_data.system.progress import progress
from svfl_models.latent.inputs import IMAGE_SIZE
from svfl_models.latent.labels import contacts_annotated, pressed, rewards, touched


@dataclass(frozen=True, eq=False)
class Recording:
    """One episode of N steps, with vectors in image-aligned axes.

    Attributes:
        index: Index of the episode in its dataset.
        color: Latest colour image at each observation, shape (N+1, H, W, 3), uint8.
        depth: Latest depth image at each observation, shape (N+1, H, W), float32, [m]; 0 where there is no measurement.
        wrench: Tared wrench window of each observation, shape (N+1, 64, 6), float32, [N] and [N m].
        proprio: Proprioception at each observation, (x, y) relative to the workspace centre, shape (N+1, 5).
        action: Commanded actions, shape (N, 5).
        reward: Reward of each action, 0 or 1, shape (N,), float32.
        pressed: Whether the force at each observation exceeds the threshold, shape (N+1,), bool.
        touched: Whether there is contact between each observation and the next, shape (N,), bool.
        terminated: Whether the task was achieved at the end; otherwise the episode was cut off.
    """

    index: int
    color: np.ndarray
    depth: np.ndarray
    wrench: np.ndarray
    proprio: np.ndarray
    action: np.ndarray
    reward: np.ndarray
    pressed: np.ndarray
    touched: np.ndarray
    terminated: bool

    def __len__(self) -> int:
        return len(self.action)


def load_recordings(
    dataset: Dataset, contact_n: float, mixed: bool = False, camera: str | None = None
) -> list[Recording]:
    """Read all episodes of a dataset into memory.

    Args:
        dataset: Dataset to read the episodes from.
        contact_n: Force above which an observation counts as contact, [N].
        mixed: Whether the episodes may be of different tasks or have different action bounds.
        camera: Name of the camera whose images are used. May be None if there is one camera.

    Raises:
        DatasetError: If the dataset has no episodes, an episode cannot be used for training or lacks something such as
            the camera, there are several cameras and none is named, or the episodes do not fit together.
        FieldError: If the camera was recorded without depth.
        FormatError: If an episode is damaged.
    """
    indices = dataset.indices
    camera = camera_of_dataset(dataset, camera)
    check_usable(dataset, indices, ["streams/wrench", "streams/object", f"cameras/{camera}"])
    check_agreement(dataset, indices, [camera])
    episodes = [dataset.episode(index).load(images=False) for index in progress(indices, "reading episodes")]
    if not mixed:
        _check_alike(episodes, dataset)
    annotated = contacts_annotated(episodes, dataset.path)
    recordings = [
        _recording(index, episode, camera_with_depth(episode, camera), contact_n, annotated)
        for index, episode in zip(indices, episodes, strict=True)
    ]
    sizes = sorted({one.color.shape[1:3] for one in recordings})
    if len(sizes) > 1:
        raise DatasetError(f"{dataset.path}: episodes have different image sizes: {', '.join(map(str, sizes))}")
    if min(sizes[0]) < IMAGE_SIZE:
        raise DatasetError(f"{dataset.path}: images are {sizes[0]} px; the networks need at least {IMAGE_SIZE}")
    return recordings


def _check_alike(episodes: Sequence[Episode], dataset: Dataset) -> None:
    tasks = sorted({episode.meta.task for episode in episodes})
    if len(tasks) > 1:
        raise DatasetError(f"{dataset.path}: holds episodes of {', '.join(tasks)}; --mixed learns from all of them")
    actions = [field for episode in episodes if (field := episode.declarations.at(ACTION))]
    limits = sorted({planar_limits(field) for field in actions})
    if len(limits) > 1:
        found = " and ".join(f"{move:g} m, {turn:g} rad" for move, turn in limits)
        raise DatasetError(f"{dataset.path}: actions have different limits, {found}; --mixed learns from all of them")


def _recording(index: int, episode: Episode, camera: Camera, contact_n: float, annotated: bool) -> Recording:
    group, seen = f"cameras/{camera.name}", cut_steps(episode, paper_inputs(camera.name))
    if np.isinf(seen[age_key(group)]).any():
        raise DatasetError(f"{episode.name}: camera {camera.name} has no frame before the first observation")
    proprio = seen[PROPRIO]
    proprio[:, 1:3] -= episode.centre
    return Recording(
        index=index,
        color=seen[f"{group}/color"][:, 0],
        depth=seen[f"{group}/depth"][:, 0] * np.float32(camera.depth_scale),
        wrench=act(camera.image_axes, seen[WRENCH], WRENCH_PARTS),
        proprio=act(camera.image_axes, proprio, PROPRIO_PARTS),
        action=act(camera.image_axes, episode.action, ACTION_PARTS),
        reward=rewards(episode),
        pressed=pressed(episode, contact_n),
        touched=touched(episode, annotated),
        terminated=episode.meta.success,
    )
