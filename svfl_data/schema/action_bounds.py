"""How far one action may go: from the configuration of an episode, or else the paper's.

Whoever records with other bounds says so in the configuration, ``Meta.config = {"max_move": 0.1, "max_turn": 0.5}``;
simulated episodes have both in ``config["world"]``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

MAX_MOVE_M, MAX_TURN_RAD = 0.025, math.pi / 16
"""Of the paper (Kohler et al., CoRL 2023, section 5)."""
ROUNDING = 1e-3
"""Share by which float32 actions may exceed their bounds."""
DECLARED = "config"
COMPONENTS = (("the gripper opening", ""), ("dx", " m"), ("dy", " m"), ("dz", " m"), ("dtheta", " rad"))


@dataclass(frozen=True)
class ActionBounds:
    """What an action (gripper opening, dx, dy, dz, dtheta) may be.

    Attributes:
        move: Largest dx, dy, dz, [m].
        turn: Largest dtheta, [rad].
        origin: Where they come from, in words.
    """

    move: float = MAX_MOVE_M
    turn: float = MAX_TURN_RAD
    origin: str = "the paper, the config says none"

    @classmethod
    def of(cls, config: Mapping[str, Any]) -> "ActionBounds":
        """Those of an episode's configuration."""
        found = config.get("world", config)
        move, turn = (found.get(name) for name in ("max_move", "max_turn")) if isinstance(found, dict) else (None, None)
        return cls(float(move), float(turn), DECLARED) if _positive(move) and _positive(turn) else cls()  # type: ignore[arg-type] # _positive: a number

    @property
    def declared(self) -> bool:
        """Whether an episode's configuration says so."""
        return self.origin == DECLARED

    @property
    def low(self) -> np.ndarray:
        """Smallest, (5,)."""
        return np.array([0.0, -self.move, -self.move, -self.move, -self.turn])

    @property
    def high(self) -> np.ndarray:
        """Largest, (5,)."""
        return np.array([1.0, self.move, self.move, self.move, self.turn])

    def outside(self, actions: np.ndarray) -> np.ndarray:
        """Which numbers of actions (..., 5) are beyond the bounds, same shape, bool."""
        room = ROUNDING * (self.high - self.low) / 2
        return (actions < self.low - room) | (actions > self.high + room)

    def fault(self, actions: np.ndarray) -> tuple[int, str] | None:
        """The first action that is beyond the bounds.

        Args:
            actions: Shape (N, 5).

        Returns:
            Its row and what is wrong, or None if all are within.
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
