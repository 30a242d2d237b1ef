"""Demonstrations read from episode files, in the form in which a replay buffer stores them."""

from collections import Counter
from collections.abc import Iterator, Sequence
from numbers import Integral

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, UsageError
from svfl_data.recording.consistency import check_agreement
from svfl_data.replay.replay_spec import ReplaySpec
from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.schema.episode import Camera, Episode
from svfl_data.system.progress import progress


def choose(dataset: Dataset, episodes: int | Sequence[int], failures: bool) -> list[int]:
    """Choose the demonstrations of a dataset for a replay buffer.

    Args:
        dataset: Dataset to choose from.
        episodes: Number of episodes to take, in the order of their indices; or the indices to choose from, such as
            ``split["train"]``. Episodes without success are skipped unless `failures` is true.
        failures: Whether to take episodes without success as well.

    Returns:
        Indices of the chosen episodes.

    Raises:
        UsageError: If the number is not positive, or an episode is named twice.
        DatasetError: If there are too few such episodes.
        FormatError: If an episode is damaged.
    """
    kind = "episodes" if failures else "successful episodes"
    counted = isinstance(episodes, Integral)  # true for NumPy's integers as well
    named = [] if isinstance(episodes, int | Integral) else [int(index) for index in episodes]
    wanted = int(episodes) if isinstance(episodes, int | Integral) else len(named)
    if wanted < 1:
        raise UsageError(f"asked for {wanted} episodes; at least 1 is needed")
    candidates = dataset.indices if counted else named
    if twice := [index for index, times in Counter(candidates).items() if times > 1]:
        raise UsageError(f"episode {twice[0]} is named more than once; expert_bonus makes demonstrations count more")
    if not dataset.indices:
        raise DatasetError(f"{dataset.path}: the dataset has no episodes yet")
    chosen: list[int] = []
    for index in candidates:
        if failures or dataset.episode(index).meta.success:
            chosen.append(index)
        if len(chosen) == wanted:
            break
    if not chosen or (counted and len(chosen) < wanted):
        raise DatasetError(
            f"{dataset.path}: asked for {wanted} {kind}, but of {len(candidates)} there are {len(chosen)}; "
            f"collect more, or ask for fewer{'' if failures else ' or for failures, too'}"
        )
    return chosen


def read(dataset: Dataset, indices: Sequence[int], camera: str | None) -> Iterator[tuple[ReplaySpec, StoredEpisode]]:
    """Read episodes, which must all have the same spec.

    Args:
        dataset: Dataset to read from.
        indices: Indices of the episodes, at least one.
        camera: Name of the camera whose images are kept. May be None if the episodes have only one camera.

    Yields:
        Spec and content of each episode.

    Raises:
        DatasetError: If an episode is unfit for training, cannot be cut into transitions, or has another spec than the
            first episode, or if `camera` is None and there is not exactly one camera.
        FieldError: If an episode lacks a field or the camera.
        FormatError: If an episode is damaged.
    """
    cameras = [camera] if camera else dataset.episode(indices[0]).cameras
    check_usable(dataset, indices, ["streams/wrench", *(f"cameras/{name}" for name in cameras)])
    check_agreement(dataset, indices, cameras)
    first: ReplaySpec | None = None
    for index in progress(indices, "preloading demonstrations"):
        episode = dataset.episode(index).load(images=False)
        seen = _camera(episode, camera)
        spec = ReplaySpec.of_episode(episode, seen)
        if first is not None:
            first.require_equal(spec, f"episode {indices[0]}", episode.name)
        first = first or spec
        yield spec, spec.recorded(episode, seen)


def _camera(episode: Episode, name: str | None) -> Camera:
    cameras = episode.cameras
    known = ", ".join(cameras) or "none"
    if name is None and len(cameras) != 1:
        raise DatasetError(f"{episode.name}: say which camera; there are {known}")
    if name is not None and name not in cameras:
        raise FieldError(f"{episode.name}: no camera {name!r}; there are {known}")
    camera = cameras[name or next(iter(cameras))]
    for field in ("depth", "depth_scale"):
        if not camera.has(field):
            raise FieldError(f"{episode.name}: camera {camera.name} was recorded without {field}")
    return camera
