"""Training samples from a dataset: the images, windows of streams and vectors at a step, and the actions from it on.

All values are as recorded, in the units and axes of ``data/README.md``. Colour stays uint8 and depth stays uint16, so
that little memory is copied until a batch reaches the device that uses it. Each key of a batch is the path of the field
that the values were taken from.
"""

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar

import numpy as np

from svfl_data.checks import check_usable
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, UsageError
from svfl_data.recording.consistency import check_agreement
from svfl_data.sampling.batch import Batch, age_key, axes_key, padding_key
from svfl_data.sampling.frames import Frames, corners, draws
from svfl_data.sampling.named_camera import named_camera
from svfl_data.sampling.ragged import join, rows_of, starts
from svfl_data.sampling.sample_checks import checked_values, require_memory, require_shapes
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.clocks import Clock
from svfl_data.schema.input_spec import ACTIONS, EXPERT_ACTION, InputSpec, Window
from svfl_data.schema.input_spec import PROPRIO as PROPRIO  # imported for users of this module
from svfl_data.schema.input_spec import WRENCH as WRENCH
from svfl_data.signals.camera_poses import camera_poses, frame_axes, moves, pose_paths
from svfl_data.system.progress import progress

TIMES = "observations/t_ns"
Values = TypeVar("Values", bound=Any)


class Samples:
    """Samples of a dataset, numbered from 0: ``samples[i]`` is one sample, ``samples.batch(indices)`` is a batch.

    A sample at step t consists of these entries, whose keys are those of a batch (shapes begin with the batch size B):

    - ``cameras/NAME/color`` (B, K, h, w, 3) uint8, ``cameras/NAME/depth`` (B, K, h, w) uint16, and likewise other
      images of the camera: the last K frames at or before the observation, latest last;
      ``cameras/NAME/depth_scale`` (B,): metres per unit of depth. Of a camera that moves, and whose pose is known,
      ``cameras/NAME/image_axes`` (B, K, 2, 2) float32: matrix from base (x, y) to image (right, up) at each frame.
    - ``streams/wrench/wrench`` (B, T, 6) float32, [N] and [N m], and likewise each array with a window: the last T
      readings at or before the observation, minus the ``tare`` of the group if it has one.
    - ``observations/proprio`` (B, 5) float32, and likewise each vector, as recorded.
    - ``actions/action`` (B, A, 5) float32, and likewise each action: the actions of steps t .. t+A-1.
    - ``.../padding`` of each camera, of each group of windows and of the actions, (B, K), (B, T), (B, A) bool: true
      where the episode had no frame or reading yet, or has no further action. The nearest frame, reading or action of
      the episode is repeated there, or zeros are given if there is none. Also true where a frame or reading is from
      before a break in its stream: a declared gap, or more than 10 periods without a frame or reading
      (`svfl_data.schema.clocks.Clock`).
    - ``.../age`` of each camera and of each group of windows, (B,) float32: time from the newest frame or reading to
      the observation, [s]; infinite if there is no frame or reading yet.
    - The fields that `labels` names, and ``episode`` and ``step`` (B,) int64: index of the sample's episode and number
      of its observation.

    Pickling, as for worker processes that are not forked, stores only the settings; the copy reads the files again.

    Attributes:
        inputs: What is taken at each observation.
        actions: Paths of the actions that are given.

    Example:
        >>> samples = Samples(dataset, frames=2, action_chunk=4)
        >>> batch = samples.batch([0, 1, 2])
        >>> batch["streams/wrench/wrench"].shape, batch["actions/action"].shape
        ((3, 64, 6), (3, 4, 5))
    """

    inputs: InputSpec
    actions: list[str]

    def __init__(
        self,
        dataset: Dataset,
        episodes: Sequence[int] | None = None,
        *,
        at: Literal["each action", "the end"] = "each action",
        cameras: Sequence[str] | None = None,
        frames: int = 1,
        windows: Mapping[str, Window | int] | None = None,
        vectors: Sequence[str] | None = None,
        actions: Sequence[str] | None = None,
        action_chunk: int = 1,
        expert_action: bool = False,
        crop: int | None = None,
        crop_at: Literal["centre", "random"] = "centre",
        labels: Sequence[str] = (),
        cache: bool = False,
        budget: int | None = None,
        seed: int = 0,
        validated: bool = True,
    ) -> None:
        """Find the samples, and read all fields except the images (the images too with `cache`).

        Args:
            dataset: Dataset to read the samples from.
            episodes: Indices of the episodes to sample from, such as ``split["train"]``. All episodes by default.
            at: Observations to sample at: ``each action`` gives one sample at each observation that an action follows,
                ``the end`` gives one sample at the last observation of each episode.
            cameras: Names of the cameras to read. The cameras of the first episode by default.
            frames: Number of frames per camera in each sample, K, at least 1.
            windows: Window of each stream, or its number of readings T, by the path of the array, such as
                ``{"streams/wrench/wrench": Window(64, rate_hz=500)}``. By default 64 readings of every array called
                ``wrench``, and the latest reading of every other stream of the user's own.
            vectors: Paths of the arrays below ``observations/`` to read. All of them by default.
            actions: Paths of the actions to read. All but ``actions/expert_action`` by default.
            action_chunk: Number of actions in each sample, A, at least 1.
            expert_action: Whether to give the actions that the expert intended (``actions/expert_action``) instead of
                the commanded actions, in the episodes that have both.
            crop: Height and width of the square cut out of each image, [px]. Whole images by default.
            crop_at: Position of the crop: ``centre``, or ``random``, which is drawn from `seed`, the epoch and the
                number of the sample.
            labels: Paths of fields that have one value per episode, such as ``labels/direction`` or ``workspace``.
            cache: Whether to keep the images in memory as well.
            budget: Largest memory that the samples may take, [bytes]. Half of the machine's memory by default.
            seed: Seed of the random crops.
            validated: Whether to refuse episodes in whose fields ``svfl-data validate`` finds an error.

        Raises:
            UsageError: If a size is too small, or the crop is larger than the images.
            DatasetError: If there are no samples or no camera of such a name, an episode is unfit for training,
                episodes differ in their setup or in the shapes of their fields, a stream has another rate than its
                window, or the budget is too small.
            FieldError: If an episode lacks a field.
            FormatError: If an episode is damaged.
        """
        if action_chunk < 1:
            raise UsageError(f"action_chunk is {action_chunk}; it must be at least 1")
        self.dataset, self.episodes = dataset, list(dataset.indices if episodes is None else episodes)
        if not self.episodes:
            raise DatasetError(f"{dataset.path}: no episodes to take samples from")
        first = dataset.episode(self.episodes[0])
        self.inputs = InputSpec.of(first.paths, first.declarations, cameras, frames, windows, vectors)
        recorded = [path for path in first.paths if path.startswith(ACTIONS) and path != EXPERT_ACTION]
        self.actions = list(recorded if actions is None else actions)
        self.at, self.labels = at, list(labels)
        self.action_chunk, self.expert_action = action_chunk, expert_action
        self.crop, self.crop_at, self.seed = crop, crop_at, seed
        self.cache = cache
        self.budget = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2 if budget is None else budget
        self._load(validated)

    def __len__(self) -> int:
        return len(self._step)

    def __getitem__(self, index: int) -> Batch:
        """Return one sample, without the batch dimension."""
        position = index + len(self) if index < 0 else index
        if not 0 <= position < len(self):
            raise IndexError(f"no sample {index}; there are {len(self)}")
        return {key: values[0] for key, values in self.batch([position]).items()}

    def __getitems__(self, indices: Sequence[int]) -> list[Batch]:
        """Return a list of samples, as PyTorch's loaders request it; `batch` returns them as one batch."""
        return apart(self.batch(indices), len(indices))

    def batch(self, indices: Sequence[int] | np.ndarray, epoch: int = 0) -> Batch:
        """Return several samples as one batch.

        Args:
            indices: Numbers of the samples, shape (B,), each in 0 .. len - 1.
            epoch: Number of the epoch, which changes the random crops.

        Returns:
            Arrays by key, as described in the class. The arrays are copies that may be changed.
        """
        chosen = np.asarray(indices, dtype=np.int64)
        episode = self._episode[chosen]
        out = {"episode": self._index[episode], "step": self._step[chosen]}
        for path, values in self._constants.items():
            out[path] = values[episode]
        for path in self.inputs.vectors:
            out[path] = self._values[path][self._observation[chosen]]
        for group, window in self.inputs.groups.items():
            rows, out[padding_key(group)] = self._rows[group].last(chosen, window.length)
            out[age_key(group)] = self._rows[group].age[chosen]
            for path in self.inputs.windows:
                if path.rpartition("/")[0] == group:
                    out[path] = self._values[path][rows]
        rows, out[padding_key("actions")] = self._action_rows(chosen)
        for path in self.actions:
            out[path] = self._values[path][rows]
        fraction = draws(self.seed, epoch, chosen) if self.crop_at == "random" else None
        for camera in self.inputs.cameras:
            group = f"cameras/{camera}"
            rows, out[padding_key(group)] = self._rows[group].last(chosen, self.inputs.frames)
            out[age_key(group)] = self._rows[group].age[chosen]
            if group in self._axes:
                out[axes_key(group)] = self._axes[group][rows]
            for path, images in self._images.items():
                if path.startswith(f"{group}/"):
                    height, width = self._sizes[path]
                    size = (self.crop, self.crop) if self.crop else (height, width)
                    out[path] = images.cut(episode, rows, corners(height, width, size, fraction), size)
        return out

    def _action_rows(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the next actions of each sample, shape (B, A), and a mask that is true beyond the last."""
        begin, end = (bound[self._episode[chosen], None] for bound in self._actions)
        rows = begin + self._step[chosen, None] + np.arange(self.action_chunk)
        padding = rows >= end
        return np.where(padding, np.where(end > begin, end - 1, 0), rows), padding

    def _load(self, validated: bool = False) -> None:
        readers = [self.dataset.episode(index) for index in self.episodes]
        cameras = [f"cameras/{camera}" for camera in self.inputs.cameras]
        check_agreement(self.dataset, self.episodes, self.inputs.cameras)
        first = readers[0]
        groups = [*self.inputs.groups, *cameras]
        for camera in self.inputs.cameras:
            named_camera(first.cameras, camera, first.extent)
        for path in self.inputs.windows:
            if (declared := first.declarations.at(path)) and not declared.grows:
                raise FieldError(f"{first.extent}: {path} is one value per episode, which has no window")
        images = [path for one in self.inputs.cameras for path in first.declarations.image_paths(one, first.paths)]
        tares = [f"{group}/tare" for group in self.inputs.groups if f"{group}/tare" in first]
        scales = [f"{group}/depth_scale" for group in cameras if f"{group}/depth" in images]
        needed = [TIMES, *self.inputs.vectors, *self.actions, *self.inputs.windows, *tares, *self.labels, *scales]
        needed += [*images, *(f"{group}/t_ns" for group in groups)]
        moving = {group: pose_paths(first.paths, one) for group, one in zip(cameras, self.inputs.cameras, strict=True)
                  if moves(first.paths, one)}  # fmt: skip
        needed += [path for paths in moving.values() for path in paths if path not in needed]
        stored = [{path: reader[path] for path in needed} for reader in progress(readers, "opening episodes")]
        if self.expert_action and ACTION in self.actions:
            for of_episode, reader in zip(stored, readers, strict=True):
                of_episode[ACTION] = reader[EXPERT_ACTION if EXPERT_ACTION in reader else ACTION]
        require_shapes(stored, self.labels, images, self.crop)
        require_memory(stored, images, self.cache, self.budget, self.dataset.path)
        if validated:
            poses = (path.rpartition("/")[0] for paths in moving.values() for path in paths)
            check_usable(self.dataset, self.episodes, [*groups, *self.labels, *poses])
        arrays = {path: [of_episode[path] for of_episode in stored] for path in needed}
        self._sizes = {path: stored[0][path].shape[1:3] for path in images}
        self._images = {path: Frames.of(arrays[path], self.cache) for path in images}
        values = {path: [checked_values(array) for array in arrays[path]] for path in needed if path not in images}
        times = values[TIMES]
        action_counts = [len(piece) - 1 for piece in times]
        steps = [np.arange(count) if self.at == "each action" else np.array([count]) for count in action_counts]
        now_ns = [t_ns[step] for t_ns, step in zip(times, steps, strict=True)]
        self._index = np.array(self.episodes, dtype=np.int64)
        self._episode = np.repeat(np.arange(len(steps)), [len(step) for step in steps])
        self._step = np.concatenate(steps).astype(np.int64)
        if not len(self._step):
            raise DatasetError(f"{self.dataset.path}: the episodes have no steps to take samples from")
        self._observation = starts([len(t_ns) for t_ns in times])[self._episode] + self._step
        begin = starts(action_counts)
        self._actions = begin, begin + action_counts
        self._values = {path: join(values[path]) for path in (*self.inputs.vectors, *self.actions)}
        for path in self.inputs.windows:
            tare = values.get(f"{path.rpartition('/')[0]}/tare")
            pieces = values[path] if tare is None else map(_tared, values[path], tare)
            self._values[path] = join(list(pieces))
        metas = [reader.meta for reader in readers]
        self._rows = {}
        for group in groups:
            clocks = [Clock.of(meta, group) for meta in metas]
            window = self.inputs.groups.get(group, Window())
            self._rows[group] = rows_of(values[f"{group}/t_ns"], now_ns, clocks, window, group, readers)
        self._axes = {group: _axes(group, values, [*paths, f"{group}/t_ns"]) for group, paths in moving.items()}
        self._constants = {path: np.stack(values[path]) for path in (*self.labels, *scales)}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if not name.startswith("_")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._load()

    def __repr__(self) -> str:
        size = sum(values.nbytes for values in self._values.values())
        size += sum(images.memory.nbytes for images in self._images.values() if images.memory is not None)
        windows = [f"{window.length} of {path}" for path, window in self.inputs.windows.items()]
        return (
            f"Samples({self.dataset.path}: {len(self)} at {self.at} of {len(self.episodes)} episodes, "
            f"{self.inputs.frames} frames of {', '.join(self.inputs.cameras) or 'no camera'}, readings: "
            f"{', '.join(windows) or 'none'}, {self.action_chunk} of {', '.join(self.actions)}, "
            f"{size / 1e6:.1f} MB in memory)"
        )


def apart(batch: Mapping[str, Values], count: int) -> list[dict[str, Values]]:
    """Split a batch into its samples, each without the batch dimension.

    Args:
        batch: Values by key; the first axis of each value is the batch dimension.
        count: Number of samples in the batch.
    """
    return [{key: values[row] for key, values in batch.items()} for row in range(count)]


def _tared(readings: np.ndarray, tare: np.ndarray) -> np.ndarray:
    return (readings - tare).astype(readings.dtype) if tare.shape == readings.shape[1:] else readings


def _axes(group: str, values: Mapping[str, list[np.ndarray]], needed: Sequence[str]) -> np.ndarray:
    """Return the matrices from base (x, y) to image (right, up) of a camera that moves, joined as its frames are."""
    camera, clock = group.removeprefix("cameras/"), f"{group}/t_ns"
    pieces = [dict(zip(needed, of_episode, strict=True)) for of_episode in zip(*map(values.get, needed), strict=True)]
    axes = [frame_axes(camera_poses(arrays, camera, arrays[clock])) for arrays in pieces]
    return np.concatenate([np.eye(2)[None], *axes]).astype(np.float32)
