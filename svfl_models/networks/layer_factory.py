"""Layer factories that networks are built from: one of symmetric layers for each group, and one of ordinary layers.

An encoder or a head is written once, against `Layers`. The layer factory that it is given decides whether it is
symmetric.
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
        group: Group that the layers commute with.
        copies: Number of channels per hidden unit.
    """

    group: Group
    copies: int

    def image(self, channels: int) -> T:
        """Return the type of an image with a number of channels."""

    def vector(self, parts: Sequence[Part]) -> T:
        """Return the type of the physical components that parts describe, as `representations.stored` arranges them."""

    def hidden(self, width: int) -> T:
        """Return the type of hidden features of `width` units, which have `width * copies` channels."""

    def joined(self, types: Sequence[T]) -> T:
        """Return the type of features that are concatenated from features of the given types."""

    def conv(self, source: T, target: T, kernel: int, padding: int) -> nn.Module:
        """Return a convolution that maps (B, C, H, W) to (B, C', H', W').

        Args:
            source: Type of the input, with C channels.
            target: Type of the output, with C' channels.
            kernel: Height and width of the kernel, [px].
            padding: Rows and columns of zeros that are added on each side, [px].
        """

    def linear(self, source: T, target: T) -> nn.Module:
        """Return a linear map of the last axis, from (..., C) of type `source` to (..., C') of type `target`."""

    def scores(self, source: T) -> nn.Module:
        """Return a linear map of the last axis to the scores of the four directions, from (..., C) to (..., 4)."""


class SymmetricLayers:
    """Factory of layers that are equivariant to a group.

    Args:
        group: Group that the layers commute with; any group but the trivial one.
    """

    def __init__(self, group: Group) -> None:
        self.group = group
        self.space = representations.plane(group)
        self.copies = len(group)

    def image(self, channels: int) -> FieldType:
        """Return the type of an image, in which each channel is a trivial field."""
        return representations.image_type(self.space, channels)

    def vector(self, parts: Sequence[Part]) -> FieldType:
        """Return the type of physical components: the representations of their parts, one after the other."""
        return representations.field_type(self.space, self.group, parts)

    def hidden(self, width: int) -> FieldType:
        """Return the type of hidden features: `width` regular fields."""
        return representations.regular_type(self.space, width)

    def joined(self, types: Sequence[FieldType]) -> FieldType:
        """Return the type of concatenated features, which is the direct sum of their types."""
        return FieldType(self.space, [one for kind in types for one in kind.representations])

    def conv(self, source: FieldType, target: FieldType, kernel: int, padding: int) -> nn.Module:
        """Return an equivariant convolution from type `source` to type `target`; see `Layers.conv`."""
        return SymmetricConv(source, target, kernel, padding)

    def linear(self, source: FieldType, target: FieldType) -> nn.Module:
        """Return an equivariant linear map of the last axis, from type `source` to type `target`."""
        return SymmetricLinear(source, target)

    def scores(self, source: FieldType) -> nn.Module:
        """Return a linear map to the scores of the four directions.

        The map is equivariant to the part of the group that permutes the four directions, see `Group.subgroup`.
        """
        source = representations.restricted(source, self.group)
        return SymmetricLinear(source, representations.direction_type(source.gspace))


def layer_factory(group: Group) -> Layers:
    """Return the layer factory of a group, which makes ordinary layers for the trivial group."""
    return SymmetricLayers(group) if len(group) > 1 else PlainLayers()
