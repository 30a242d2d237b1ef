"""The replay buffer: the agent's own episodes and demonstrations, sampled by priorities from the TD errors."""

import operator
from collections.abc import Collection, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, UsageError
from svfl_data.replay import demos, saving
from svfl_data.replay.batches import Cuts
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.episode_builder import EpisodeBuilder
from svfl_data.replay.priorities import Priorities
from svfl_data.replay.ring import Ring
from svfl_data.replay.specs.recorded_spec import RecordedSpec
from svfl_data.replay.specs.replay_spec import ReplaySpec
from svfl_data.replay.specs.spec import Observation, Spec
from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.sampling.batch import Batch
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.input_spec import InputSpec

CAPACITY = 50_000
"""Default capacity, in transitions; with images of 76 x 76 pixels, a full buffer takes 1.5 GB."""


class ReplayBuffer:
    """Replay buffer of whole episodes, with images as integers, and each frame and each wrench reading stored once.

    Transitions that are drawn more often than others would bias the training. The weights of a batch correct this bias:
    multiply the loss of each transition by its ``weight`` before the mean, as in ``(weight * td_error**2).mean()``, and
    pass the unweighted TD errors to `update_priorities` with ``index``. The target of transition i is ``reward[i] +
    discount[i] * value(s'[i])``.

    Args:
        capacity: Largest number of transitions. When further transitions would exceed it, the oldest episodes are
            removed as a whole.
        spec: Properties that all episodes of the buffer have in common: a `ReplaySpec` of the paper's inputs, or a
            `RecordedSpec` of any others.
        config: Settings of the priorities and of the batches; the defaults of `ReplayConfig` if None.

    Raises:
        UsageError: If the capacity is not positive, or crops are larger than the images.

    Example:
        >>> buffer = ReplayBuffer.from_demos(dataset, episodes=2, capacity=100, config=ReplayConfig(crop=12))
        >>> len(buffer), buffer.sample(8)["action"].shape
        (40, (8, 5))
    """

    def __init__(self, capacity: int, spec: Spec, config: ReplayConfig | None = None) -> None:
        self.capacity, self.spec, self.config = operator.index(capacity), spec, config or ReplayConfig()
        if capacity < 1:
            raise UsageError(f"capacity is {capacity}; it must be at least 1")
        self.layout = spec.layout(self.config)
        self.layout.require_crop(self.config.crop, self.config.rotate)
        self._ring, self._priorities = Ring(self.capacity), Priorities(self.capacity, self.config)
        self._cuts = Cuts(self.layout, self.config)
        self._rng = np.random.default_rng(self.config.seed)
        self._powers = self.config.gamma ** np.arange(self.config.n_step + 1)
        self._builder: EpisodeBuilder | None = None

    @classmethod
    def from_demos(
        cls,
        dataset: Dataset,
        episodes: int | Sequence[int] = 50,
        capacity: int = CAPACITY,
        config: ReplayConfig | None = None,
        failures: bool = False,
        camera: str | None = None,
        inputs: InputSpec | None = None,
        action: str = ACTION,
        invariant: Collection[str] = (),
    ) -> "ReplayBuffer":
        """Create a buffer that holds demonstrations, which count as expert transitions.

        Args:
            dataset: Dataset to read the demonstrations from.
            episodes: Number of episodes to take, in the order of their indices; or the indices to choose from, such as
                ``split["train"]``. Episodes without success are skipped unless `failures` is true.
            capacity: Largest number of transitions in the buffer.
            config: Settings of the priorities and of the batches; the defaults of `ReplayConfig` if None.
            failures: Whether to take episodes without success as well.
            camera: Name of the camera of the paper's inputs. May be None if the episodes have only one camera.
            inputs: What is taken at each observation, as in `Samples`; then images are whole without
                `config` (one that is given says it itself: ``ReplayConfig(crop=None)``), and all values are as
                recorded. None for the paper's inputs: an image of
                one RGB-D camera, the last readings of the wrench, and proprioception.
            action: Path of the action, if `inputs` are given.
            invariant: Paths of inputs, or ``cameras/NAME``, that stay as they are when a transition is rotated: sensors
                on the gripper, cameras without a pose, and what has no direction. The images of a camera that moves
                stay without being named; its image axes are rotated.

        Raises:
            UsageError: If the demonstrations do not fit into the capacity, the crops do not fit into the images, an
                episode is named twice, or transitions are to be rotated, but an input does not say how it transforms.
            DatasetError: If there are too few episodes, an episode is unfit for training, lacks the camera or has
                several while `camera` is None, a stream has another rate than its window, or two episodes differ in
                task, image size, depth scale, camera, workspace, declarations or action bounds.
            FieldError: If an episode lacks a field.
            FormatError: If an episode is damaged.
        """
        chosen = demos.choose(dataset, episodes, failures)
        steps = sum(len(dataset.episode(index)) for index in chosen)
        if steps > capacity:
            raise UsageError(
                f"{dataset.path}: {len(chosen)} demonstrations have {steps} steps, the capacity is {capacity}; "
                "choose a larger capacity or fewer demonstrations"
            )
        source = demos.source(dataset, chosen[0], camera, inputs, action, invariant)
        config = config or ReplayConfig(crop=None if inputs else ReplayConfig.crop)
        buffer: ReplayBuffer | None = None
        for spec, stored in demos.read(dataset, chosen, source):
            if buffer is None:
                buffer = cls(capacity, spec, config)
            buffer._append(stored(buffer.layout))
        assert buffer is not None, "at least one was chosen"
        return buffer

    def __len__(self) -> int:
        return len(self._ring)

    def __repr__(self) -> str:
        episodes = self._ring.episodes
        expert = sum(len(episode) for episode in episodes if episode.expert)
        return (
            f"ReplayBuffer({self.spec.task}: {len(self)} of {self.capacity} transitions in {len(episodes)} episodes, "
            f"{expert} of experts, {self.nbytes / 1e6:.1f} MB, beta {self.beta:.3f})"
        )

    @property
    def nbytes(self) -> int:
        """Memory that the episodes and the priorities take, [bytes]; free slots take no memory for episodes."""
        used = sum(episode.nbytes for episode in self._ring.episodes)
        return used + self._priorities.tree.nbytes + self._priorities.expert.nbytes

    @property
    def beta(self) -> float:
        """Current exponent of the importance weights, which grows from `ReplayConfig.beta` to 1."""
        return self._priorities.beta

    def begin_episode(self, observation: Observation, expert: bool = False, spec: Spec | None = None) -> None:
        """Begin to add an episode.

        Args:
            observation: Observation after the reset, in base axes. Of the paper's inputs as the environments of
                `collectors.environment` give it: ``image`` (4, H, W), RGB 0..1 and depth in [m]; ``wrench`` (T, 6), the
                last readings, tared; ``proprio`` (5,). Of any other inputs one row of what `cut_steps` gives, by
                dataset path, also the image axes of cameras that move; the padding and the age of streams may be
                missing.
            expert: Whether the episode is a demonstration.
            spec: Spec of the observations, such as `ReplaySpec.of_environment`, which must equal the spec of the
                buffer. None skips this check.

        Raises:
            DatasetError: If `spec` differs from the spec of the buffer, such as in view, camera, task or action bounds.
            UsageError: If the last step of the previous episode was neither terminated nor truncated.
            FieldError: If an array of the observation is missing or has a wrong shape or value.
        """
        if spec is not None:
            self.spec.require_equal(spec, "the replay buffer", "the environment")
        if self._builder is not None and len(self._builder):
            raise UsageError(
                f"the last episode has not ended after {len(self._builder)} steps; its last step must be terminated or "
                "truncated"
            )
        self._builder = EpisodeBuilder(self.spec, self.layout, observation, expert)

    def add(
        self, action: np.ndarray, observation: Observation, reward: float, terminated: bool, truncated: bool
    ) -> None:
        """Add a step of the current episode: ``buffer.add(action, *env.step(action)[:4])``.

        The transitions of an episode can be sampled once the episode has ended.

        Args:
            action: Commanded action, shape (C,), base axes.
            observation: Observation after the action, as for `begin_episode`.
            reward: Reward of the action.
            terminated: Whether the task ended with this step, so that the value of the next observation is 0.
            truncated: Whether the episode was cut off after this step, so that the next observation still has a value.

        Raises:
            UsageError: If no episode has begun, or the episode is longer than the capacity.
            FieldError: If the action, the observation or the reward has a wrong shape or value. The step is then not
                added.
        """
        if self._builder is None:
            raise UsageError("add before begin_episode: hand over the observation after the reset first")
        if len(self._builder) >= self.capacity:
            raise UsageError(f"an episode of more than {self.capacity} steps does not fit into the capacity")
        self._builder.add(action, observation, reward)
        if terminated or truncated:
            self._append(self._builder.finish(bool(terminated)))
            self._builder = None

    def sample(self, batch_size: int = 64) -> Batch:
        """Draw transitions by their priorities, with replacement.

        Each transition leads from an observation s to s', the observation `n_step` steps after s or the last one of the
        episode. All images of s and s' of one transition have the same random crop and the same rotation or reflection.
        Of the paper's inputs, all vectors are in image-aligned axes, and positions are relative to the workspace
        centre. Of any other inputs, all values are as recorded, by the keys of `Samples`.

        Args:
            batch_size: Number of transitions, B.

        Returns:
            Arrays by key. The observation s of the paper's inputs: ``image`` (B, 4, h, h), or (B, K, 4, h, h), latest
            last, with K > 1 ``frames``, RGB 0..1 and depth in [m]; ``wrench`` (B, T, 6); ``proprio`` (B, 5). The
            observation s': the same keys with the prefix ``next_``. The action (B, C): ``action``, or its path.
            ``reward`` (B,): discounted sum of the rewards from s to s'; ``discount`` (B,): gamma^m where s' is m steps
            after s, or 0 where the task ended at s' (not where the episode was truncated there); ``weight`` (B,):
            importance weights, of which the largest is 1. All of these are float32. ``index`` (B,) int64: number of
            each transition, for `update_priorities`; ``expert`` (B,) bool: true for transitions of demonstrations.

        Raises:
            UsageError: If `batch_size` is not positive.
            DatasetError: If the buffer is empty.
        """
        if batch_size < 1:
            raise UsageError(f"batch_size is {batch_size}; it must be at least 1")
        if not len(self):
            raise DatasetError("the replay buffer is empty: preload demonstrations, or add an episode and end it")
        slots, weight = self._priorities.draw(batch_size, self._rng)
        numbers, positions, located = self._ring.locate(slots)
        episodes, steps = [self._ring.episodes[position] for position in positions.tolist()], located.tolist()
        outcomes = [episode.outcome(step, self._powers) for episode, step in zip(episodes, steps, strict=True)]
        later, reward, discount = zip(*outcomes, strict=True)

        where = self._rng.random((batch_size, 2))
        moves = self._rng.integers(self._cuts.turns, size=batch_size)
        return self._cuts.transitions(episodes, steps, later, where, moves) | {
            "reward": np.array(reward, np.float32), "discount": np.array(discount, np.float32), "weight": weight,
            "index": numbers, "expert": self._priorities.expert[slots],
        }  # fmt: skip

    def update_priorities(self, indices: np.ndarray, td_errors: np.ndarray) -> None:
        """Set the priorities of transitions from their TD errors; transitions that were removed are ignored.

        Args:
            indices: Numbers of the transitions, the ``index`` of a batch, shape (B,).
            td_errors: Unweighted TD errors of the transitions, shape (B,). Their signs do not matter.

        Raises:
            UsageError: If the shapes differ, an index is of no transition so far, or a TD error is not finite.
        """
        numbers, errors = np.asarray(indices), np.asarray(td_errors, np.float64)
        if numbers.ndim != 1 or numbers.shape != errors.shape or numbers.dtype.kind not in "iu":
            raise UsageError(f"{numbers.dtype} indices {numbers.shape} and TD errors {errors.shape}; both must be (B,)")
        if not np.isfinite(errors).all():
            raise UsageError(f"{(~np.isfinite(errors)).sum()} of {len(errors)} TD errors are not finite numbers")
        if ((numbers < 0) | (numbers >= self._ring.next)).any():
            raise UsageError(f"no transitions {numbers.min()} to {numbers.max()}; there have been {self._ring.next}")
        kept = numbers >= self._ring.first
        self._priorities.update(numbers[kept] % self.capacity, errors[kept])

    def save(self, path: Path | str) -> None:
        """Save the transitions, the priorities, the random state and beta; an episode that has not ended is left out.

        Args:
            path: File to write; replaced if it exists.

        Raises:
            StorageError: If the file cannot be written. A file that existed before is then unchanged.
        """
        ring, priorities = self._ring, self._priorities
        header = {
            "capacity": self.capacity, "spec": self.spec.plain(), "config": asdict(self.config),
            "first": ring.first, "drawn": priorities.drawn, "largest": priorities.largest,
            "random": self._rng.bit_generator.state,
            "episodes": [{"terminated": one.terminated, "expert": one.expert} for one in ring.episodes],
        }  # fmt: skip
        slots = np.arange(ring.first, ring.next) % self.capacity
        arrays = [("priority", priorities.tree[slots])]
        arrays += [(f"{n}/{name}", array) for n, one in enumerate(ring.episodes) for name, array in one.arrays.items()]
        saving.write(Path(path), header, arrays)

    @classmethod
    def load(cls, path: Path | str, spec: Spec | None = None) -> "ReplayBuffer":
        """Load a saved buffer, which draws the same batches as the buffer that was saved would have drawn.

        Args:
            path: File from `save`.
            spec: Spec that the saved buffer must have; None accepts every spec.

        Raises:
            DatasetError: If the saved buffer has another spec, such as other inputs.
            FormatError: If the file is missing, damaged, not a saved replay buffer, or has another format version.
        """
        with saving.reading(Path(path)) as saved:
            header, kind = saved.header, RecordedSpec if "inputs" in saved.header["spec"] else ReplaySpec
            found: Spec = kind.of_json(header["spec"])
            if spec is not None:
                spec.require_equal(found, "the spec asked for", str(path))
            buffer = cls(saved.count("capacity"), found, ReplayConfig(**header["config"]))
            buffer._ring = Ring(buffer.capacity, saved.count("first"))
            for number, one in enumerate(header["episodes"]):
                arrays = {name: saved.array(f"{number}/{name}") for name in buffer.layout.names()}
                recorded = StoredEpisode(arrays, terminated=one["terminated"], expert=one["expert"])
                recorded.require_fit(buffer.layout)
                buffer._append(recorded)
            slots = np.arange(buffer._ring.first, buffer._ring.next) % buffer.capacity
            buffer._priorities.restore(slots, saved.array("priority"), saved.count("drawn"), header["largest"])
            buffer._rng.bit_generator.state = header["random"]
            return buffer

    def _append(self, recorded: StoredEpisode) -> None:
        freed, taken = self._ring.append(recorded)
        self._priorities.clear(freed)
        self._priorities.welcome(taken, recorded.expert)
