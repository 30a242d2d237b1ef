"""The symmetry groups that a network can be built for: rotations of the plane, with or without reflections."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from svfl_data.errors import TrainingError
from svfl_data.symmetry import cyclic, dihedral

TORQUES = ("axial", "polar")
"""Allowed ways in which a torque transforms: as an axial vector, which is correct, or as a polar vector, as in the
paper, which is wrong for reflections."""


@dataclass(frozen=True)
class Group:
    """A finite group of rotations and reflections of the plane.

    Attributes:
        name: Name of the group: ``C`` (rotations only) or ``D`` (with reflections), then the number of rotations; or
            ``none`` for the trivial group.
        rotations: Number of rotations; neighbouring ones are 360 / `rotations` degrees apart.
        mirrors: Whether the group has reflections.

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
        """All elements as matrices of shape (2, 2), in image-aligned axes; rotations first, as escnn orders them."""
        return tuple(dihedral(self.rotations) if self.mirrors else cyclic(self.rotations))

    @cached_property
    def pixel_exact(self) -> tuple[np.ndarray, ...]:
        """The elements that map the pixels of a square image onto pixels: quarter turns and flips."""
        return tuple(g for g in self.elements if np.allclose(g, np.round(g)))

    def subgroup(self) -> "Group":
        """Return the part of the group that permutes the four directions: C4 or D4, or the trivial group for itself."""
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
"""The symmetry groups by name; ``none`` is the trivial group, whose networks are ordinary ones."""


def group_named(name: str) -> Group:
    """Return the group of a name.

    Args:
        name: Name of the group, one of `GROUPS`.

    Raises:
        TrainingError: If no group has this name.
    """
    if name not in GROUPS:
        raise TrainingError(f"unknown group {name!r}; possible: {', '.join(GROUPS)}")
    return GROUPS[name]
