"""Chooses the episodes that a model is evaluated on, and those that linear maps may be fitted on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError
from svfl_data.sampling.named_camera import camera_of_dataset
from svfl_models.latent.data import Sequences
from svfl_models.latent.module import LatentModule
from svfl_models.latent.recordings import Recording, load_recordings
from svfl_models.symmetry.actions import Batch


@dataclass(frozen=True, eq=False)
class Part:
    """Some episodes of a dataset.

    Attributes:
        dataset: Dataset of the episodes.
        recordings: The episodes.
        camera: Name of the camera whose images and axes the recordings have.
    """

    dataset: Dataset
    recordings: list[Recording]
    camera: str

    def __len__(self) -> int:
        return len(self.recordings)


@dataclass(frozen=True, eq=False)
class Material:
    """Episodes for an evaluation.

    Attributes:
        evaluated: Episodes to evaluate, which the model was not trained on.
        learned: Training episodes of the model, which linear maps are fitted on.
        of: Description of the evaluated episodes in words.
    """

    evaluated: Part
    learned: Part
    of: str


def material(module: LatentModule, data: Path | None, episodes: int, seed: int) -> Material:
    """Return the episodes for the evaluation of a checkpoint.

    Without `data`, the held-out episodes of the dataset that the model was trained on are evaluated. `data` names
    another dataset, all of whose episodes are evaluated, or the same dataset in another place, whose held-out episodes
    are evaluated. A dataset counts as the same one if its task, seed and configuration are equal, or if the original is
    missing.

    Args:
        module: The model, as `checkpoint.load_latent` returns it.
        data: Dataset folder; None for the one named in the checkpoint.
        episodes: Largest number of episodes to evaluate.
        seed: Seed of the choice of episodes, if there are more.

    Raises:
        FormatError: If a dataset is missing or damaged.
        DatasetError: If the dataset lacks episodes of the split, or its episodes cannot be used, such as those without
            the camera of the training.
    """
    original = Path(module.hparams["training"]["data"])
    if data is None and not original.exists():
        raise FormatError(f"{original}: no such folder; the model was trained on it: --data says where it is now")
    if data is None or not original.exists():
        home, other = Dataset.open(data or original), None
    else:
        home, other = Dataset.open(original), Dataset.open(data)
        if other.info == home.info:
            home, other = other, None
    split = module.hparams["split"]
    held_out = "valid" if "valid" in split else "test"
    missing = sorted({*split["train"], *split[held_out]} - set(home.indices))
    if missing:
        raise DatasetError(
            f"{home.path}: the checkpoint's split names {len(missing)} episodes that it lacks, the first is "
            f"{missing[0]}; it has {len(home)}. Name the dataset that the model was trained on with --data"
        )
    found = _load(module, home)
    recordings = {one.index: one for one in found.recordings}
    learned = replace(found, recordings=[recordings[index] for index in sorted(split["train"]) if index in recordings])
    if other is None:
        of = f"episodes of {home.path} that the model has not learned from"
        chosen = [recordings[index] for index in sorted(split[held_out]) if index in recordings]
        return Material(replace(found, recordings=some(chosen, episodes, seed)), learned, of)
    of = f"episodes of {other.path}, another dataset than {home.path}, which the model was trained on"
    others = _load(module, other)
    return Material(replace(others, recordings=some(others.recordings, episodes, seed)), learned, of)


def some(recordings: Sequence[Recording], most: int, seed: int) -> list[Recording]:
    """Draw episodes at random, and return them in their order.

    Args:
        recordings: Episodes to draw from.
        most: Largest number of episodes to return.
        seed: Seed of the draw.
    """
    drawn = np.random.default_rng(seed).permutation(len(recordings))[:most]
    return [recordings[place] for place in sorted(drawn)]


def whole(recording: Recording) -> Batch:
    """Return an episode of N steps as one sequence of N + 1 frames, shape (1, N + 1, ...), as `Sequences` describes."""
    return Sequences([recording], len(recording), random=False)[[0]]


def _load(module: LatentModule, dataset: Dataset) -> Part:
    training = module.hparams["training"]
    camera = camera_of_dataset(dataset, training.get("camera"))  # older checkpoints name none
    loaded = load_recordings(dataset, training["contact_n"], training["mixed"], camera)
    found = [one for one in loaded if len(one)]
    if not found:
        raise DatasetError(f"{dataset.path}: no episode has any step")
    return Part(dataset, found, camera)
