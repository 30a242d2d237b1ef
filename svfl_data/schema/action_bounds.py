"""Comparison of actions with the bounds that their declaration gives."""

from dataclasses import dataclass

import numpy as np

from svfl_data.errors import FieldError
from svfl_data.schema.action_fields import planar_action
from svfl_data.schema.field import Field
from svfl_data.schema.field_words import component_names, component_units

ROUNDING = 1e-3
"""Fraction of half the range of a component by which float32 actions may exceed their bounds."""


@dataclass(frozen=True)
class ActionBounds:
    """Bounds of an action with C components.

    Attributes:
        low: Smallest action, shape (C,), in the units of the components.
        high: Largest action, shape (C,).
        names: Name of each component.
        units: Unit of each component; empty if it has none.
        assumed: Whether the bounds are an assumption, because the source of the data did not say.
    """

    low: np.ndarray
    high: np.ndarray
    names: tuple[str, ...]
    units: tuple[str, ...]
    assumed: bool = False

    @classmethod
    def of(cls, field: Field) -> "ActionBounds | None":
        """Return the bounds of a declared action; None if it is declared without bounds.

        Args:
            field: Declaration of the action.
        """
        if not field.bounds:
            return None
        low, high = np.array(field.bounds).T
        row = (len(low),)
        names, units = tuple(component_names(field, row)), tuple(component_units(field, row))
        return cls(low, high, names, units, "bounds" in field.assumed)

    def outside(self, actions: np.ndarray) -> np.ndarray:
        """Return which components of actions are beyond the bounds.

        Args:
            actions: Actions, shape (..., C).

        Returns:
            True for each component that is beyond its bounds, same shape, bool.
        """
        room = ROUNDING * (self.high - self.low) / 2
        return (actions < self.low - room) | (actions > self.high + room)

    def fault(self, actions: np.ndarray) -> tuple[int, str] | None:
        """Return the first action that is beyond the bounds, and what is wrong with it.

        Args:
            actions: Actions, shape (N, C).

        Returns:
            Row of the action and a description of the fault, or None if all actions are within the bounds.
        """
        outside = self.outside(actions)
        if not outside.any():
            return None
        row, column = (int(i) for i in np.argwhere(outside)[0])
        unit = f" {self.units[column]}" if self.units[column] else ""
        return row, (
            f"{self.names[column]} is {actions[row, column]:.4g}{unit}, outside {self.low[column]:.4g} to "
            f"{self.high[column]:.4g}{unit} ({'assumed' if self.assumed else 'declared'} bounds); "
            f"{outside.any(axis=1).sum()} of {len(actions)} actions are out of bounds"
        )


def planar_limits(field: Field) -> tuple[float, float]:
    """Return the largest displacement along an axis, [m], and the largest turn, [rad], of a planar action.

    Args:
        field: Declaration of ``actions/action``.

    Raises:
        FieldError: If the action is another one than gripper opening, dx, dy, dz and dtheta, or has no bounds.
    """
    move, turn = (field.bounds[1][1], field.bounds[4][1]) if len(field.bounds) == 5 else (0.0, 0.0)
    if not (move > 0 and turn > 0) or field.bounds != planar_action(move, turn).bounds:
        found = ", ".join(field.components) or f"{field.shape_words} without names"
        raise FieldError(
            f"{field.path} has the components {found}; this needs the planar action (opening, dx, dy, dz, dtheta) with "
            "equal bounds of dx, dy and dz"
        )
    return move, turn
