"""Demonstrations read from episode files, in the form in which a replay buffer stores them."""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from numbers import Integral

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, UsageError
from svfl_data.recording.consistency import check_agreement
from svfl_data.replay.specs.layout import Layout
from svfl_data.replay.specs.recorded_episode import recorded_episode
from svfl_data.replay.specs.recorded_spec import RecordedSpec
from svfl_data.replay.specs.replay_spec import ReplaySpec
from svfl_data.replay.specs.spec import Spec
from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.sampling.named_camera import camera_with_depth, named_camera
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import InputSpec
from svfl_data.signals.camera_poses import moves, pose_paths
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


@dataclass(frozen=True)
class Source:
    """What is read of episodes, and how it becomes demonstrations.

    Attributes:
        cameras: Names of the cameras whose images are read.
        streams: Groups of the streams that are read, also for the poses of cameras.
        opened: Function that returns the spec of an episode, and a function that converts it for a layout.
    """

    cameras: Collection[str]
    streams: Collection[str]
    opened: Callable[[Episode], tuple[Spec, Callable[[Layout], StoredEpisode]]]


def source(
    dataset: Dataset,
    first: int,
    camera: str | None,
    inputs: InputSpec | None,
    action: str,
    invariant: Collection[str],
) -> Source:
    """Return the source of demonstrations; the arguments are those of `ReplayBuffer.from_demos`.

    Args:
        dataset: Dataset to read from.
        first: Index of the first episode.
        camera: Name of the camera of the paper's inputs.
        inputs: What is taken at each observation; None for the paper's inputs.
        action: Path of the action.
        invariant: Inputs that stay when a transition is rotated.

    Raises:
        UsageError: If the arguments belong to different inputs.
    """
    if inputs is None:
        if action != ACTION or invariant:
            raise UsageError("action and invariant belong to inputs; without them the buffer has the paper's")
        return _paper(dataset, first, camera)
    if camera is not None:
        raise UsageError(f"name the camera {camera} in the inputs: InputSpec(cameras=[{camera!r}])")
    return _recorded(dataset, first, inputs, action, invariant)


def _paper(dataset: Dataset, first: int, camera: str | None) -> Source:
    """Return the source of demonstrations with the paper's inputs.

    Args:
        dataset: Dataset to read from.
        first: Index of the first episode, which has the cameras of all.
        camera: Name of the camera whose images are kept. May be None if the episodes have only one camera.
    """

    def opened(episode: Episode) -> tuple[Spec, Callable[[Layout], StoredEpisode]]:
        kept = camera_with_depth(episode, camera)
        spec = ReplaySpec.of_episode(episode, kept)
        return spec, lambda layout: spec.recorded(episode, kept)

    reader = dataset.episode(first)
    return Source([named_camera(reader.cameras, camera, reader.extent)], ["streams/wrench"], opened)


def _recorded(dataset: Dataset, first: int, inputs: InputSpec, action: str, invariant: Collection[str]) -> Source:
    """Return the source of demonstrations with any inputs and any action.

    Args:
        dataset: Dataset to read from.
        first: Index of the first episode, whose cameras move as those of all.
        inputs: What is taken at each observation.
        action: Path of the action.
        invariant: Inputs that stay when a transition is rotated.
    """

    def opened(episode: Episode) -> tuple[Spec, Callable[[Layout], StoredEpisode]]:
        spec = RecordedSpec.of_episode(episode, inputs, action, invariant)
        return spec, lambda layout: recorded_episode(episode, spec, layout)

    paths = dataset.episode(first).paths
    poses = [path for name in inputs.cameras if moves(paths, name) for path in pose_paths(paths, name)]
    return Source(inputs.cameras, [*inputs.groups, *(path.rpartition("/")[0] for path in poses)], opened)


def read(
    dataset: Dataset, indices: Sequence[int], source: Source
) -> Iterator[tuple[Spec, Callable[[Layout], StoredEpisode]]]:
    """Read episodes, which must all have the same spec.

    Args:
        dataset: Dataset to read from.
        indices: Indices of the episodes, at least one.
        source: What is read.

    Yields:
        Spec of each episode, and the function that converts the episode for a layout.

    Raises:
        DatasetError: If an episode is unfit for training, or has another spec than the first episode.
        FieldError: If an episode lacks a field.
        FormatError: If an episode is damaged.
    """
    check_usable(dataset, indices, [*source.streams, *(f"cameras/{name}" for name in source.cameras)])
    check_agreement(dataset, indices, source.cameras)
    first: Spec | None = None
    for index in progress(indices, "preloading demonstrations"):
        episode = dataset.episode(index).load(images=False)
        spec, stored = source.opened(episode)
        if first is not None:
            first.require_equal(spec, f"episode {indices[0]}", episode.name)
        first = first or spec
        yield spec, stored
