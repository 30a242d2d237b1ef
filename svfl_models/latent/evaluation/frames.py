"""Computes a model's outputs on episodes: for each frame alone, and for each frame as part of its episode."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from svfl_data.system.progress import progress
from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.episodes import whole
from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.network import LatentNetwork, LatentOutput
from svfl_models.latent.recordings import Recording
from svfl_models.symmetry.actions import Batch

CHUNK = 64
"""Number of frames to encode at once; a larger number only takes more memory."""


@dataclass(frozen=True, eq=False)
class Followed:
    """Episode with the outputs of a model that has processed it from the first to the last frame.

    Each latent state depends on all frames up to its own, even where these are more than the frames of a training
    sequence.

    Attributes:
        batch: The episode as one sequence of T frames, shape (1, T, ...).
        seen: Outputs of the model for this sequence.
    """

    batch: Batch
    seen: LatentOutput


@dataclass(frozen=True, eq=False)
class Frames:
    """F frames of several episodes, joined.

    Attributes:
        observations: Physical values ``image``, ``wrench`` and ``proprio``, shape (F, ...).
        episode: Index of each frame's episode, shape (F,).
        step: Number of each frame in its episode, shape (F,).
        contact: Whether the force exceeds the threshold, shape (F,), bool.
        touching: Whether the force exceeds the threshold or there was contact between the frame before and this one,
            shape (F,), bool.
    """

    observations: Batch
    episode: Tensor
    step: Tensor
    contact: Tensor
    touching: Tensor

    def __len__(self) -> int:
        return len(self.step)

    def __getitem__(self, rows: Tensor) -> "Frames":
        """Return the frames with the given row numbers."""
        observations = {name: values[rows] for name, values in self.observations.items()}
        return Frames(observations, self.episode[rows], self.step[rows], self.contact[rows], self.touching[rows])

    def spread(self, most: int) -> "Frames":
        """Return at most `most` of the frames, spread evenly."""
        return self[spread(len(self), most)]


@dataclass(frozen=True, eq=False)
class Encoded:
    """Output of an encoder for F frames.

    Attributes:
        feature: Feature of each frame, shape (F, D).
        contact: Probability of contact, shape (F,).
        alignment: Probability that image and wrench belong together, shape (F,).
        parts: What the encoder computes from each modality alone; empty if it was not asked for.
    """

    feature: Tensor
    contact: Tensor
    alignment: Tensor
    parts: Parts = field(default_factory=dict)


def spread(count: int, most: int) -> Tensor:
    """Return the numbers of at most `most` of `count` rows, spread evenly, int64."""
    return torch.from_numpy(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


@torch.no_grad()
def follow(network: LatentNetwork, recordings: Sequence[Recording]) -> list[Followed]:
    """Compute the outputs of a model for whole episodes.

    Args:
        network: The latent model, in eval mode.
        recordings: The episodes.
    """
    batches = [whole(one) for one in recordings]
    return [Followed(batch, network(batch)) for batch in progress(batches, "following episodes")]


def frames_of(batches: Sequence[Batch], most: int | None = None) -> Frames:
    """Return the frames of whole episodes.

    Args:
        batches: Episodes as `episodes.whole` returns them.
        most: Largest number of frames to return, spread evenly; None for all.
    """
    counts = [batch["step"].shape[1] for batch in batches]
    owner = torch.arange(len(batches)).repeat_interleave(torch.tensor(counts))
    place = torch.cat([torch.arange(count) for count in counts])
    rows = spread(len(owner), most or len(owner))
    chosen = [(batches[number], place[rows[owner[rows] == number]]) for number in range(len(batches))]

    def join(name: str) -> Tensor:
        return torch.cat([batch[name][0, steps] for batch, steps in chosen])

    return Frames(
        observations={name: join(name) for name in MODALITIES},
        episode=torch.cat([batch["episode"].expand(len(steps)) for batch, steps in chosen]),
        step=join("step"),
        contact=join("contact") > 0,
        touching=join("touching"),
    )


@torch.no_grad()
def encode(network: LatentNetwork, observations: Batch) -> Encoded:
    """Encode F frames in chunks of `CHUNK` frames; `Encoded.parts` stays empty."""
    count = len(observations["wrench"])
    chunks = [
        network.encode({name: values[start : start + CHUNK] for name, values in observations.items()})
        for start in range(0, count, CHUNK)
    ]
    return Encoded(
        torch.cat([one.feature for one in chunks]),
        torch.cat([one.contact for one in chunks]).sigmoid(),
        torch.cat([one.alignment for one in chunks]).sigmoid(),
    )


def encoded(followed: Sequence[Followed]) -> Encoded:
    """Return the encoder's outputs for the frames of processed episodes, in the order of `frames_of`."""
    seen = [one.seen for one in followed]
    return Encoded(
        torch.cat([one.encoding.feature for one in seen]),
        torch.cat([one.encoding.contact for one in seen]).sigmoid(),
        torch.cat([one.encoding.alignment for one in seen]).sigmoid(),
        {name: torch.cat([one.parts[name] for one in seen]) for name in MODALITIES},
    )


def numbers(tensor: Tensor) -> np.ndarray:
    """Convert a tensor to a NumPy array of float64."""
    return np.asarray(tensor.double().numpy())
