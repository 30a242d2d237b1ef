"""Perturbations: disturbances after which a demonstration shows the way back.

An expert who never errs never shows what to do after an error, and a policy that is cloned from it is lost after its
own first one. So the gripper is pushed off its way now and then while the expert goes on; what it meant to do is kept
beside what was done. The idea is that of DART (Laskey, Lee, Fox, Dragan, Goldberg, "DART: Noise Injection for Robust
Imitation Learning", CoRL 2017), whose noise is small and never rests; an expert that waits until it has arrived would
never arrive under that.
"""

import numpy as np
from numpy.typing import NDArray

from collectors.tasks.gripper import Moves
from svfl_data.schema.robot import Observation

LONGEST = 3
"""Actions of a perturbation, at most: with the largest action of 25 mm, up to 75 mm along each axis."""


class Perturbed:
    """An expert's moves, some of which are replaced by perturbations; a policy for `collectors.recording.loop.record`.

    A perturbation is the same move 1 to `LONGEST` times, uniform within the bounds of an action. A gripper that rests,
    such as while it grasps, is not perturbed, and the gripper does what the expert wants.

    Args:
        moves: Of the expert, each made after the one before was carried out.
        bound: Largest move: dx, dy, dz [m], dtheta [rad], shape (4,).
        rate: How likely a perturbation is to begin at an action, 0..1.
        rng: Decides on the perturbations; untouched if `rate` is 0.

    Attributes:
        expert_action: What the expert meant, one action (5,) float32 for each that was given out.
    """

    def __init__(self, moves: Moves, bound: NDArray[np.float64], rate: float, rng: np.random.Generator) -> None:
        self._moves, self._bound, self._rate, self._rng = moves, bound, rate, rng
        self._left, self._perturbation = 0, np.zeros(4)
        self.expert_action: list[NDArray[np.float32]] = []

    def __call__(self, observation: Observation) -> NDArray[np.float32] | None:
        """What to do; None when the expert has nothing more to do."""
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
