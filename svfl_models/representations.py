"""Types of the quantities of an episode, as escnn's layers need them.

How each quantity transforms is declared once, as parts, in `svfl_data.symmetry`. Here every part becomes an
irreducible representation of the dihedral group D_N (notation of escnn: ``irrep(flip, frequency)``):

| part | representation | stored as |
| --- | --- | --- |
| invariant | ``irrep(0, 0)`` | x |
| vector (a, b) | ``irrep(1, 1)`` | (a, b) |
| axial (a, b) | ``irrep(1, 1)`` | (-b, a) |
| pseudoscalar | ``irrep(1, 0)`` | x |

With s = det R, an axial vector goes to s R m. The quarter turn J = [[0, -1], [1, 0]] obeys J R = s R J, hence
J m = (-m_y, m_x) goes to J s R m = R J m: the same representation as a polar vector.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.symmetry import WRENCH_PARTS, Kind, Part
from svfl_models.config import TORQUES
from svfl_models.planar_escnn import FieldType, GSpace2D, flipRot2dOnR2


def dihedral_space(order: int) -> GSpace2D:
    """The plane with the dihedral group of 2 * order elements.

    ``axis=0`` makes the flip y -> -y, as ``irrep(1, 1)`` has it. With escnn's default axis a mirrored image and a
    mirrored vector disagree (the image flips in x, the vector in y).
    """
    return flipRot2dOnR2(order, axis=0.0)


def wrench_parts(torque: str = "axial") -> tuple[Part, ...]:
    """The parts of a wrench.

    Args:
        torque: ``axial`` is what a torque is. ``polar`` is the typing of the paper (Kohler et al., CoRL 2023, section
            4: R acts on m_xy, m_z is invariant), wrong under reflections and kept to measure what that costs.

    Raises:
        TrainingError: If the typing is unknown.
    """
    if torque not in TORQUES:
        raise TrainingError(f"unknown torque typing {torque!r}; possible: {', '.join(TORQUES)}")
    if torque == "axial":
        return WRENCH_PARTS
    polar: dict[Kind, Kind] = {"axial": "vector", "pseudoscalar": "invariant"}
    return tuple(Part(polar.get(part.kind, part.kind), part.index) for part in WRENCH_PARTS)


def field_type(space: GSpace2D, parts: Sequence[Part]) -> FieldType:
    """The escnn type of numbers stored as `field_basis` arranges them.

    Raises:
        TrainingError: If a part is an angle, which no linear representation describes.
    """
    representations = []
    for part in parts:
        if part.kind in ("vector", "axial"):
            representations.append(space.irrep(1, 1))
        elif part.kind == "pseudoscalar":
            representations += [space.irrep(1, 0)] * len(part.index)
        elif part.kind == "invariant":
            representations += [space.trivial_repr] * len(part.index)
        else:
            raise TrainingError(f"a part of kind {part.kind!r} has no linear representation; encode it first")
    return FieldType(space, representations)


def field_basis(parts: Sequence[Part]) -> Tensor:
    """Matrix that takes physical components to the order and signs of `field_type`.

    Args:
        parts: The kinds of the C physical components.

    Returns:
        Signed permutation, shape (C, C): ``stored = physical @ basis.T``.
    """
    rows: list[tuple[int, float]] = []  # which component, with which sign
    for part in parts:
        if part.kind == "axial":
            first, second = part.index
            rows += [(second, -1.0), (first, 1.0)]
        else:
            rows += [(index, 1.0) for index in part.index]
    basis = torch.zeros(len(rows), len(rows))
    for row, (component, sign) in enumerate(rows):
        basis[row, component] = sign
    return basis


def regular_type(space: GSpace2D, fields: int) -> FieldType:
    """Hidden features: `fields` regular representations; channels are ordered (field, group element)."""
    return FieldType(space, [space.regular_repr] * fields)


def image_type(space: GSpace2D, channels: int) -> FieldType:
    """Image channels: their pixels move, their values do not change."""
    return FieldType(space, [space.trivial_repr] * channels)


def direction_type(space: GSpace2D) -> FieldType:
    """Scores of the four directions: permuted like `svfl_data.symmetry.DIRECTIONS`.

    The cosets of the reflection that fixes +x, ``(0, 1)`` in escnn's notation, are the images of +x under D4; escnn
    lists them in the order of the rotations: right, up, left, down.

    Raises:
        TrainingError: If the group is not D4, the only one whose quotient has four directions.
    """
    if space.fibergroup.order() != 8:
        raise TrainingError(f"four directions are a quotient of D4, not of a group of {space.fibergroup.order()}")
    return FieldType(space, [space.quotient_repr((0, 1))])
