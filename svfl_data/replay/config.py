"""Settings of a replay buffer."""

from dataclasses import dataclass
from numbers import Integral

from svfl_data.errors import UsageError
from svfl_data.sampling.windows import WINDOW

COUNTS = {"crop": 1, "frames": 1, "window": 1, "n_step": 1, "beta_samples": 1, "group_order": 1, "seed": 0}
"""Smallest allowed value of each setting that is a whole number."""


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the priorities and of the batches of a replay buffer.

    Attributes:
        crop: Height and width of the images of a batch, which are cut at random positions, [px]. None for whole images.
        frames: Number of images per observation of the paper's inputs, K: the images of the last K observations, oldest
            first. Where the episode has fewer observations so far, its first image is repeated. With K > 1, the images
            of a batch are stacked, shape (B, K, 4, h, h).
        window: Number of wrench readings per observation of the paper's inputs, T. Other inputs say their numbers of
            frames and readings themselves (`svfl_data.schema.input_spec.InputSpec`).
        n_step: Number of steps from s to s'; fewer where the episode ends before.
        gamma: Discount factor of one step, from 0 to 1.
        alpha: Exponent of the priorities, from 0 to 1. With 0, all transitions are drawn equally often.
        beta: Initial exponent of the importance weights, from 0 to 1. It grows linearly to 1.
        beta_samples: Number of transitions drawn until beta is 1. By default the number of the paper's training,
            35,000 batches of 64.
        expert_bonus: Value added to the absolute TD error of each transition of a demonstration in its priority, at
            least 0.
        rotate: Whether each transition of a batch is rotated or reflected by a random element of D_N.
        group_order: Number N of the rotations of D_N, which has as many reflections. With N = 1, 2 or 4, pixels move
            onto pixels. With another N, such as 8 or 12, images are interpolated
            (`svfl_data.replay.symmetry_augmentation`), but vectors are still rotated exactly.
        seed: Seed of all random draws of the buffer.

    Source of alpha, beta and the bonus: Kohler et al., CoRL 2023, section 5 and published code.

    Example:
        >>> ReplayConfig(crop=12, rotate=True, group_order=8).group_order
        8
    """

    crop: int | None = 64
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
            UsageError: If a number is out of range.
        """
        for name, least in COUNTS.items():
            value = getattr(self, name)
            if name == "crop" and value is None:
                continue
            if not isinstance(value, Integral) or value < least:
                raise UsageError(f"{name} is {value}; it must be at least {least}, and a whole number")
            object.__setattr__(self, name, int(value))  # NumPy's integers cannot be saved
        for name in ("gamma", "alpha", "beta"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} is {getattr(self, name)}; it must be from 0 to 1")
        if not 0 <= self.expert_bonus < float("inf"):
            raise UsageError(f"expert_bonus is {self.expert_bonus}; it must be a number from 0 upwards")
