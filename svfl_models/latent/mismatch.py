"""Frames with the wrench of another moment: what a network must tell from frames with their own."""

from dataclasses import dataclass

import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Mismatch:
    """Pairs of frames of a batch.

    Attributes:
        image: Frame whose image, and gripper, is taken, shape (P,), int64.
        wrench: Frame whose wrench is taken, shape (P,), int64.
    """

    image: Tensor
    wrench: Tensor


def mismatched(episode: Tensor, step: Tensor, touching: Tensor, gap: int, per_sequence: int) -> Mismatch:
    """Pair frames of a batch so that each pair is really wrong, and can be seen to be.

    Of each sequence some frames are drawn, and among these a derangement: each gives its wrench to at most one other
    one. No pair is of one episode and close in time, where two wrenches are nearly the same; and no pair is of two
    frames free of contact, where both wrenches are nothing. Of all derangements one with the most pairs is drawn; a
    frame that is left without a partner is left out. There is no search that could go on for ever, however few or
    similar the frames are.

    Args:
        episode: Of each sequence, shape (B,).
        step: Of each frame in its episode, shape (B, T).
        touching: Whether the gripper is in contact, shape (B, T), bool.
        gap: Steps of one episode that two frames of a pair are apart, at least.
        per_sequence: Frames to draw of each sequence; at most T.

    Returns:
        Frames are numbered through the batch, sequence by sequence.
    """
    sequences, frames = step.shape
    drawn = torch.rand(sequences, frames).argsort(dim=1)[:, :per_sequence]  # always on the CPU
    chosen = (drawn + frames * torch.arange(sequences)[:, None]).flatten().to(step.device)
    allowed = allowed_pairs(episode[chosen // frames], step.flatten()[chosen], touching.flatten()[chosen], gap).cpu()
    liking = torch.rand(allowed.shape) + len(chosen) * allowed  # one more pair outweighs all random numbers
    rows, partners = (torch.from_numpy(index) for index in linear_sum_assignment(liking.numpy(), maximize=True))
    kept = allowed[rows, partners]
    return Mismatch(chosen[rows[kept].to(chosen.device)], chosen[partners[kept].to(chosen.device)])


def allowed_pairs(episode: Tensor, step: Tensor, touching: Tensor, gap: int) -> Tensor:
    """Whether frame i may be shown with the wrench of frame j, shape (F, F); never with its own."""
    near = (episode[:, None] == episode) & ((step[:, None] - step).abs() < max(1, gap))
    return ~near & (touching[:, None] | touching)
