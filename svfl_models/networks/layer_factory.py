"""The layer factories that networks are built from: one of symmetric layers for each group, one of ordinary layers.

An encoder or a head is written once, against `Layers`, and is symmetric or not by the layer factory that it is given.
"""

from collections.abc import Sequence
from typing import Protocol, TypeVar

from torch import nn

from svfl_data.symmetry import Part
from svfl_models.networks.baselines import PlainLayers
from svfl_models.symmetry import representations
from svfl_models.symmetry.groups import Group
from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear
from svfl_models.symmetry.planar_escnn import FieldType

T = TypeVar("T")


class Layers(Protocol[T]):
    """A factory of layers between features of types T.

    Attributes:
        group: What its layers commute with.
        copies: Channels per hidden unit.
    """

    group: Group
    copies: int

    def image(self, channels: int) -> T:
        """Type of an image."""

    def vector(self, parts: Sequence[Part]) -> T:
        """Type of the physical components described by parts, as `representations.stored` arranges them."""

    def hidden(self, width: int) -> T:
        """Type of hidden features of `width` units, `width * copies` channels."""

    def joined(self, types: Sequence[T]) -> T:
        """Type of features side by side."""

    def conv(self, source: T, target: T, kernel: int, padding: int) -> nn.Module:
        """Convolution (B, C, H, W) -> (B, C', H', W')."""

    def linear(self, source: T, target: T) -> nn.Module:
        """Linear map of the last axis: (..., C) -> (..., C')."""

    def scores(self, source: T) -> nn.Module:
        """Linear map of the last axis to the scores of the four directions: (..., C) -> (..., 4)."""


class SymmetricLayers:
    """Layers that are equivariant to a group.

    Args:
        group: Any but the trivial one.
    """

    def __init__(self, group: Group) -> None:
        self.group = group
        self.space = representations.plane(group)
        self.copies = len(group)

    def image(self, channels: int) -> FieldType:
        """Image channels as trivial fields."""
        return representations.image_type(self.space, channels)

    def vector(self, parts: Sequence[Part]) -> FieldType:
        """The representations of the parts, one after the other."""
        return representations.field_type(self.space, self.group, parts)

    def hidden(self, width: int) -> FieldType:
        """Regular fields."""
        return representations.regular_type(self.space, width)

    def joined(self, types: Sequence[FieldType]) -> FieldType:
        """Direct sum."""
        return FieldType(self.space, [one for kind in types for one in kind.representations])

    def conv(self, source: FieldType, target: FieldType, kernel: int, padding: int) -> nn.Module:
        """Equivariant convolution."""
        return SymmetricConv(source, target, kernel, padding)

    def linear(self, source: FieldType, target: FieldType) -> nn.Module:
        """Equivariant linear map."""
        return SymmetricLinear(source, target)

    def scores(self, source: FieldType) -> nn.Module:
        """Equivariant to the part of the group that permutes four directions."""
        source = representations.restricted(source, self.group)
        return SymmetricLinear(source, representations.direction_type(source.gspace))


def layer_factory(group: Group) -> Layers:
    """The layers for a group; ordinary ones for the trivial group."""
    return SymmetricLayers(group) if len(group) > 1 else PlainLayers()
