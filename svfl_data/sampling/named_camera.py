"""The camera whose images a network takes: it is named where an episode has several, and never the first one found."""

from collections.abc import Collection

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import entries
from svfl_data.errors import DatasetError, FieldError
from svfl_data.schema.episode import Camera, Episode
from svfl_data.system.printable import printable


def named_camera(recorded: Collection[str], name: str | None, source: object) -> str:
    """Return the name of the camera whose images are used.

    Args:
        recorded: Names of the cameras that there are.
        name: Name that was asked for. None asks for the only camera.
        source: Name of the recording in the error message.

    Raises:
        DatasetError: If there is no camera of this name, or not exactly one where none was asked for.

    Example:
        >>> named_camera(["front"], None, "episode 3"), named_camera(["front", "wrist"], "wrist", "episode 3")
        ('front', 'wrist')
    """
    if name is None and len(recorded) == 1:
        return next(iter(recorded))
    have = ", ".join(recorded) or "none"
    if name is None:
        raise DatasetError(f"{source}: name the camera whose images are used (--camera); recorded cameras: {have}")
    if name not in recorded:
        raise DatasetError(f"{source}: has no camera {printable(name, 40)}; recorded cameras: {have}")
    return name


def camera_of_dataset(dataset: Dataset, name: str | None) -> str:
    """Return the name of the camera whose images are used, which all episodes of a dataset must have.

    Args:
        dataset: Dataset of the episodes.
        name: Name that was asked for. None asks for the only camera.

    Raises:
        DatasetError: If the dataset has no episodes, or an episode has no such camera, or several where none was asked
            for.
        FormatError: If an episode is damaged.
    """
    recorded: dict[str, Collection[str]] = {}
    for entry in entries(dataset):  # the index has no entry for a file with an error, which is found on reading
        known: Collection[str] = dataset.episode(entry.index).cameras if entry.error else entry.cameras
        recorded[str(dataset.path / entry.name)] = known
    names = [named_camera(cameras, name, source) for source, cameras in recorded.items()]
    if not names:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    for source, cameras in recorded.items():
        named_camera(cameras, names[0], source)
    return names[0]


def camera_with_depth(episode: Episode, name: str | None) -> Camera:
    """Return the camera of an episode whose colour and depth images are used.

    Args:
        episode: The episode.
        name: Name that was asked for. None asks for the only camera.

    Raises:
        DatasetError: If the episode has no such camera, or several where none was asked for.
        FieldError: If the camera was recorded without depth, or without image axes, as one that moves.
    """
    camera = episode.cameras[named_camera(episode.cameras, name, episode.name)]
    for field in ("depth", "depth_scale", "image_axes"):
        if not camera.has(field):
            raise FieldError(f"{episode.name}: camera {camera.name} was recorded without {field}")
    return camera
