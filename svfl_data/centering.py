"""Samples for the block-centering task: what was seen and felt right after the collision, and where to move."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from svfl_data.dataset import Dataset
from svfl_data.episode import Camera, Episode
from svfl_data.errors import DatasetError
from svfl_data.symmetry import OFFSET_PARTS, WRENCH_PARTS, act
from svfl_data.windows import WINDOW, latest, wrench_window


@dataclass(frozen=True)
class CenteringSamples:
    """Observations right after a collision with their labels; vectors in image-aligned axes (x right, y up).

    Attributes:
        image: Colour / 255, then depth in metres, shape (S, 4, H, W), float32.
        wrench: Tared wrench window, shape (S, T, 6), float32, [N] and [N m], about the sensor origin.
        offset: Displacement that centres the hand over the block, shape (S, 2), float32, [m].
        direction: Nearest direction (`svfl_data.symmetry.DIRECTIONS`), shape (S,), int64.
        episode: Index of the episode each sample comes from, shape (S,), int64.
    """

    image: np.ndarray
    wrench: np.ndarray
    offset: np.ndarray
    direction: np.ndarray
    episode: np.ndarray

    def __len__(self) -> int:
        return len(self.direction)

    def take(self, index: np.ndarray) -> "CenteringSamples":
        """The chosen samples, in the given order."""
        return CenteringSamples(
            self.image[index], self.wrench[index], self.offset[index], self.direction[index], self.episode[index]
        )


def load_centering(path: Path | str, window: int = WINDOW) -> CenteringSamples:
    """Load the samples of a block-centering dataset into memory.

    Args:
        path: Dataset folder.
        window: Readings per wrench window, T.

    Returns:
        One sample per episode, from its final observation.

    Raises:
        FormatError: If the folder is not a dataset or an episode is damaged.
        DatasetError: If there are no episodes, labels are missing, or episodes have different image sizes.
    """
    dataset = Dataset.open(path)
    samples = [_sample(episode, window) for episode in dataset]
    if not samples:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    sizes = sorted({sample["image"].shape for sample in samples})
    if len(sizes) > 1:
        raise DatasetError(f"{dataset.path}: episodes have different image sizes: {sizes}")
    return CenteringSamples(**{name: np.stack([sample[name] for sample in samples]) for name in samples[0]})


def _sample(episode: Episode, window: int) -> dict[str, np.ndarray]:
    if not (episode.has("label_offset") and episode.has("label_direction")):
        raise DatasetError(f"{episode.name}: has no labels (labels/offset and labels/direction) to learn from")
    camera = _only_camera(episode)
    frame = latest(camera.t_ns, episode.t_ns[-1])
    color = camera.color[frame].astype(np.float32) / 255
    image = np.concatenate([color, camera.depth_m[frame][..., None]], axis=-1)  # (H, W, 4)
    wrench, _ = wrench_window(episode, length=window)
    return {
        "image": image.transpose(2, 0, 1),  # (H, W, 4) -> (4, H, W)
        "wrench": act(camera.image_axes, wrench, WRENCH_PARTS),
        "offset": act(camera.image_axes, episode.label_offset, OFFSET_PARTS).astype(np.float32),
        "direction": np.asarray(episode.label_direction),
        "episode": np.asarray(episode.meta.index, dtype=np.int64),
    }


def _only_camera(episode: Episode) -> Camera:
    cameras = episode.cameras
    if len(cameras) != 1:
        raise DatasetError(f"{episode.name}: a sample needs exactly one camera, found: {', '.join(cameras) or 'none'}")
    (camera,) = cameras.values()
    if not camera.has("depth"):
        raise DatasetError(f"{episode.name}: a sample needs depth, but camera {camera.name} was recorded without")
    return camera
