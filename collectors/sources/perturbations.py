"""Shoves: disturbances after which a demonstration shows the way back.

An expert who never errs never shows what to do after an error, and a policy that is cloned from it is lost after its
own first one. So the hand is pushed off its way now and then while the expert goes on; what it meant to do is kept
beside what was done. The idea is that of DART (Laskey, Lee, Fox, Dragan, Goldberg, "DART: Noise Injection for Robust
Imitation Learning", CoRL 2017), whose noise is small and never rests; an expert that waits until it has arrived would
never arrive under that.
"""

import numpy as np
from numpy.typing import NDArray

from collectors.tasks.hand import Moves
from svfl_data.schema.robot import Observation

LONGEST = 3
"""Actions of a shove, at most: with the largest action of 25 mm, up to 75 mm along each axis."""


class Shoved:
    """An expert's moves, some of which are replaced by shoves; a policy for `collectors.recording.loop.record`.

    A shove is the same move 1 to `LONGEST` times, uniform within the bounds of an action. A hand that rests, such as
    while it grasps, is not shoved, and the gripper does what the expert wants.

    Args:
        moves: Of the expert, each made after the one before was carried out.
        bound: Largest move: dx, dy, dz [m], dtheta [rad], shape (4,).
        rate: How likely a shove is to begin at an action, 0..1.
        rng: Decides on the shoves; untouched if `rate` is 0.

    Attributes:
        intended: What the expert meant, one action (5,) float32 for each that was given out.
    """

    def __init__(self, moves: Moves, bound: NDArray[np.float64], rate: float, rng: np.random.Generator) -> None:
        self._moves, self._bound, self._rate, self._rng = moves, bound, rate, rng
        self._left, self._shove = 0, np.zeros(4)
        self.intended: list[NDArray[np.float32]] = []

    def __call__(self, observation: Observation) -> NDArray[np.float32] | None:
        """What to do; None when the expert has nothing more to do."""
        meant = next(self._moves, None)
        if meant is None:
            return None
        self.intended.append(meant)
        if self._rate and self._left == 0 and self._rng.uniform() < self._rate:
            self._left = int(self._rng.integers(1, LONGEST + 1))
            self._shove = self._bound * self._rng.uniform(-1, 1, 4)
        if self._left == 0:
            return meant
        self._left -= 1
        if not meant[1:].any():
            return meant
        return np.array([meant[0], *self._shove], np.float32)
