"""Measures how well a model predicts the next proprioception, in physical units."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from svfl_models.latent.evaluation.frames import Followed
from svfl_models.latent.networks.network import LatentNetwork


@dataclass(frozen=True)
class GripperError:
    """Mean absolute errors of a guess of the proprioception.

    Attributes:
        opening: Error of the gripper opening, where 0 is closed and 1 is open.
        xy_mm: Distance of the TCP in the horizontal plane, [mm].
        z_mm: Error of the TCP height, [mm].
        yaw_deg: Error of the yaw modulo half a turn, [deg].
    """

    opening: float
    xy_mm: float
    z_mm: float
    yaw_deg: float


@dataclass(frozen=True)
class NextHand:
    """Errors of three guesses of the next frame's proprioception.

    Attributes:
        predicted: Error of the model's prediction from state and action.
        unchanged: Error of the guess that the gripper does not move.
        commanded: Error of the guess that the gripper does exactly what the action commands.
    """

    predicted: GripperError
    unchanged: GripperError
    commanded: GripperError


def next_gripper(network: LatentNetwork, followed: Sequence[Followed]) -> NextHand:
    """Compare three guesses of the next proprioception over all steps of the evaluated episodes.

    Args:
        network: The latent model.
        followed: Episodes with the outputs of the model.
    """
    normalization = network.inputs.normalization
    before, after, action, predicted = [], [], [], []
    for one in followed:
        proprio, said = one.batch["proprio"][0], one.seen.next_proprio[0]
        linear = said[:, :4] * normalization.scale("proprio")[:4] + normalization.mean("proprio")[:4]
        yaw = torch.atan2(said[:, 5], said[:, 4]) / 2
        predicted.append(torch.cat([linear, yaw[:, None]], dim=1).numpy())
        before.append(proprio[:-1].numpy())
        after.append(proprio[1:].numpy())
        action.append(one.batch["action"][0].numpy())
    was, truth, told = (np.concatenate(kind) for kind in (before, after, action))
    commanded = np.concatenate([told[:, :1], was[:, 1:] + told[:, 1:]], axis=1)
    return NextHand(*(gripper_error(guess, truth) for guess in (np.concatenate(predicted), was, commanded)))


def gripper_error(guess: np.ndarray, truth: np.ndarray) -> GripperError:
    """Return the mean absolute errors of a guess of the proprioception.

    Args:
        guess: Guessed gripper opening, x, y, z [m] and yaw [rad], shape (N, 5).
        truth: True values, with the same shape and units.
    """
    off = guess - truth
    yaw = np.abs((off[:, 4] + np.pi / 2) % np.pi - np.pi / 2)
    return GripperError(
        opening=float(np.abs(off[:, 0]).mean()),
        xy_mm=1000 * float(np.linalg.norm(off[:, 1:3], axis=1).mean()),
        z_mm=1000 * float(np.abs(off[:, 3]).mean()),
        yaw_deg=float(np.rad2deg(yaw).mean()),
    )
