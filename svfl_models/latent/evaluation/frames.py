"""What a model makes of episodes: of each frame alone, and of each as part of its episode."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from svfl_data.system.progress import progress
from svfl_models.latent.config import MODALITIES
from svfl_models.latent.evaluation.episodes import whole
from svfl_models.latent.inputs import Batch
from svfl_models.latent.networks.encoder import Parts
from svfl_models.latent.networks.network import LatentNetwork, LatentOutput
from svfl_models.latent.recordings import Recording

CHUNK = 64
"""Frames to encode at a time: more only take memory."""


@dataclass(frozen=True, eq=False)
class Followed:
    """An episode that a model has followed from its first frame to its last.

    The states have seen all frames before theirs, also where that is more than a training's sequences have.

    Attributes:
        batch: The episode, shape (1, T, ...).
        seen: What the model makes of it.
    """

    batch: Batch
    seen: LatentOutput


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of many episodes, side by side.

    Attributes:
        observations: ``image``, ``wrench`` and ``proprio``, physical, shape (F, ...).
        episode: Index of the episode, shape (F,).
        step: Shape (F,).
        contact: Whether the force exceeds the threshold, shape (F,), bool.
        touching: Whether there is contact, by force or by annotation, shape (F,), bool.
    """

    observations: Batch
    episode: Tensor
    step: Tensor
    contact: Tensor
    touching: Tensor

    def __len__(self) -> int:
        return len(self.step)

    def __getitem__(self, rows: Tensor) -> "Frames":
        """Some of them."""
        observations = {name: values[rows] for name, values in self.observations.items()}
        return Frames(observations, self.episode[rows], self.step[rows], self.contact[rows], self.touching[rows])

    def spread(self, most: int) -> "Frames":
        """At most so many, evenly over all."""
        return self[spread(len(self), most)]


@dataclass(frozen=True, eq=False)
class Encoded:
    """What an encoder says about frames.

    Attributes:
        feature: Shape (F, D).
        contact: Probability, shape (F,).
        alignment: Probability, shape (F,).
        parts: What it made of each modality alone; empty if not asked for.
    """

    feature: Tensor
    contact: Tensor
    alignment: Tensor
    parts: Parts = field(default_factory=dict)


def spread(count: int, most: int) -> Tensor:
    """At most `most` of `count` rows, evenly over all, int64."""
    return torch.from_numpy(np.linspace(0, count - 1, min(count, most)).round().astype(np.int64))


@torch.no_grad()
def follow(network: LatentNetwork, recordings: Sequence[Recording]) -> list[Followed]:
    """Let a model, in eval mode, follow episodes."""
    batches = [whole(one) for one in recordings]
    return [Followed(batch, network(batch)) for batch in progress(batches, "following episodes")]


def frames_of(batches: Sequence[Batch], most: int | None = None) -> Frames:
    """The frames of whole episodes.

    Args:
        batches: Made by `episodes.whole`.
        most: At most so many, evenly over all; by default all.
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
    """Encode frames, a chunk at a time."""
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
    """What the encoder said about the frames of followed episodes, in the order of `frames_of`."""
    seen = [one.seen for one in followed]
    return Encoded(
        torch.cat([one.encoding.feature for one in seen]),
        torch.cat([one.encoding.contact for one in seen]).sigmoid(),
        torch.cat([one.encoding.alignment for one in seen]).sigmoid(),
        {name: torch.cat([one.parts[name] for one in seen]) for name in MODALITIES},
    )


def numbers(tensor: Tensor) -> np.ndarray:
    """For NumPy, float64."""
    return np.asarray(tensor.double().numpy())
