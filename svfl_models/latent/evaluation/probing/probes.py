"""Linear probes, which read wrench, gripper and object pose from a feature."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from svfl_models.latent.evaluation.frames import Frames
from svfl_models.latent.evaluation.probing.ridge import Ridge, fit_ridge
from svfl_models.latent.evaluation.scores import r_squared
from svfl_models.latent.networks.network import LatentNetwork

POOL = 4
"""Side of the squares over which raw images are averaged, [px]."""
TOGETHER = 8
"""Number of consecutive raw readings that are averaged."""


@dataclass(frozen=True, eq=False)
class Target:
    """Quantity that a probe reads.

    Attributes:
        name: Name of the quantity in words.
        unit: Unit of the error.
        values: True values in F frames, shape (F, K): in `unit`, or, of an angle, cosine and sine of `repeats` times
            the angle.
        repeats: How often an angle repeats in a full turn; 0 for a quantity that is not an angle.
    """

    name: str
    unit: str
    values: np.ndarray
    repeats: int = 0

    def of(self, rows: np.ndarray) -> "Target":
        """Return the same target for the frames with the given row numbers."""
        return replace(self, values=self.values[rows])

    def error(self, guess: np.ndarray) -> float:
        """Return the mean distance of guesses (F, K) from the true values, in `unit`; of angles up to their period."""
        if not self.repeats:
            return float(np.linalg.norm(guess - self.values, axis=1).mean())
        off = np.arctan2(guess[:, 1], guess[:, 0]) - np.arctan2(self.values[:, 1], self.values[:, 0])
        return float(np.rad2deg(np.abs((off + np.pi) % (2 * np.pi) - np.pi)).mean()) / self.repeats


@dataclass(frozen=True)
class Reading:
    """Scores of a probe on held-out frames.

    Attributes:
        name: Name of the target.
        unit: Unit of the errors.
        r2: Share of the variance that the probe explains; None if the target does not vary.
        error: Mean distance of the probe's guess from the truth.
        raw_r2: Share of the variance that the same kind of probe on reduced raw inputs explains; None if the target
            does not vary.
        raw_error: Mean distance from the truth of the guess from raw inputs.
        mean_error: Mean distance from the truth of always guessing the mean of the training frames.
    """

    name: str
    unit: str
    r2: float | None
    error: float
    raw_r2: float | None
    raw_error: float
    mean_error: float


@dataclass(frozen=True, eq=False)
class Probe:
    """Linear map that reads all targets at once.

    Attributes:
        ridge: The linear map.
        training_mean: Mean values of all targets in the training frames, joined.
    """

    ridge: Ridge
    training_mean: np.ndarray

    @classmethod
    def fit(cls, inputs: np.ndarray, targets: Sequence[Target], episode: Tensor) -> "Probe":
        """Fit a probe on training frames.

        Args:
            inputs: Features or raw inputs of F frames, shape (F, D).
            targets: Targets in the same frames.
            episode: Index of each frame's episode, shape (F,).
        """
        values = np.concatenate([target.values for target in targets], axis=1)
        return cls(fit_ridge(inputs, values, episode.numpy()), values.mean(axis=0))

    def guesses(self, inputs: np.ndarray, targets: Sequence[Target]) -> list[np.ndarray]:
        """Return a guess of each target from inputs (F, D), shape (F, K) each."""
        return _split(self.ridge(inputs), targets)


def targets_of(frames: Frames, poses: np.ndarray | None, repeats: int) -> list[Target]:
    """Return the targets of probes: last wrench reading, gripper, and the object's pose where it is known.

    The yaw of the gripper repeats after half a turn, because a gripper with two fingers looks the same then.

    Args:
        frames: Frames to take the values from.
        poses: Poses of the object in these frames, as `poses.object_poses` returns them; None if unknown.
        repeats: How often the object looks the same in a full turn.
    """
    wrench = frames.observations["wrench"][:, -1].double().numpy()
    proprio = frames.observations["proprio"].double().numpy()
    targets = [
        Target("force", "N", wrench[:, :3]),
        Target("torque", "N m", wrench[:, 3:]),
        Target("gripper opening", "-", proprio[:, :1]),
        Target("gripper x, y", "mm", 1000 * proprio[:, 1:3]),
        Target("gripper z", "mm", 1000 * proprio[:, 3:4]),
        Target("gripper yaw", "deg", _circle(proprio[:, 4], 2), 2),
    ]
    if poses is None:
        return targets
    return [
        *targets,
        Target("object x, y", "mm", 1000 * poses[:, :2]),
        Target("object z", "mm", 1000 * poses[:, 2:3]),
        Target("object yaw", "deg", _circle(poses[:, 3], repeats), repeats),
    ]


def readings(
    probe: Probe, feature: np.ndarray, raw_probe: Probe, raw: np.ndarray, targets: Sequence[Target]
) -> list[Reading]:
    """Evaluate the probes of features and of raw inputs on held-out frames.

    Args:
        probe: Probe that was fitted on features.
        feature: Features of the held-out frames, shape (F, D).
        raw_probe: Probe that was fitted on raw inputs.
        raw: Raw inputs of the held-out frames, see `raw_inputs`.
        targets: Targets in the held-out frames.
    """
    seen, plain = probe.guesses(feature, targets), raw_probe.guesses(raw, targets)
    means = _split(np.broadcast_to(probe.training_mean, (len(feature), len(probe.training_mean))), targets)
    return [
        Reading(
            name=target.name,
            unit=target.unit,
            r2=r_squared(guess, target.values),
            error=target.error(guess),
            raw_r2=r_squared(raw_guess, target.values),
            raw_error=target.error(raw_guess),
            mean_error=target.error(mean),
        )
        for target, guess, raw_guess, mean in zip(targets, seen, plain, means, strict=True)
    ]


@torch.no_grad()
def raw_inputs(network: LatentNetwork, frames: Frames) -> np.ndarray:
    """Return the networks' inputs, reduced and flattened: 4 x 16 x 16 pixels, 9 wrenches, the gripper, shape (F, 1084).

    The wrenches are the means of eight readings each, and the last reading.
    """
    inputs = network.inputs(frames.observations)
    wrench = inputs["wrench"]
    shrunken = wrench.unflatten(1, (-1, TOGETHER)).mean(dim=2)
    pieces = [functional.avg_pool2d(inputs["image"], POOL), shrunken, wrench[:, -1:], inputs["proprio"]]
    return np.asarray(torch.cat([piece.flatten(1) for piece in pieces], dim=1).numpy(), np.float64)


def _circle(angle: np.ndarray, repeats: int) -> np.ndarray:
    return np.stack([np.cos(repeats * angle), np.sin(repeats * angle)], axis=1)


def _split(values: np.ndarray, targets: Sequence[Target]) -> list[np.ndarray]:
    ends = np.cumsum([target.values.shape[1] for target in targets])[:-1]
    return np.split(values, ends, axis=1)
