"""Samples for the block-centering task: the observation right after the collision, and where the gripper must move."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Literal

import numpy as np

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.recording.consistency import check_agreement
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.named_camera import camera_of_dataset, camera_with_depth, named_camera
from svfl_data.sampling.windows import WINDOW, latest, wrench_window
from svfl_data.schema.episode import Camera, Episode
from svfl_data.schema.input_spec import InputSpec
from svfl_data.signals.pictures import camera_picture, picture
from svfl_data.signals.topdown import topdown
from svfl_data.symmetry import OFFSET_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act, nearest_direction, points_towards
from svfl_data.system.progress import progress

View = Literal["camera", "top"]
VIEWS: tuple[View, ...] = ("camera", "top")
INPUTS = ("image", "wrench", "proprio")


@dataclass(frozen=True)
class CenteringSamples:
    """Observations right after a collision with their labels; vectors in image-aligned axes (x right, y up).

    Attributes:
        image: Colour / 255, then depth in metres, shape (S, 4, H, W), float32. H = W = 0 if images were not requested.
        wrench: Tared wrench window, shape (S, T, 6), float32, [N] and [N m], about the sensor origin.
        proprio: Gripper opening 0..1, x and y relative to the workspace centre and z [m], yaw [rad], shape (S, 5),
            float32.
        offset: Displacement that centres the gripper over the block, shape (S, 2), float32, [m].
        direction: Nearest direction (`svfl_data.symmetry.DIRECTIONS`), shape (S,), int64.
        episode: Index of the episode each sample comes from, shape (S,), int64.
    """

    image: np.ndarray
    wrench: np.ndarray
    proprio: np.ndarray
    offset: np.ndarray
    direction: np.ndarray
    episode: np.ndarray

    def __len__(self) -> int:
        return len(self.direction)

    def take(self, index: np.ndarray) -> "CenteringSamples":
        """Return the samples at the positions `index`, in the order of `index`."""
        return CenteringSamples(**{field.name: getattr(self, field.name)[index] for field in fields(self)})


def load_centering(
    path: Path | str,
    window: int = WINDOW,
    view: View = "camera",
    inputs: Collection[str] = INPUTS,
    camera: str | None = None,
) -> CenteringSamples:
    """Load the samples of a block-centering dataset into memory.

    Args:
        path: Dataset folder.
        window: Number of readings in each wrench window, T.
        view: View of the images: ``camera`` for the images as the camera recorded them, or ``top`` for images computed
            as seen from straight above (`svfl_data.signals.topdown`).
        inputs: Inputs that will be used, out of ``image``, ``wrench`` and ``proprio``. Faults in the other inputs, and
            in cameras that are not used, are ignored. Without ``image``, no images are read, and
            `CenteringSamples.image` has no pixels.
        camera: Name of the camera whose images are used, and in whose image-aligned axes vectors are given. May be None
            if there is one camera, or no images are read.

    Returns:
        One sample per episode, taken at the final observation of the episode.

    Raises:
        FormatError: If the folder is not a dataset or an episode is damaged.
        DatasetError: If there are no episodes, an episode is unfit for training, labels or the camera are missing,
            several cameras have images and none is named, or episodes were recorded with different setups, such as
            another camera pose or image size.
        FieldError: If images are used and the camera was recorded without depth.
    """
    dataset = Dataset.open(path)
    indices = dataset.indices
    if not indices:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    readers = [dataset.episode(index) for index in indices]
    uses = ["labels/offset", "labels/direction", *(["streams/wrench"] if "wrench" in inputs else [])]
    if "image" in inputs or camera is not None:
        camera = camera_of_dataset(dataset, camera)
        uses += [f"cameras/{camera}"] if "image" in inputs else []
    check_usable(dataset, indices, uses)
    check_agreement(dataset, indices, () if camera is None else (camera,))
    episodes = (reader.load(images=False) for reader in readers)
    samples = [
        sample_of(episode, window, view if "image" in inputs else None, camera)
        for episode in progress(episodes, "reading samples", total=len(readers))
    ]
    sizes = sorted({sample["image"].shape for sample in samples})
    if len(sizes) > 1:
        raise DatasetError(f"{dataset.path}: episodes have different image sizes: {sizes}")
    return CenteringSamples(**{name: np.stack([sample[name] for sample in samples]) for name in samples[0]})


def sample_of(
    episode: Episode, window: int = WINDOW, view: View | None = "camera", camera: str | None = None
) -> dict[str, np.ndarray]:
    """Return the sample of one episode, taken at its final observation.

    Args:
        episode: Episode with the labels ``labels/offset`` and ``labels/direction``.
        window: Number of readings in the wrench window, T.
        view: View of the image, as in `load_centering`. None if no image is needed.
        camera: Name of the camera, as in `load_centering`.

    Returns:
        Arrays by the names of the attributes of `CenteringSamples`, without the sample dimension.

    Raises:
        DatasetError: If the episode has no labels or no such camera, or an image is needed and it has several cameras
            of which none is named.
        FieldError: If an image is needed and the camera was recorded without depth.
    """
    if not (episode.has("label_offset") and episode.has("label_direction")):
        raise DatasetError(f"{episode.name}: has no labels (labels/offset and labels/direction) to learn from")
    seen = camera_with_depth(episode, camera) if view else camera_of_axes(episode, camera)
    if view == "camera" and latest(seen.t_ns, episode.t_ns[-1]) < 0:
        raise DatasetError(f"{episode.name}: camera {seen.name} has no frame at or before the final observation")
    wrench, _ = wrench_window(episode, length=window)
    proprio = episode.proprio[-1].copy()
    proprio[1:3] -= episode.centre
    return {
        "image": pictures(episode, seen, view, [-1])[0] if view else np.empty((4, 0, 0), np.float32),
        "wrench": act(seen.image_axes, wrench, WRENCH_PARTS),
        "proprio": act(seen.image_axes, proprio, PROPRIO_PARTS),
        "offset": act(seen.image_axes, episode.label_offset, OFFSET_PARTS).astype(np.float32),
        "direction": np.asarray(direction_in(seen.image_axes, int(episode.label_direction), episode.label_offset)),
        "episode": np.asarray(episode.meta.index, dtype=np.int64),
    }


def pictures(episode: Episode, camera: Camera, view: View, steps: Sequence[int] | None = None) -> np.ndarray:
    """Return the pictures of observations, shape (S, 4, H, W), float32: RGB 0..1, then depth in [m].

    Args:
        episode: The episode.
        camera: Camera of the episode.
        view: View of the pictures, as in `load_centering`.
        steps: Rows of the observations, S of them; -1 is the final one. All by default.
    """
    if view == "camera":
        seen = cut_steps(episode, InputSpec(cameras=(camera.name,)), steps)
        return camera_picture(seen, camera.name, float(camera.depth_scale))
    rows = np.arange(len(episode.t_ns))[slice(None) if steps is None else list(steps)]
    above = topdown(episode, rows.tolist(), [camera.name], size=camera.arrays["color"].shape[1])
    return picture({"color": above.color, "depth": above.depth}, above.view.depth_scale)


def camera_of_axes(episode: Episode, name: str | None) -> Camera:
    """Return the camera in whose image-aligned axes vectors are given if no images are used.

    Args:
        episode: The episode.
        name: Name that was asked for. None asks for any camera in whose axes the label of the episode is right, or for
            the only camera if the episode has no label.

    Raises:
        DatasetError: If there is no such camera.
    """
    if name is not None or not (episode.has("label_offset") and episode.has("label_direction")):
        return episode.cameras[named_camera(episode.cameras, name, episode.name)]
    for camera in (camera for camera in episode.cameras.values() if camera.has("image_axes")):
        if points_towards(int(episode.label_direction), act(camera.image_axes, episode.label_offset, OFFSET_PARTS)):
            return camera
    raise DatasetError(f"{episode.name}: recorded without a camera in whose image its direction points to its offset")


def direction_in(axes: np.ndarray, recorded: int, offset: np.ndarray) -> int:
    """Return the direction class of a sample in the image-aligned axes of a camera.

    Args:
        axes: Image axes of the camera, shape (2, 2).
        recorded: Recorded direction class, which may belong to the axes of another camera. On the border of two classes
            both are right, and it is kept.
        offset: Recorded offset in base axes, shape (2,), [m].
    """
    vector = act(axes, offset, OFFSET_PARTS)
    return recorded if points_towards(recorded, vector) else int(nearest_direction(vector))
