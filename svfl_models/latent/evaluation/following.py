"""How well the next proprioception is predicted, in units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from svfl_models.latent.evaluation.frames import Followed
from svfl_models.latent.networks.network import LatentNetwork


@dataclass(frozen=True)
class GripperError:
    """Mean absolute errors.

    Attributes:
        opening: Of the gripper, 0 closed, 1 open.
        xy_mm: Distance in the plane, [mm].
        z_mm: Of the height, [mm].
        yaw_deg: Of the yaw, modulo half a turn, [deg].
    """

    opening: float
    xy_mm: float
    z_mm: float
    yaw_deg: float


@dataclass(frozen=True)
class NextHand:
    """Errors of different guesses about the next frame's gripper.

    Attributes:
        predicted: The model's, from state and action.
        unchanged: The gripper stays as it is.
        commanded: The gripper does exactly what it is told to.
    """

    predicted: GripperError
    unchanged: GripperError
    commanded: GripperError


def next_gripper(network: LatentNetwork, followed: Sequence[Followed]) -> NextHand:
    """Compare guesses over all steps of followed episodes."""
    normalization = network.inputs.normalization
    before, after, action, predicted = [], [], [], []
    for one in followed:
        proprio, said = one.batch["proprio"][0], one.seen.next_proprio[0]
        linear = said[:, :4] * normalization.proprio_scale[:4] + normalization.proprio_mean[:4]
        yaw = torch.atan2(said[:, 5], said[:, 4]) / 2
        predicted.append(torch.cat([linear, yaw[:, None]], dim=1).numpy())
        before.append(proprio[:-1].numpy())
        after.append(proprio[1:].numpy())
        action.append(one.batch["action"][0].numpy())
    was, truth, told = (np.concatenate(kind) for kind in (before, after, action))
    commanded = np.concatenate([told[:, :1], was[:, 1:] + told[:, 1:]], axis=1)
    return NextHand(*(gripper_error(guess, truth) for guess in (np.concatenate(predicted), was, commanded)))


def gripper_error(guess: np.ndarray, truth: np.ndarray) -> GripperError:
    """Compare proprioception (N, 5): opening, x, y, z in [m], yaw in [rad]."""
    off = guess - truth
    yaw = np.abs((off[:, 4] + np.pi / 2) % np.pi - np.pi / 2)
    return GripperError(
        opening=float(np.abs(off[:, 0]).mean()),
        xy_mm=1000 * float(np.linalg.norm(off[:, 1:3], axis=1).mean()),
        z_mm=1000 * float(np.abs(off[:, 3]).mean()),
        yaw_deg=float(np.rad2deg(yaw).mean()),
    )
