"""What can be set about a replay buffer."""

from dataclasses import dataclass
from numbers import Integral

from svfl_data.errors import UsageError
from svfl_data.sampling.windows import WINDOW

COUNTS = {"crop": 1, "frames": 1, "window": 1, "n_step": 1, "beta_samples": 1, "group_order": 1, "seed": 0}
"""The least that each whole number may be."""


@dataclass(frozen=True)
class ReplayConfig:
    """How transitions are prioritised and cut.

    Attributes:
        crop: Height and width of the images of a batch, cut at random, [px].
        frames: Images of an observation, K: those of the last K observations, oldest first; before an episode began
            there is its first one. More than one are stacked, (B, K, 4, h, h).
        window: Wrench readings of an observation, T.
        n_step: Steps from s to s', where the episode does not end before.
        gamma: Discount of one step.
        alpha: Power of the priorities; 0 draws all transitions equally often.
        beta: Power of the importance weights at first; it grows evenly to 1.
        beta_samples: Transitions drawn until it is 1; by default those of the paper's training, 35,000 batches of 64.
        expert_bonus: What a demonstration's error counts more, whatever its size.
        rotate: Whether each transition of a batch is rotated or reflected by a random element of D_N.
        group_order: The number N of rotations to choose from; there are as many reflections. N = 4 moves pixels onto
            pixels; others, such as 8 or 12, interpolate images (`svfl_data.replay.symmetry_augmentation`) but rotate
            vectors exactly, too.
        seed: Of everything that is drawn.

    Source of alpha, beta and the bonus: Kohler et al., CoRL 2023, section 5 and published code.

    Example:
        >>> ReplayConfig(crop=12, rotate=True, group_order=8).group_order
        8
    """

    crop: int = 64
    frames: int = 1
    window: int = WINDOW
    n_step: int = 1
    gamma: float = 0.99
    alpha: float = 0.6
    beta: float = 0.4
    beta_samples: int = 35_000 * 64
    expert_bonus: float = 1.0
    rotate: bool = False
    group_order: int = 4
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            UsageError: If one is out of range.
        """
        for name, least in COUNTS.items():
            value = getattr(self, name)
            if not isinstance(value, Integral) or value < least:
                raise UsageError(f"{name} is {value}; it must be at least {least}, and a whole number")
            object.__setattr__(self, name, int(value))  # NumPy's integers cannot be saved
        for name in ("gamma", "alpha", "beta"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} is {getattr(self, name)}; it must be from 0 to 1")
        if not 0 <= self.expert_bonus < float("inf"):
            raise UsageError(f"expert_bonus is {self.expert_bonus}; it must be a number from 0 upwards")
