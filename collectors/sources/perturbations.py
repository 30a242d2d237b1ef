"""Perturbations of the gripper, so that demonstrations show how to recover from errors.

An expert that never makes an error never shows what to do after an error, and a policy that is cloned from the expert
cannot recover from its own first error. Therefore the gripper is pushed off its path at random times while the expert
continues, and the action that the expert meant is kept beside the action that was carried out. The idea is that of DART
(Laskey, Lee, Fox, Dragan, Goldberg, "DART: Noise Injection for Robust Imitation Learning", CoRL 2017). DART's noise is
small and acts at every step; with such noise, an expert that waits until it has arrived would never arrive.
"""

import numpy as np
from numpy.typing import NDArray

from collectors.tasks.gripper import Moves
from svfl_data.schema.robot import Observation

LONGEST = 3
"""Largest number of actions of a perturbation. With the largest action of 25 mm it is up to 75 mm along each axis."""


class Perturbed:
    """Policy for `collectors.recording.loop.record` that replaces some of an expert's actions by perturbations.

    A perturbation is the same move for 1 to `LONGEST` actions, drawn uniformly within the bounds of an action. It does
    not change the gripper opening, and it does not replace an action in which the gripper rests, such as while it
    grasps.

    Args:
        moves: Actions of the expert. Each action is taken after the one before it was carried out.
        bound: Largest absolute dx, dy, dz [m] and dtheta [rad] of an action, shape (4,).
        rate: Probability, 0..1, that a perturbation begins at an action.
        rng: Source of the random numbers of the perturbations. It is not used if `rate` is 0.

    Attributes:
        expert_action: Actions that the expert meant, (5,) float32 each, one for each action that was returned.
    """

    def __init__(self, moves: Moves, bound: NDArray[np.float64], rate: float, rng: np.random.Generator) -> None:
        self._moves, self._bound, self._rate, self._rng = moves, bound, rate, rng
        self._left, self._perturbation = 0, np.zeros(4)
        self.expert_action: list[NDArray[np.float32]] = []

    def __call__(self, observation: Observation) -> NDArray[np.float32] | None:
        """Return the next action, (5,) float32, or None when the expert has no further action."""
        meant = next(self._moves, None)
        if meant is None:
            return None
        self.expert_action.append(meant)
        if self._rate and self._left == 0 and self._rng.uniform() < self._rate:
            self._left = int(self._rng.integers(1, LONGEST + 1))
            self._perturbation = self._bound * self._rng.uniform(-1, 1, 4)
        if self._left == 0:
            return meant
        self._left -= 1
        if not meant[1:].any():
            return meant
        return np.array([meant[0], *self._perturbation], np.float32)
