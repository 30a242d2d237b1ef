"""Pairs of frames with the wrench of another time, to be distinguished from frames with their own wrench."""

from dataclasses import dataclass

import torch
from scipy.optimize import linear_sum_assignment
from torch import Tensor


@dataclass(frozen=True, eq=False)
class Mismatch:
    """Pairs of frames of a batch, one that gives the image and one that gives the wrench.

    Attributes:
        image: Numbers of the frames whose image and proprioception are taken, shape (P,), int64.
        wrench: Numbers of the frames whose wrench is taken, shape (P,), int64.
    """

    image: Tensor
    wrench: Tensor


def mismatched(episode: Tensor, step: Tensor, touching: Tensor, gap: int, per_sequence: int) -> Mismatch:
    """Pair frames of a batch so that each pair is wrong and can be recognised as wrong.

    Some frames of each sequence are drawn at random, and a derangement of the drawn frames pairs them: each gives its
    wrench to at most one other frame. No pair consists of two frames of one episode that are close in time, where the
    two wrenches are nearly the same. No pair consists of two frames free of contact, where both wrenches are nearly
    zero. Among all such derangements, one with the most pairs is drawn at random; a frame without a partner is left
    out. The assignment is solved directly, so that it always ends, however few or similar the frames are.

    Args:
        episode: Index of each sequence's episode, shape (B,).
        step: Number of each frame in its episode, shape (B, T).
        touching: Whether the gripper is in contact, shape (B, T), bool.
        gap: Smallest number of steps between two frames of one episode that form a pair.
        per_sequence: Number of frames to draw from each sequence, at most T.

    Returns:
        The pairs, in the order of the sequences that give the image. Frames are numbered through the whole batch:
        frame t of sequence b has the number b T + t.
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
    """Return whether frame i may be shown with the wrench of frame j, shape (F, F), bool; false on the diagonal.

    Args:
        episode: Index of each frame's episode, shape (F,).
        step: Number of each frame in its episode, shape (F,).
        touching: Whether each frame is in contact, shape (F,), bool.
        gap: Smallest number of steps between two frames of one episode that form a pair.
    """
    near = (episode[:, None] == episode) & ((step[:, None] - step).abs() < max(1, gap))
    return ~near & (touching[:, None] | touching)
