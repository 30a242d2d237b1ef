"""Batches of sequences of frames and actions, cut from whole episodes."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch.utils.data import Dataset as TorchDataset
from torch.utils.data import Sampler

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.frames import corners, draws
from svfl_data.sampling.split import Split, load_split, split_episodes
from svfl_data.signals.pictures import picture
from svfl_models.latent.config import PRESETS, LatentConfig
from svfl_models.latent.inputs import IMAGE_SIZE, Inputs
from svfl_models.latent.recordings import Recording, load_recordings
from svfl_models.symmetry.actions import Batch

SHARES = {"train": 0.8, "valid": 0.2}
IMAGES = 256
"""Approximate number of images, spread evenly over all episodes, that the image statistics are computed from."""
SPLIT_SEED = 0
"""Seed of the drawn split. It is a constant, so that the validation episodes are the same whatever the seed of a
training."""


class Sequences(TorchDataset[Batch]):
    """Dataset of all sequences of S consecutive actions in the given episodes; lists of keys give batches.

    A batch has these entries, with T = S + 1 frames per sequence: ``image`` (B, T, 4, 64, 64), colour 0..1 and depth in
    [m], with the same crop in all frames of a sequence; ``wrench`` (B, T, 64, 6); ``proprio`` (B, T, 5); ``action`` (B,
    S, 5) and ``reward`` (B, S); ``terminated`` (B, S), whether the episode ended with success after the action;
    ``contact`` (B, T), 1 if the force exceeds the threshold; ``next_contact`` (B, S), 1 if there is contact between the
    frame and the next one; ``touching`` (B, T), whether the force exceeds the threshold or there was contact between
    the frame before and this one; ``episode`` (B,), index of the episode; ``step`` (B, T), number of the frame in its
    episode.

    Key k is sequence k % len in pass k // len through the data; each pass has other random crops.

    Args:
        recordings: Episodes to cut the sequences from; an episode of fewer than S steps has no sequence.
        actions: Number S of actions per sequence.
        random: Whether crops lie at random positions, as in training, or in the middle of the image.
        seed: Seed of the random crops.

    Raises:
        DatasetError: If no episode has S steps.
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
        """Number of episodes that are too short for a sequence."""
        return sum(len(one) < self.actions for one in self.recordings)

    def __getitem__(self, keys: Sequence[int]) -> Batch:
        """Return the sequences of `keys` as one batch."""
        chosen = np.asarray(keys, dtype=np.int64)
        fraction = draws(self.seed, 0, chosen) if self.random else None  # the key includes the pass
        height, width = self.recordings[0].color.shape[1:3]
        places = np.broadcast_to(corners(height, width, (IMAGE_SIZE, IMAGE_SIZE), fraction), (len(chosen), 2))
        cut = [
            self._sequence(self.starts[key % len(self)], int(top), int(left))
            for key, (top, left) in zip(chosen.tolist(), places, strict=True)
        ]
        batch = {name: np.stack([one[name] for one in cut]) for name in cut[0]}
        batch["image"] = picture({name: batch.pop(name) for name in ("color", "depth")})
        return {name: torch.from_numpy(values) for name, values in batch.items()}

    def _sequence(self, where: tuple[int, int], top: int, left: int) -> dict[str, np.ndarray]:
        one, start = self.recordings[where[0]], where[1]
        frames, steps = slice(start, start + self.actions + 1), slice(start, start + self.actions)
        crop = (frames, slice(top, top + IMAGE_SIZE), slice(left, left + IMAGE_SIZE))
        ends = np.arange(start + 1, start + self.actions + 1) == len(one)
        before = np.concatenate([[False], one.touched])[frames]
        return {
            "color": one.color[crop],
            "depth": one.depth[crop],
            "wrench": one.wrench[frames],
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
    """Keys of the batches of one leg, the steps of a training between two checkpoints.

    The batches depend only on the seed and on the numbers of the steps. All passes through the data, each in a new
    random order, are joined end to end, and step k takes the k-th batch of them.

    Args:
        sequences: Number of sequences in the data.
        batch_size: Number of sequences per step.
        seed: Seed of the random orders.
        steps: Numbers of the leg's steps in the whole training.
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
    """Return the training and validation sequences of a dataset, which are of different episodes, and the split.

    Args:
        config: Configuration that gives the dataset, the split, the length of a sequence and the labels.

    Raises:
        SvflError: If the dataset cannot be read, or its episodes or labels cannot be used for training.
    """
    dataset = Dataset.open(config.data)
    recordings = {one.index: one for one in load_recordings(dataset, config.contact_n, config.mixed, config.camera)}
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
    """Refuse training episodes in which a label that is to be learned never changes."""
    wanted = PRESETS[config.preset].weights
    force = [np.linalg.norm(one.wrench[:, -1, :3], axis=1) for one in train.recordings]
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
    """Take the statistics of the inputs from training episodes.

    Args:
        inputs: Scaling of the inputs; its statistics are set.
        recordings: The training episodes.
    """
    stride = max(1, sum(map(len, recordings)) // IMAGES)
    joined = {name: np.concatenate([getattr(one, name) for one in recordings])
              for name in ("color", "depth", "wrench", "proprio")}  # fmt: skip
    image = picture({name: joined[name][::stride] for name in ("color", "depth")})
    depth = image[:, 3]
    depth[depth == 0] = depth[depth > 0].mean() if depth.any() else 0  # 0: not measured
    inputs.fit(image, joined["wrench"], joined["proprio"])
