"""Types of the quantities of an episode, as escnn's layers need them.

How each quantity transforms is declared once, as parts, in `svfl_data.symmetry`. Here every part becomes a
representation of the dihedral group D_N or the cyclic group C_N. In the notation of escnn, which is
``irrep(flip, frequency)`` for D_N and has no flip for C_N:

| part | representation | stored as |
| --- | --- | --- |
| invariant | ``irrep(0, 0)`` | x |
| vector (a, b) | ``irrep(1, 1)`` | (a, b) |
| axial (a, b) | ``irrep(1, 1)`` | (-b, a) |
| pseudoscalar | ``irrep(1, 0)`` | x |
| angle of period pi | frequency 2 | (cos 2x, sin 2x) |

With s = det R, an axial vector m goes to s R m. The quarter turn J = [[0, -1], [1, 0]] obeys J R = s R J, hence
J m = (-m_y, m_x) goes to J s R m = R J m, so that it has the same representation as a polar vector.

A gripper with two fingers looks the same after half a turn, hence an angle has frequency 2. ``irrep(1, 2)`` has two
dimensions for N > 4. In D4 the angle's representation is the sum of ``irrep(0, 2)`` (cosine) and ``irrep(1, 2)``
(sine), and in C4 the sum of two equal ones.
"""

from collections.abc import Sequence

import torch
from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.symmetry import WRENCH_PARTS, Kind, Part
from svfl_models.symmetry.groups import GROUPS, TORQUES, Group
from svfl_models.symmetry.planar_escnn import FieldType, GSpace2D, Representation, flipRot2dOnR2, rot2dOnR2


def plane(group: Group) -> GSpace2D:
    """Return the plane with a group acting on it, as escnn represents it.

    ``axis=0`` makes the flip y -> -y, as ``irrep(1, 1)`` has it. With escnn's default axis a mirrored image and a
    mirrored vector disagree: the image flips in x, the vector in y.

    Args:
        group: Group of rotations, with or without reflections.
    """
    return flipRot2dOnR2(group.rotations, axis=0.0) if group.mirrors else rot2dOnR2(group.rotations)


def wrench_parts(torque: str = "axial") -> tuple[Part, ...]:
    """Return the parts of a wrench, which say how its components transform.

    Args:
        torque: How the torque transforms. ``axial`` is correct. ``polar`` is the choice of the paper (Kohler et al.,
            CoRL 2023, section 4: R acts on m_xy, m_z is invariant), which is wrong under reflections and is kept to
            measure what this error costs.

    Raises:
        TrainingError: If `torque` is neither of the two.
    """
    if torque not in TORQUES:
        raise TrainingError(f"unknown torque typing {torque!r}; possible: {', '.join(TORQUES)}")
    if torque == "axial":
        return WRENCH_PARTS
    polar: dict[Kind, Kind] = {"axial": "vector", "pseudoscalar": "invariant"}
    return tuple(Part(polar.get(part.kind, part.kind), part.index) for part in WRENCH_PARTS)


def field_type(space: GSpace2D, group: Group, parts: Sequence[Part]) -> FieldType:
    """Return the escnn type of physical components, as `stored` arranges them.

    Args:
        space: The plane with the group acting on it, see `plane`.
        group: The group of `space`.
        parts: Parts that say how the components transform.
    """
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
    """Arrange physical components in the order and with the signs that `field_type` describes.

    Args:
        parts: Parts that say how the C components transform.
        physical: Physical components, shape (..., C).

    Returns:
        The arranged components, shape (..., C'). An angle x becomes cos 2x and sin 2x, so C' is C plus the number of
        angles.
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
    """Convert the output of a network to physical components, which is the inverse of `stored`.

    Args:
        parts: Parts that say how the C components transform.
        stored: Components as `field_type` describes them, shape (..., C).

    Returns:
        Physical components, shape (..., C).

    Raises:
        TrainingError: If a part is an angle, which cannot be read off its double; no network gives one.
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
    """Return the number of components that `stored` makes of parts."""
    return sum(len(part.index) * (2 if part.kind == "angle" else 1) for part in parts)


def regular_type(space: GSpace2D, fields: int) -> FieldType:
    """Return the type of hidden features: `fields` regular representations, channels ordered (field, group element)."""
    return FieldType(space, [space.regular_repr] * fields)


def image_type(space: GSpace2D, channels: int) -> FieldType:
    """Return the type of an image: a trivial field per channel, whose pixels move but whose values do not change."""
    return FieldType(space, [space.trivial_repr] * channels)


def restricted(kind: FieldType, group: Group) -> FieldType:
    """Restrict a type to the part of its group that permutes the four directions (`Group.subgroup`).

    C8 is restricted to C4, and D8 and D12 to D4. The features themselves do not change.

    Args:
        kind: Type of features under `group`.
        group: Group of the type.

    Returns:
        The type of the same features under the subgroup.
    """
    if group.subgroup() == group:
        return kind
    return kind.restrict((0, 4) if group.mirrors else 4)


def direction_type(space: GSpace2D) -> FieldType:
    """Return the type of the scores of the four directions, which are permuted like `svfl_data.symmetry.DIRECTIONS`.

    The reflection that fixes +x is ``(0, 1)`` in escnn's notation. Its cosets are the images of +x under D4, and escnn
    lists them in the order of the rotations: right, up, left, down. Without reflections the directions are the elements
    of C4.

    Args:
        space: The plane with D4 or C4 acting on it, see `plane`.

    Raises:
        TrainingError: If the group is neither D4 nor C4, the only ones with such a quotient of four elements.
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
    """Return the representations of (cos 2x, sin 2x), where x is an angle in the plane."""
    if group.rotations > 4:
        return [_irrep(space, group, 1, 2)]
    return [_irrep(space, group, 0, 2), _irrep(space, group, 1, 2)]
