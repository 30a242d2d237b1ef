"""What a network needs of an action: how its components transform, and the bounds of its commands."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from torch import Tensor

from svfl_data.errors import TrainingError
from svfl_data.schema.action_fields import planar_action
from svfl_data.schema.field import Field
from svfl_data.symmetry import Part
from svfl_models.networks.input_types import parts_of_plain, plain_parts

DEVIATION_SHARED = ("vector", "axial")
"""Kinds of parts whose components have one standard deviation and one scale, because a rotation mixes them."""


@dataclass(frozen=True)
class ActionSpace:
    """Parts and bounds of an action with C components.

    Attributes:
        parts: Parts of the components; together they cover each component once.
        low: Smallest command of each component, in its unit.
        high: Largest command of each component, in its unit.
        opening: Index of the component that opens and closes a gripper from 0 to 1; None if there is none.
        names: Name of each component; empty if they have no names.

    Example:
        >>> ActionSpace.of(planar_action(max_move=0.05)).scale[1]
        0.05
    """

    parts: tuple[Part, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    opening: int | None = None
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        covered = sorted(index for part in self.parts for index in part.index)
        if covered != list(range(len(self.low))) or len(self.low) != len(self.high):
            raise TrainingError(f"an action with bounds of {len(self.low)} components has parts of {covered}")
        for part in self.parts:
            if part.kind == "angle":
                raise TrainingError("an action cannot be an absolute angle in the plane; a change of an angle can be")
            bounds = {(self.low[index], self.high[index]) for index in part.index}
            if part.kind in DEVIATION_SHARED and (len(bounds) > 1 or sum(*bounds) != 0):
                raise TrainingError(f"the bounds of a {part.kind} must be equal and symmetric about 0, got {bounds}")
            if part.kind == "pseudoscalar" and any(self.low[index] != -self.high[index] for index in part.index):
                raise TrainingError(f"the bounds of a pseudoscalar must be symmetric about 0, got {bounds}")

    @classmethod
    def of(cls, field: Field, symmetric: bool = True) -> "ActionSpace":
        """Return the space of a declared action.

        Args:
            field: Declaration of the action, with bounds.
            symmetric: Whether the network is symmetric, or its samples are rotated. Otherwise an action without parts,
                such as one in joint space, consists of invariants.

        Raises:
            TrainingError: If the action has no bounds, or a symmetric network asks for parts that it does not have.
        """
        if not field.bounds:
            raise TrainingError(f"{field.path} is declared without bounds, which a network needs")
        low, high = zip(*field.bounds, strict=True)
        opening = field.components.index("opening") if "opening" in field.components else None
        return cls(parts_of(field, symmetric), low, high, opening, field.components)

    @classmethod
    def of_plain(cls, values: dict[str, Any]) -> "ActionSpace":
        """Restore a space from the plain values that `plain` returned."""
        return cls(
            parts_of_plain(values["parts"]),
            tuple(values["low"]),
            tuple(values["high"]),
            values["opening"],
            tuple(values["names"]),
        )

    def plain(self) -> dict[str, Any]:
        """Return the space as plain values for files."""
        bounds = {"low": list(self.low), "high": list(self.high)}
        return {"parts": plain_parts(self.parts), **bounds, "opening": self.opening, "names": list(self.names)}

    def __len__(self) -> int:
        return len(self.low)

    @cached_property
    def centre(self) -> tuple[float, ...]:
        """Middle of the bounds of each component."""
        return tuple((low + high) / 2 for low, high in zip(self.low, self.high, strict=True))

    @cached_property
    def scale(self) -> tuple[float, ...]:
        """Half the width of the bounds of each component."""
        return tuple((high - low) / 2 for low, high in zip(self.low, self.high, strict=True))

    @cached_property
    def deviation_of(self) -> tuple[int, ...]:
        """Number of the standard deviation that each component has; the components of a vector share one."""
        found: dict[int, int] = {}
        count = 0
        for part in self.parts:
            for index in part.index:
                found[index] = count
                count += part.kind not in DEVIATION_SHARED
            count += part.kind in DEVIATION_SHARED
        return tuple(found[index] for index in range(len(self)))

    @cached_property
    def policy_parts(self) -> tuple[Part, ...]:
        """Parts of an actor's output: the mean before squashing, then the logarithms of the standard deviations."""
        first, count = len(self), max(self.deviation_of) + 1
        return (*self.parts, Part("invariant", tuple(range(first, first + count))))

    def to_unit(self, action: Tensor) -> Tensor:
        """Scale physical actions to -1..1 in every component, which commutes with the group.

        Args:
            action: Actions in physical units, shape (..., C).

        Returns:
            The scaled actions, of the same shape, dimensionless.
        """
        return (action - action.new_tensor(self.centre)) / action.new_tensor(self.scale)

    def to_physical(self, unit: Tensor) -> Tensor:
        """Scale actions of -1..1 back to physical units, which is the inverse of `to_unit`.

        Args:
            unit: Scaled actions, shape (..., C), dimensionless.
        """
        return unit.new_tensor(self.centre) + unit.new_tensor(self.scale) * unit


def parts_of(field: Field, symmetric: bool) -> tuple[Part, ...]:
    """Return the parts of a field's last axis, for a network.

    Args:
        field: Declaration of the field.
        symmetric: Whether the network is symmetric, or its samples are rotated. Otherwise a field without parts
            consists of invariants.

    Raises:
        TrainingError: If the field has no parts but the network is symmetric.
    """
    if field.parts:
        return field.parts
    if symmetric:
        raise TrainingError(
            f"{field.path} has no planar parts, so it does not declare how it transforms; a plain network (group none) "
            "takes it if samples are not rotated"
        )
    last = field.shape[-1] if len(field.shape) > 1 else 1
    return (Part("invariant", tuple(range(int(last)))),)


PLANAR = ActionSpace.of(planar_action())
"""The paper's action: gripper opening, dx, dy, dz [m], dtheta [rad] (Kohler et al., CoRL 2023, section 5)."""
