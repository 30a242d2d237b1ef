"""Types of the quantities of an episode, as escnn's layers need them.

How each quantity transforms is declared once, as parts, in `svfl_data.symmetry`. Here every part becomes a
representation of the dihedral group D_N or the cyclic group C_N (notation of escnn, ``irrep(flip, frequency)`` for
D_N; C_N has no flip):

| part | representation | stored as |
| --- | --- | --- |
| invariant | ``irrep(0, 0)`` | x |
| vector (a, b) | ``irrep(1, 1)`` | (a, b) |
| axial (a, b) | ``irrep(1, 1)`` | (-b, a) |
| pseudoscalar | ``irrep(1, 0)`` | x |
| angle of period pi | frequency 2 | (cos 2x, sin 2x) |

With s = det R, an axial vector goes to s R m. The quarter turn J = [[0, -1], [1, 0]] obeys J R = s R J, hence
J m = (-m_y, m_x) goes to J s R m = R J m: the same representation as a polar vector.

A gripper with two fingers looks the same after half a turn, hence an angle's frequency 2: ``irrep(1, 2)`` has two
dimensions for N > 4; in D4 it falls apart into ``irrep(0, 2)`` (cosine) and ``irrep(1, 2)`` (sine), in C4 into two of
one kind.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.symmetry import WRENCH_PARTS, Kind, Part
from svfl_models.symmetry.groups import GROUPS, TORQUES, Group
from svfl_models.symmetry.planar_escnn import FieldType, GSpace2D, Representation, flipRot2dOnR2, rot2dOnR2


def plane(group: Group) -> GSpace2D:
    """The plane with a group acting on it.

    ``axis=0`` makes the flip y -> -y, as ``irrep(1, 1)`` has it. With escnn's default axis a mirrored image and a
    mirrored vector disagree (the image flips in x, the vector in y).
    """
    return flipRot2dOnR2(group.rotations, axis=0.0) if group.mirrors else rot2dOnR2(group.rotations)


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


def field_type(space: GSpace2D, group: Group, parts: Sequence[Part]) -> FieldType:
    """The escnn type of numbers stored as `stored` arranges them."""
    representations: list[Representation] = []
    for part in parts:
        if part.kind in ("vector", "axial"):
            representations.append(_irrep(space, group, 1, 1))
        elif part.kind == "angle":
            representations += _double_angle(space, group) * len(part.index)
        else:
            one = _irrep(space, group, 1, 0) if part.kind == "pseudoscalar" else space.trivial_repr
            representations += [one] * len(part.index)
    return FieldType(space, representations)


def stored(parts: Sequence[Part], physical: Tensor) -> Tensor:
    """Physical components in the order and signs of `field_type`, angles as cosine and sine of their double.

    Args:
        parts: The kinds of the C components.
        physical: Shape (..., C).

    Returns:
        Shape (..., C'), with one component more per angle.
    """
    pieces = []
    for part in parts:
        chosen = [physical[..., index] for index in part.index]
        if part.kind == "axial":
            chosen = [-chosen[1], chosen[0]]
        elif part.kind == "angle":
            chosen = [turned for angle in chosen for turned in (torch.cos(2 * angle), torch.sin(2 * angle))]
        pieces += chosen
    return torch.stack(pieces, dim=-1)


def physical(parts: Sequence[Part], stored: Tensor) -> Tensor:
    """The inverse of `stored`: from a network's output to physical components, both of shape (..., C).

    Raises:
        TrainingError: If a part is an angle, which no network gives.
    """
    components: dict[int, Tensor] = {}
    places = iter(stored.unbind(-1))
    for part in parts:
        if part.kind == "angle":
            raise TrainingError("an angle cannot be read off its double")
        if part.kind == "axial":
            components[part.index[1]], components[part.index[0]] = -next(places), next(places)
        else:
            components |= {index: next(places) for index in part.index}
    return torch.stack([components[index] for index in sorted(components)], dim=-1)


def components(parts: Sequence[Part]) -> int:
    """Number of components of the stored form."""
    return sum(len(part.index) * (2 if part.kind == "angle" else 1) for part in parts)


def regular_type(space: GSpace2D, fields: int) -> FieldType:
    """Hidden features: `fields` regular representations; channels are ordered (field, group element)."""
    return FieldType(space, [space.regular_repr] * fields)


def image_type(space: GSpace2D, channels: int) -> FieldType:
    """Image channels: their pixels move, their values do not change."""
    return FieldType(space, [space.trivial_repr] * channels)


def restricted(kind: FieldType, group: Group) -> FieldType:
    """A type of a larger group seen by the part of it that permutes four directions (`Group.subgroup`).

    The numbers stay as they are. C8 -> C4; D8, D12 -> D4.
    """
    if group.subgroup() == group:
        return kind
    return kind.restrict((0, 4) if group.mirrors else 4)


def direction_type(space: GSpace2D) -> FieldType:
    """Scores of the four directions: permuted like `svfl_data.symmetry.DIRECTIONS`.

    The cosets of the reflection that fixes +x, ``(0, 1)`` in escnn's notation, are the images of +x under D4; escnn
    lists them in the order of the rotations: right, up, left, down. Without reflections they are C4 itself.

    Raises:
        TrainingError: If the group is neither D4 nor C4, the only ones with such a quotient of four.
    """
    order = space.fibergroup.order()
    if order == len(GROUPS["D4"]):
        return FieldType(space, [space.quotient_repr((0, 1))])
    if order == len(GROUPS["C4"]):
        return FieldType(space, [space.regular_repr])
    raise TrainingError(f"four directions are a quotient of D4 or C4, not of a group of {order}")


def _irrep(space: GSpace2D, group: Group, flip: int, frequency: int) -> Representation:
    return space.irrep(flip, frequency) if group.mirrors else space.irrep(frequency)


def _double_angle(space: GSpace2D, group: Group) -> list[Representation]:
    """How (cos 2x, sin 2x) transforms."""
    if group.rotations > 4:
        return [_irrep(space, group, 1, 2)]
    return [_irrep(space, group, 0, 2), _irrep(space, group, 1, 2)]
