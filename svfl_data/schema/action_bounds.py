"""Bounds of one action, from the configuration of an episode, or else from the paper (Kohler et al., CoRL 2023).

A recording with other bounds than the paper's declares them in its configuration, ``Meta.config = {"max_move": 0.1,
"max_turn": 0.5}``. Simulated episodes have both bounds in ``config["world"]``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MAX_MOVE_M, MAX_TURN_RAD = 0.025, math.pi / 16
"""Largest displacement along each axis, [m], and largest yaw change, [rad], of one action in the paper (Kohler et al.,
CoRL 2023, section 5)."""
ROUNDING = 1e-3
"""Fraction of half the range of a component by which float32 actions may exceed their bounds."""
DECLARED = "config"
COMPONENTS = (("the gripper opening", ""), ("dx", " m"), ("dy", " m"), ("dz", " m"), ("dtheta", " rad"))


@dataclass(frozen=True)
class ActionBounds:
    """Bounds of an action (gripper opening, dx, dy, dz, dtheta).

    Attributes:
        move: Largest magnitude of dx, dy and dz, [m].
        turn: Largest magnitude of dtheta, [rad].
        origin: Source of the bounds in words, which is ``config`` if the configuration of the episode declares them.
    """

    move: float = MAX_MOVE_M
    turn: float = MAX_TURN_RAD
    origin: str = "the paper, the config says none"

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> "ActionBounds":
        """Return the bounds that the configuration of an episode declares, or else those of the paper.

        Args:
            config: Configuration of the episode (`Meta.config`).
        """
        found = config.get("world", config)
        move, turn = (found.get(name) for name in ("max_move", "max_turn")) if isinstance(found, dict) else (None, None)
        return cls(float(move), float(turn), DECLARED) if _positive(move) and _positive(turn) else cls()  # type: ignore[arg-type] # _positive: a number

    @property
    def declared(self) -> bool:
        """Whether the configuration of the episode declares the bounds."""
        return self.origin == DECLARED

    @property
    def low(self) -> np.ndarray:
        """Smallest action, shape (5,), [-, m, m, m, rad]."""
        return np.array([0.0, -self.move, -self.move, -self.move, -self.turn])

    @property
    def high(self) -> np.ndarray:
        """Largest action, shape (5,), [-, m, m, m, rad]."""
        return np.array([1.0, self.move, self.move, self.move, self.turn])

    def outside(self, actions: np.ndarray) -> np.ndarray:
        """Return which components of actions are beyond the bounds.

        Args:
            actions: Actions, shape (..., 5).

        Returns:
            True for each component that is beyond its bounds, same shape, bool.
        """
        room = ROUNDING * (self.high - self.low) / 2
        return (actions < self.low - room) | (actions > self.high + room)

    def fault(self, actions: np.ndarray) -> tuple[int, str] | None:
        """Return the first action that is beyond the bounds, and what is wrong with it.

        Args:
            actions: Actions, shape (N, 5).

        Returns:
            Row of the action and a description of the fault, or None if all actions are within the bounds.
        """
        outside = self.outside(actions)
        if not outside.any():
            return None
        row, column = (int(i) for i in np.argwhere(outside)[0])
        name, unit = COMPONENTS[column]
        return row, (
            f"{name} is {actions[row, column]:.4g}{unit}, outside {self.low[column]:.4g} to {self.high[column]:.4g}"
            f"{unit} (bounds: {self.origin}); {outside.any(axis=1).sum()} of {len(actions)} actions are out of bounds"
        )


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value < math.inf
