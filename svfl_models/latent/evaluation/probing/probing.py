"""Fits probes on training episodes of a model and evaluates them on others, with all modalities or with some."""

from collections.abc import Sequence

import torch

from svfl_models.latent.evaluation.episodes import Material
from svfl_models.latent.evaluation.frames import Encoded, Followed, Frames, encode, frames_of, numbers, spread
from svfl_models.latent.evaluation.missing import Remaining, missing
from svfl_models.latent.evaluation.probing.poses import object_poses, repeats_per_turn
from svfl_models.latent.evaluation.probing.probes import Probe, Reading, raw_inputs, readings, targets_of
from svfl_models.latent.networks.network import LatentNetwork

MISSING_FRAMES = 300
"""Largest number of training frames, spread evenly, that a probe is fitted on for each subset of the modalities."""


class Probing:
    """Probes of one model, with the targets of all frames.

    Args:
        network: The latent model, in eval mode.
        given: Episodes of the evaluation and their datasets.
        learned: Training frames to fit the probes on.
        evaluated: Frames of whole episodes to evaluate the probes on.
    """

    def __init__(self, network: LatentNetwork, given: Material, learned: Frames, evaluated: Frames) -> None:
        self.network, self.learned, self.evaluated = network, learned, evaluated
        repeats = repeats_per_turn(given.learned.dataset)
        poses = [
            object_poses(part.dataset, frames, part.camera)
            for part, frames in ((given.learned, learned), (given.evaluated, evaluated))
        ]
        self.posed = all(one is not None for one in poses)
        """Whether the object's pose is known in all episodes and is therefore a target."""
        self.learned_targets, self.targets = (
            targets_of(frames, one if self.posed else None, repeats)
            for frames, one in zip((learned, evaluated), poses, strict=True)
        )

    def readings(self, seen: Encoded) -> list[Reading]:
        """Evaluate probes of the evaluated frames' features and of their raw inputs.

        Args:
            seen: Output of the encoder for the evaluated frames.
        """
        feature = numbers(encode(self.network, self.learned.observations).feature)
        raw = [raw_inputs(self.network, frames) for frames in (self.learned, self.evaluated)]
        probe, raw_probe = (Probe.fit(x, self.learned_targets, self.learned.episode) for x in (feature, raw[0]))
        return readings(probe, numbers(seen.feature), raw_probe, raw[1], self.targets)

    def missing(self, followed: Sequence[Followed]) -> list[Remaining]:
        """Evaluate the model with each subset of the modalities on some of the evaluated episodes.

        Args:
            followed: The episodes with the outputs of the model.
        """
        frames = frames_of([one.batch for one in followed])
        rows = torch.isin(self.evaluated.episode, frames.episode).numpy()
        few = spread(len(self.learned), MISSING_FRAMES)
        return missing(
            self.network,
            followed,
            frames,
            [target.of(rows) for target in self.targets],
            self.learned[few],
            [target.of(few.numpy()) for target in self.learned_targets],
        )
