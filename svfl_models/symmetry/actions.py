"""The action of rotations and reflections of the world on batches and on the outputs of networks, in PyTorch.

These are the laws of `svfl_data.symmetry`, for tensors on any device; tests check that the two agree. They serve to
augment data and to test and evaluate networks. Nothing here uses escnn, because a network that agrees with escnn's own
idea of a transformation can still disagree with physics (a mirrored torque, a flip about the other axis).

All matrices are orthogonal, of shape (2, 2), in image-aligned axes (x right, y up).
"""

from collections.abc import Callable, Mapping, Sequence

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
"""Inputs of a network by name, with vectors in image-aligned axes: the paths of their arrays, or the short names of the
paper's inputs: ``image`` (B, 4, H, H): colour / 255, then depth in [m]; ``wrench`` (B, T, 6): force [N], then torque
[N m]; ``proprio`` (B, 5): gripper opening 0..1, x and y relative to the workspace centre and z [m], yaw [rad]. Of
sequences (B, T) is in the place of B."""
Action = Callable[[np.ndarray, Tensor], Tensor]

PARTS: dict[str, tuple[Part, ...]] = {
    "wrench": WRENCH_PARTS,
    "proprio": PROPRIO_PARTS,
    "action": ACTION_PARTS,
    "offset": OFFSET_PARTS,
}
"""Parts of the last axis of those entries of a batch that are made of parts, by name of the entry."""


def act_on_batch(matrix: np.ndarray, batch: Batch, own: Mapping[str, Action] | None = None) -> Batch:
    """Rotate or mirror the world that a batch shows.

    Args:
        matrix: Matrix of the group element, shape (2, 2).
        batch: Some or all of the entries ``image`` (B, C, H, H); ``wrench`` (..., 6); ``proprio`` (..., 5), with (x, y)
            relative to the workspace centre; ``action`` (..., 5); ``offset`` (..., 2); ``direction`` (...), classes;
            and the entries of `own`.
        own: Actions on further entries, or on these in another form, by name, such as `act_on_parts`.

    Returns:
        The transformed batch. Elements other than quarter turns and flips move pixels by interpolation, which is not
        exact.

    Raises:
        KeyError: If the batch has an entry other than these.
        ValueError: If the batch has directions and the element is neither a quarter turn nor a flip.
    """
    moved = {}
    for name, values in batch.items():
        if own and name in own:
            moved[name] = own[name](matrix, values)
        elif name == "image":
            moved[name] = act_on_image(matrix, values)
        elif name == "direction":
            moved[name] = direction_permutation(matrix, values.device)[values]
        else:
            moved[name] = act_on_parts(PARTS[name])(matrix, values)
    return moved


def augment(batch: Batch, group: Group, own: Mapping[str, Action] | None = None) -> Batch:
    """Transform every sample of a batch by a random element of those that map pixels onto pixels.

    Args:
        batch: Samples to transform, see `act_on_batch`.
        group: Group whose elements `Group.pixel_exact` are drawn from.
        own: Actions on further entries by name, see `act_on_batch`.

    Returns:
        The transformed batch, of the same shapes; an element is drawn for each sample.
    """
    count = len(next(iter(batch.values())))
    drawn = torch.randint(len(group.pixel_exact), (count,))
    moved = {name: torch.empty_like(values) for name, values in batch.items()}
    for index, matrix in enumerate(group.pixel_exact):
        chosen = (drawn == index).nonzero()[:, 0]
        part = {name: values[chosen] for name, values in batch.items()}
        for name, values in act_on_batch(matrix, part, own).items():
            moved[name][chosen] = values
    return moved


def act_on_parts(parts: Sequence[Part]) -> Action:
    """Return the action of a group on physical components.

    Args:
        parts: Parts that say how the C components transform.

    Returns:
        A function of a matrix, shape (2, 2), and components, shape (..., C), that returns the transformed components.
    """

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
    """Move the pixels of square images: exactly for quarter turns and flips, otherwise by bilinear interpolation.

    Args:
        matrix: Matrix of the group element, shape (2, 2).
        image: Images, shape (..., H, H).

    Returns:
        The moved images, of the same shape. Pixels that come from outside an image take the value of its edge.
    """
    exact = np.round(matrix)
    sign = np.sign(np.linalg.det(matrix))
    if np.allclose(matrix, exact, atol=1e-6):
        moved = image.flip(-2) if sign < 0 else image  # y -> -y reverses the order of the rows
        quarter_turns = round(np.arctan2(exact[1, 0], exact[0, 0]) / (np.pi / 2)) % 4
        return torch.rot90(moved, int(quarter_turns), dims=(-2, -1))  # counter-clockwise for (row, column)
    down = np.diag([1.0, -1.0])  # grid_sample's y runs downwards
    back = torch.as_tensor(down @ matrix.T @ down, dtype=image.dtype, device=image.device)  # a pixel's origin
    flat = image.reshape(1, -1, *image.shape[-2:])
    grid = functional.affine_grid(functional.pad(back, (0, 1))[None], list(flat.shape), align_corners=False)
    moved = functional.grid_sample(flat, grid, mode="bilinear", padding_mode="border", align_corners=False)
    return moved.reshape(image.shape)


def direction_permutation(matrix: np.ndarray, device: torch.device | None = None) -> Tensor:
    """Return the permutation of the four direction classes by a group element.

    Args:
        matrix: Matrix of the group element, shape (2, 2).
        device: Device of the result. None means the CPU.

    Returns:
        The new class of each direction class, shape (4,), int64.

    Raises:
        ValueError: If the element does not map directions onto directions.
    """
    if not np.allclose(matrix, np.round(matrix), atol=1e-6):
        raise ValueError(
            f"only quarter turns and flips permute four directions, got R = {np.round(matrix, 3).tolist()}"
        )
    return torch.from_numpy(act_on_direction(matrix, np.arange(4))).to(device)


def act_on_scores(matrix: np.ndarray, scores: Tensor) -> Tensor:
    """Permute the scores of the four directions.

    Args:
        matrix: Matrix of the group element, shape (2, 2), a quarter turn or a flip.
        scores: Scores of the directions, shape (..., 4).

    Returns:
        The permuted scores, of the same shape.

    Raises:
        ValueError: If the element does not map directions onto directions.
    """
    moved = torch.empty_like(scores)
    moved[..., direction_permutation(matrix, scores.device)] = scores
    return moved


def act_on_invariant(matrix: np.ndarray, values: Tensor) -> Tensor:
    """Return values unchanged, which is the action of every group element on invariants."""
    return values


def act_on_hidden(group: Group = GROUPS["D4"]) -> Action:
    """Return the action on hidden features: the group channels of each field are permuted as h -> g h.

    Args:
        group: Group of the network that the features come from.

    Returns:
        A function of a matrix, shape (2, 2), and features, shape (..., fields * elements) with channels ordered (field,
        group element), that returns the transformed features.
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
    """Return the action on hidden feature maps: pixels move and group channels are permuted.

    Args:
        group: Group of the network that the feature maps come from.

    Returns:
        A function of a matrix, shape (2, 2), and feature maps, shape (B, C, H, H) with channels ordered (field, group
        element), that returns the transformed feature maps.
    """
    on_channels = act_on_hidden(group)

    def action(matrix: np.ndarray, features: Tensor) -> Tensor:
        return on_channels(matrix, act_on_image(matrix, features).movedim(1, -1)).movedim(-1, 1)

    return action
