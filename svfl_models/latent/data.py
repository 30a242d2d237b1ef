"""Sequences of frames and actions, cut from whole episodes for a whole batch at once."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import Sampler

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.frames import corners, draws
from svfl_data.sampling.split import Split, load_split, split_episodes
from svfl_models.latent.config import PRESETS, LatentConfig
from svfl_models.latent.inputs import IMAGE_SIZE, Batch, Inputs
from svfl_models.latent.recordings import Recording, load_recordings

SHARES = {"train": 0.8, "valid": 0.2}
IMAGES = 256
"""So many images, from all over the episodes, give the statistics of all."""
SPLIT_SEED = 0
"""A constant: whatever the seed of a training, its validation episodes are the same."""


class Sequences(TorchDataset[Batch]):
    """Every stretch of S actions in the given episodes, as batches, asked for with lists of keys.

    A batch, with T = S + 1 frames: ``image`` (B, T, 4, 64, 64), colour 0..1 and depth in [m], the same crop in all
    frames of a sequence; ``wrench`` (B, T, 64, 6); ``proprio`` (B, T, 5); ``action`` and ``reward`` (B, S, ...);
    ``terminated`` (B, S), whether the task was achieved then; ``contact`` (B, T), whether the force exceeds the
    threshold; ``next_contact`` (B, S), whether there is contact until the next frame; ``touching`` (B, T), either of
    the two; ``episode`` (B,) and ``step`` (B, T).

    Key k is sequence k % len in its pass k // len: each pass has other random crops.

    Args:
        recordings: The episodes; those of fewer than S steps have no sequence.
        actions: S.
        random: Crop at random (training) rather than in the middle.
        seed: Of the crops.

    Raises:
        DatasetError: If no episode is long enough.
    """

    def __init__(self, recordings: Sequence[Recording], actions: int, random: bool, seed: int = 0) -> None:
        self.recordings, self.actions, self.random, self.seed = list(recordings), actions, random, seed
        self.starts = [
            (place, start) for place, one in enumerate(recordings) for start in range(len(one) - actions + 1)
        ]
        if not self.starts:
            longest = max((len(one) for one in recordings), default=0)
            raise DatasetError(
                f"a sequence has {actions} actions, the longest of {len(self.recordings)} episodes has {longest}; "
                "choose a shorter --sequence"
            )

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def left_out(self) -> int:
        """Episodes that are too short."""
        return sum(len(one) < self.actions for one in self.recordings)

    def __getitem__(self, keys: Sequence[int]) -> Batch:
        """The sequences of `keys` as one batch."""
        chosen = np.asarray(keys, dtype=np.int64)
        fraction = draws(self.seed, 0, chosen) if self.random else None  # the key includes the pass
        height, width = self.recordings[0].color.shape[1:3]
        places = np.broadcast_to(corners(height, width, (IMAGE_SIZE, IMAGE_SIZE), fraction), (len(chosen), 2))
        cut = [
            self._sequence(self.starts[key % len(self)], int(top), int(left))
            for key, (top, left) in zip(chosen.tolist(), places, strict=True)
        ]
        batch = {name: torch.from_numpy(np.stack([one[name] for one in cut])) for name in cut[0]}
        color = batch.pop("color").movedim(-1, 2).float() / 255
        return batch | {"image": torch.cat([color, batch.pop("depth")[:, :, None]], dim=2)}

    def _sequence(self, where: tuple[int, int], top: int, left: int) -> dict[str, np.ndarray]:
        one, start = self.recordings[where[0]], where[1]
        frames, steps = slice(start, start + self.actions + 1), slice(start, start + self.actions)
        crop = (frames, slice(top, top + IMAGE_SIZE), slice(left, left + IMAGE_SIZE))
        ends = np.arange(start + 1, start + self.actions + 1) == len(one)
        before = np.concatenate([[False], one.touched])[frames]
        return {
            "color": one.color[crop],
            "depth": one.depth[crop],
            "wrench": one.readings[one.windows[frames]],
            "proprio": one.proprio[frames],
            "action": one.action[steps],
            "reward": one.reward[steps],
            "terminated": ends & one.terminated,
            "contact": one.pressed[frames].astype(np.float32),
            "next_contact": one.touched[steps].astype(np.float32),
            "touching": one.pressed[frames] | before,
            "episode": np.asarray(one.index),
            "step": np.arange(start, start + self.actions + 1),
        }


class Leg(Sampler[list[int]]):
    """The batches of some steps of a training: they follow from the seed and the number of the step alone.

    Passes through the data in new orders are laid end to end; step k takes the k-th batch of them.

    Args:
        sequences: How many there are.
        batch_size: Sequences per step.
        seed: Of the orders.
        steps: Which steps.
    """

    def __init__(self, sequences: int, batch_size: int, seed: int, steps: range) -> None:
        self.sequences, self.batch_size, self.seed, self.steps = sequences, batch_size, seed, steps

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[list[int]]:
        orders: dict[int, np.ndarray] = {}
        for step in self.steps:
            keys = []
            for position in range(step * self.batch_size, (step + 1) * self.batch_size):
                turn, place = divmod(position, self.sequences)
                if turn not in orders:
                    orders = {turn: np.random.default_rng([self.seed, turn]).permutation(self.sequences)}
                keys.append(int(orders[turn][place]) + turn * self.sequences)
            yield keys


def sequences_of(config: LatentConfig) -> tuple[Sequences, Sequences, Split]:
    """Training and validation sequences of a dataset, from different episodes.

    Raises:
        SvflError: If the data cannot serve.
    """
    dataset = Dataset.open(config.data)
    recordings = {one.index: one for one in load_recordings(dataset, config.contact_n, config.mixed)}
    split = load_split(dataset, config.split) if config.split else _drawn(dataset, sorted(recordings))
    held_out = "valid" if "valid" in split.parts else "test"
    train = Sequences([recordings[index] for index in split["train"]], config.sequence, True, config.seed)
    valid = Sequences([recordings[index] for index in split[held_out]], config.sequence, False)
    _check_labels(train, config)
    return train, valid, split


def _drawn(dataset: Dataset, indices: list[int]) -> Split:
    try:
        return split_episodes(indices, SHARES, SPLIT_SEED)
    except DatasetError as error:
        raise DatasetError(f"{dataset.path}: {error}") from error


def _check_labels(train: Sequences, config: LatentConfig) -> None:
    """Refuse to learn what never changes in the training episodes."""
    wanted = PRESETS[config.preset].weights
    force = [np.linalg.norm(one.readings[one.windows[:, -1], :3], axis=1) for one in train.recordings]
    values = {
        "reward": ([one.reward for one in train.recordings], "none of them succeeded"),
        "contact": (
            [one.pressed for one in train.recordings],
            f"the threshold is {config.contact_n:g} N, the force at an observation is "
            f"{min(map(np.min, force)):.2g} to {max(map(np.max, force)):.2g} N; choose another --contact-n",
        ),
        "next_contact": (
            [one.touched for one in train.recordings],
            "svfl-data relabel --contact annotates contacts by a rule of your choice",
        ),
    }
    for name, (labels, words) in values.items():
        joined = np.concatenate(labels)
        if wanted[name] > 0 and joined.min() == joined.max():
            raise DatasetError(
                f"{config.data}: {name} is {joined[0]:g} in every step of the {len(train.recordings)} training "
                f"episodes, so preset {config.preset} cannot learn it; {words}"
            )


def fit(inputs: Inputs, recordings: Sequence[Recording]) -> None:
    """Take the statistics of the training episodes."""
    stride = max(1, sum(map(len, recordings)) // IMAGES)
    color, depth = (np.concatenate([getattr(one, name) for one in recordings])[::stride] for name in ("color", "depth"))
    depth = np.where(depth > 0, depth, depth[depth > 0].mean() if depth.any() else 0)  # 0: not measured
    image = np.concatenate([color.astype(np.float32) / 255, depth[..., None]], axis=-1)  # (N, H, W, 4)
    wrench = np.concatenate([one.readings[one.windows] for one in recordings])
    inputs.fit(image.transpose(0, 3, 1, 2), wrench, np.concatenate([one.proprio for one in recordings]))
