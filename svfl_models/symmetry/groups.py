"""The symmetry groups that a network can be built for: rotations of the plane, with or without reflections."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from svfl_data.errors import TrainingError
from svfl_data.symmetry import cyclic, dihedral

TORQUES = ("axial", "polar")
"""How a torque may be typed: as it is, or as the paper types it, which is wrong for reflections."""


@dataclass(frozen=True)
class Group:
    """A finite group of rotations and reflections of the plane.

    Attributes:
        name: ``C`` rotations only, ``D`` with reflections, and the number of rotations.
        rotations: How many; neighbours are 360 / `rotations` degrees apart.
        mirrors: Whether reflections belong to it.

    Example:
        >>> len(GROUPS["D4"]), GROUPS["D4"].name
        (8, 'D4')
    """

    name: str
    rotations: int
    mirrors: bool

    def __len__(self) -> int:
        return self.rotations * (2 if self.mirrors else 1)

    @cached_property
    def elements(self) -> tuple[np.ndarray, ...]:
        """All elements as matrices of shape (2, 2), image-aligned axes; rotations first, as escnn orders them."""
        return tuple(dihedral(self.rotations) if self.mirrors else cyclic(self.rotations))

    @cached_property
    def pixel_exact(self) -> tuple[np.ndarray, ...]:
        """Those elements that map the pixels of a square image onto pixels: quarter turns and flips."""
        return tuple(g for g in self.elements if np.allclose(g, np.round(g)))

    def subgroup(self) -> "Group":
        """The part that permutes four directions: C4 or D4; of the trivial group, itself."""
        return self if len(self) == 1 else GROUPS["D4" if self.mirrors else "C4"]


GROUPS = {
    group.name: group
    for group in (
        Group("D4", 4, True),
        Group("C4", 4, False),
        Group("C8", 8, False),
        Group("D8", 8, True),
        Group("D12", 12, True),
        Group("none", 1, False),
    )
}
"""By name; ``none`` is the trivial group, whose networks are ordinary ones."""


def group_named(name: str) -> Group:
    """The group of a name.

    Raises:
        TrainingError: If there is none.
    """
    if name not in GROUPS:
        raise TrainingError(f"unknown group {name!r}; possible: {', '.join(GROUPS)}")
    return GROUPS[name]
