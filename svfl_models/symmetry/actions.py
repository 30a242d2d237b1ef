"""How a rotation or reflection of the world acts on batches and on what networks say about them, in PyTorch.

The same laws as `svfl_data.symmetry` (tests hold the two together), for tensors on any device: to augment data, to test
networks, to evaluate trained ones. Nothing here knows escnn: a network that agrees with escnn's own idea of a
transformation can still disagree with physics (a mirrored torque, a flip about the other axis).

All matrices are orthogonal, of shape (2, 2), in image-aligned axes (x right, y up).
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from svfl_data.symmetry import (
    ACTION_PARTS,
    OFFSET_PARTS,
    PROPRIO_PARTS,
    WRENCH_PARTS,
    Part,
    act_on_direction,
)
from svfl_models.symmetry.groups import GROUPS, Group

Batch = dict[str, Tensor]
Action = Callable[[np.ndarray, Tensor], Tensor]

PARTS: dict[str, tuple[Part, ...]] = {
    "wrench": WRENCH_PARTS,
    "proprio": PROPRIO_PARTS,
    "action": ACTION_PARTS,
    "offset": OFFSET_PARTS,
}
"""Entries of a batch whose last axis is made of parts."""


def act_on_batch(matrix: np.ndarray, batch: Batch) -> Batch:
    """Rotate or mirror the world that a batch shows.

    Args:
        matrix: The element.
        batch: ``image`` (B, C, H, H); ``wrench`` (..., 6); ``proprio`` (..., 5), (x, y) relative to the workspace
            centre; ``action`` (..., 5); ``offset`` (..., 2); ``direction`` (...), classes; or some of them.

    Returns:
        The transformed batch. Other than quarter turns and flips move pixels by interpolation, which is not exact.

    Raises:
        KeyError: If it is not known how an entry transforms.
        ValueError: If directions are to be turned by other than quarter turns and flips.
    """
    moved = {}
    for name, values in batch.items():
        if name == "image":
            moved[name] = act_on_image(matrix, values)
        elif name == "direction":
            moved[name] = direction_permutation(matrix, values.device)[values]
        else:
            moved[name] = act_on_parts(PARTS[name])(matrix, values)
    return moved


def augment(batch: Batch, group: Group) -> Batch:
    """Transform every sample by an element drawn at random from those that move pixels onto pixels."""
    count = len(next(iter(batch.values())))
    drawn = torch.randint(len(group.pixel_exact), (count,))
    moved = {name: torch.empty_like(values) for name, values in batch.items()}
    for index, matrix in enumerate(group.pixel_exact):
        chosen = (drawn == index).nonzero()[:, 0]
        for name, values in act_on_batch(matrix, {name: values[chosen] for name, values in batch.items()}).items():
            moved[name][chosen] = values
    return moved


def act_on_parts(parts: Sequence[Part]) -> Action:
    """How physical components transform, shape (..., C)."""

    def action(matrix: np.ndarray, values: Tensor) -> Tensor:
        sign = float(np.sign(np.linalg.det(matrix)))
        turn = float(np.arctan2(matrix[1, 0], matrix[0, 0]))  # the image of the x axis
        R = torch.as_tensor(matrix, dtype=values.dtype, device=values.device)
        moved = values.clone()
        for part in parts:
            index = list(part.index)
            chosen = values[..., index]
            if part.kind in ("vector", "axial"):
                moved[..., index] = (sign if part.kind == "axial" else 1.0) * (chosen @ R.T)
            elif part.kind == "pseudoscalar":
                moved[..., index] = sign * chosen
            elif part.kind == "angle":
                moved[..., index] = sign * chosen + turn
        return moved

    return action


def act_on_image(matrix: np.ndarray, image: Tensor) -> Tensor:
    """Move the pixels of square images (..., H, H): exactly for quarter turns and flips, else by interpolation.

    What turns in from outside the picture takes the value of its edge.
    """
    exact = np.round(matrix)
    sign = np.sign(np.linalg.det(matrix))
    if np.allclose(matrix, exact, atol=1e-6):
        moved = image.flip(-2) if sign < 0 else image  # y -> -y turns rows around
        quarter_turns = round(np.arctan2(exact[1, 0], exact[0, 0]) / (np.pi / 2)) % 4
        return torch.rot90(moved, int(quarter_turns), dims=(-2, -1))  # counter-clockwise for (row, column)
    down = np.diag([1.0, -1.0])  # grid_sample's y runs downwards
    back = torch.as_tensor(down @ matrix.T @ down, dtype=image.dtype, device=image.device)  # where a pixel comes from
    flat = image.reshape(1, -1, *image.shape[-2:])
    grid = functional.affine_grid(functional.pad(back, (0, 1))[None], list(flat.shape), align_corners=False)
    moved = functional.grid_sample(flat, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return moved.reshape(image.shape)


def direction_permutation(matrix: np.ndarray, device: torch.device | None = None) -> Tensor:
    """Where an element takes the four direction classes, shape (4,), int64.

    Raises:
        ValueError: If it does not map directions onto directions.
    """
    if not np.allclose(matrix, np.round(matrix), atol=1e-6):
        raise ValueError(
            f"only quarter turns and flips permute four directions, got R = {np.round(matrix, 3).tolist()}"
        )
    return torch.from_numpy(act_on_direction(matrix, np.arange(4))).to(device)


def act_on_scores(matrix: np.ndarray, scores: Tensor) -> Tensor:
    """Permute the scores of the four directions, shape (..., 4)."""
    moved = torch.empty_like(scores)
    moved[..., direction_permutation(matrix, scores.device)] = scores
    return moved


def act_on_invariant(matrix: np.ndarray, values: Tensor) -> Tensor:
    """Leave alone what does not change."""
    return values


def act_on_hidden(group: Group = GROUPS["D4"]) -> Action:
    """How hidden features transform: the group channels of each field are permuted as h -> g h.

    Args:
        group: Of the network.

    Returns:
        Action on tensors (..., fields * elements), channels ordered (field, group element).
    """
    elements = np.stack(group.elements)  # (G, 2, 2)

    def action(matrix: np.ndarray, features: Tensor) -> Tensor:
        products = matrix @ elements
        distance = np.abs(products[:, None] - elements[None]).sum(axis=(2, 3))  # (h, candidate for g h)
        fields = features.unflatten(-1, (-1, len(elements)))  # (..., F * G) -> (..., F, G)
        moved = torch.empty_like(fields)
        moved[..., torch.from_numpy(distance.argmin(axis=1)).to(features.device)] = fields
        return moved.flatten(-2)

    return action


def act_on_feature_map(group: Group = GROUPS["D4"]) -> Action:
    """How hidden feature maps (B, C, H, H) transform: pixels move and group channels are permuted."""
    on_channels = act_on_hidden(group)

    def action(matrix: np.ndarray, features: Tensor) -> Tensor:
        return on_channels(matrix, act_on_image(matrix, features).movedim(1, -1)).movedim(-1, 1)

    return action
