"""What can be set about a replay buffer."""

from dataclasses import dataclass

from svfl_data.errors import UsageError
from svfl_data.windows import WINDOW


@dataclass(frozen=True)
class ReplayConfig:
    """How transitions are prioritised and cut.

    Attributes:
        crop: Height and width of the images of a batch, cut at random, [px].
        window: Wrench readings of an observation, T.
        n_step: Steps from s to s', where the episode does not end before.
        gamma: Discount of one step.
        alpha: Power of the priorities; 0 draws all transitions equally often.
        beta: Power of the importance weights at first; it grows evenly to 1.
        beta_samples: Transitions drawn until it is 1; by default those of the paper's training, 35,000 batches of 64.
        expert_bonus: What a demonstration's error counts more, whatever its size.
        rotate: Turn and mirror each transition of a batch by a random element of D4.
        seed: Of everything that is drawn.

    Source of alpha, beta and the bonus: Kohler et al., CoRL 2023, section 5 and published code.
    """

    crop: int = 64
    window: int = WINDOW
    n_step: int = 1
    gamma: float = 0.99
    alpha: float = 0.6
    beta: float = 0.4
    beta_samples: int = 35_000 * 64
    expert_bonus: float = 1.0
    rotate: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            UsageError: If one is out of range.
        """
        for name in ("crop", "window", "n_step", "beta_samples"):
            if getattr(self, name) < 1:
                raise UsageError(f"{name} is {getattr(self, name)}; it must be at least 1")
        for name in ("gamma", "alpha", "beta"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} is {getattr(self, name)}; it must be from 0 to 1")
        if not 0 <= self.expert_bonus < float("inf"):
            raise UsageError(f"expert_bonus is {self.expert_bonus}; it must be a number from 0 upwards")
