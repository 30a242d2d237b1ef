"""What can be read off a feature by a linear map: wrench, gripper, and the pose of the object."""

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
"""Raw pictures are averaged over squares of 4 x 4 pixels."""
TOGETHER = 8
"""Raw readings are averaged over 8 at a time."""


@dataclass(frozen=True, eq=False)
class Target:
    """What a probe is to read.

    Attributes:
        name: In words.
        unit: Of the error.
        values: Shape (F, K): in `unit`; of an angle the cosine and sine of `repeats` times it.
        repeats: How often an angle comes back in a full turn; 0 for what is no angle.
    """

    name: str
    unit: str
    values: np.ndarray
    repeats: int = 0

    def of(self, rows: np.ndarray) -> "Target":
        """The same of some frames."""
        return replace(self, values=self.values[rows])

    def error(self, guess: np.ndarray) -> float:
        """Mean distance of guesses (F, K) from the values, in `unit`; of angles, up to their period."""
        if not self.repeats:
            return float(np.linalg.norm(guess - self.values, axis=1).mean())
        off = np.arctan2(guess[:, 1], guess[:, 0]) - np.arctan2(self.values[:, 1], self.values[:, 0])
        return float(np.rad2deg(np.abs((off + np.pi) % (2 * np.pi) - np.pi)).mean()) / self.repeats


@dataclass(frozen=True)
class Reading:
    """How well a probe reads its target on held-out frames.

    Attributes:
        name: Of the target.
        unit: Of the errors.
        r2: Share of the variance that is explained; None if the target does not vary.
        error: Mean distance from the truth.
        raw_r2: Likewise of the same probe on raw, shrunken inputs.
        raw_error: Likewise.
        mean_error: Of always guessing the training mean.
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
    """One linear map that reads all targets at once.

    Attributes:
        ridge: The map.
        training_mean: Of all targets' values.
    """

    ridge: Ridge
    training_mean: np.ndarray

    @classmethod
    def fit(cls, inputs: np.ndarray, targets: Sequence[Target], episode: Tensor) -> "Probe":
        """Fit on training frames: inputs (F, D), and which episode each frame is of."""
        values = np.concatenate([target.values for target in targets], axis=1)
        return cls(fit_ridge(inputs, values, episode.numpy()), values.mean(axis=0))

    def guesses(self, inputs: np.ndarray, targets: Sequence[Target]) -> list[np.ndarray]:
        """Guess each target, shape (F, K)."""
        return _split(self.ridge(inputs), targets)


def targets_of(frames: Frames, poses: np.ndarray | None, repeats: int) -> list[Target]:
    """What probes read: last wrench reading, gripper, and the object's pose where it is known.

    The yaw of the gripper is that of two fingers, which look the same after half a turn.

    Args:
        frames: Where from.
        poses: Of the object, as `poses.object_poses` has them.
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
    """Evaluate probes of features and of raw inputs on held-out frames."""
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
    """The networks' own inputs, shrunken and flattened, shape (F, 1084): 4 x 16 x 16 pixels, 9 wrenches, the gripper.

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
