"""Symmetric layers on plain tensors, and the kit that builds them.

escnn solves for the kernels that commute with the group; `SymmetricConv` and `SymmetricLinear` expand them from
learned weights and hand them to PyTorch's own operations. Layers keep a field's group channels together: channels
are ordered (field, group element), so that splitting channels into contiguous runs of whole fields, as attention
heads do, keeps the symmetry.
"""

from collections import defaultdict
from typing import Protocol, TypeVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import Part
from svfl_models.planar_escnn import FieldType, R2Conv
from svfl_models.representations import dihedral_space, direction_type, field_type, image_type, regular_type

T = TypeVar("T")


class Layers(Protocol[T]):
    """A kit of layers between features of types T; encoders are written once and built from either kit.

    Attributes:
        copies: Channels per hidden unit.
    """

    copies: int

    def image(self, channels: int) -> T:
        """Type of an image."""

    def vector(self, parts: tuple[Part, ...]) -> T:
        """Type of the physical components described by parts, as `representations.field_basis` stores them."""

    def hidden(self, width: int) -> T:
        """Type of hidden features of `width` units, `width * copies` channels."""

    def directions(self) -> T:
        """Type of the scores of the four directions."""

    def conv(self, source: T, target: T, kernel: int, padding: int) -> nn.Module:
        """Convolution (B, C, H, W) -> (B, C', H', W')."""

    def linear(self, source: T, target: T) -> nn.Module:
        """Linear map of the last axis: (..., C) -> (..., C')."""


class SymmetricLayers:
    """Layers that are equivariant to the dihedral group D_N.

    Args:
        order: N; the group has 2 N elements.
    """

    def __init__(self, order: int = 4) -> None:
        self.space = dihedral_space(order)
        self.copies = 2 * order

    def image(self, channels: int) -> FieldType:
        """Image channels as trivial fields."""
        return image_type(self.space, channels)

    def vector(self, parts: tuple[Part, ...]) -> FieldType:
        """One irreducible representation per part."""
        return field_type(self.space, parts)

    def hidden(self, width: int) -> FieldType:
        """Regular fields."""
        return regular_type(self.space, width)

    def directions(self) -> FieldType:
        """Quotient representation of D4."""
        return direction_type(self.space)

    def conv(self, source: FieldType, target: FieldType, kernel: int, padding: int) -> nn.Module:
        """Equivariant convolution."""
        return SymmetricConv(source, target, kernel, padding)

    def linear(self, source: FieldType, target: FieldType) -> nn.Module:
        """Equivariant linear map."""
        return SymmetricLinear(source, target, kernel_size=1, padding=0)


class SymmetricConv(R2Conv):
    """escnn's planar convolution on plain tensors, whose filter always follows its weights.

    escnn keeps the expanded filter while in eval mode: weights that change there (an optimiser step, averaging,
    loading) have no effect, the keys of the state dict depend on the last mode, and copies fail. Expanding costs one
    to two per cent of a training step, so here it is done in every call and nothing is kept. The kernel basis is this
    module's own (``recompute``), not shared with every other network of the process, so that moving one network to
    another dtype or device leaves the others alone; it is saved with the weights, which mean nothing without it.

    Args:
        source: Type of the input.
        target: Type of the output.
        kernel_size: Side of the square kernel.
        padding: Zeros on each side.
    """

    def __init__(self, source: FieldType, target: FieldType, kernel_size: int, padding: int) -> None:
        super().__init__(source, target, kernel_size, padding=padding, initialize=False, recompute=True)
        self._buffers.pop("filter")
        self._buffers.pop("expanded_bias", None)
        with torch.no_grad():
            self.weights.copy_(initial_deviations(self) * torch.randn_like(self.weights))

    def train(self, mode: bool = True) -> "SymmetricConv":
        """Set the mode; there is no cached filter to keep in step with it."""
        nn.Module.train(self, mode)
        return self

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C', H', W')."""
        kernel, bias = self.expand_parameters()
        return functional.conv2d(x, kernel, bias, padding=self.padding)


class SymmetricLinear(SymmetricConv):
    """Equivariant linear map of the last axis: a 1 x 1 convolution's kernel as a matrix, never as a convolution."""

    def forward(self, x: Tensor) -> Tensor:
        """(..., C) -> (..., C')."""
        kernel, bias = self.expand_parameters()
        return functional.linear(x, kernel[:, :, 0, 0], bias)


def initial_deviations(conv: R2Conv) -> Tensor:
    """Standard deviation of each weight for an output of the input's variance: He's rule on irreducible parts.

    An output irrep that sees d different input irreps, the j-th through n_j basis kernels, gets deviations
    1 / sqrt(d n_j). That is ``escnn.nn.init.generalized_he_init`` (Weiler & Cesa, NeurIPS 2019, appendix), which
    visits every weight in Python; fields of equal type have equal deviations, so one field of each type will do.

    Args:
        conv: Layer whose weights are ordered (pair of types, output field, input field, basis kernel).

    Returns:
        Deviations, shape of ``conv.weights``.
    """
    expansion = conv.basisexpansion
    kernels = {
        pair: list(getattr(expansion, f"block_expansion_{expansion._escape_pair(pair)}").get_basis_info())
        for pair in expansion._representations_pairs
    }
    seen: dict[tuple[str, int], dict[tuple[int, ...], int]] = defaultdict(lambda: defaultdict(int))
    for (source, target), infos in kernels.items():
        for info in infos:
            seen[target, info["out_irrep_idx"]][info["in_irrep"]] += expansion._in_count[source]
    deviations = []
    for (source, target), infos in kernels.items():
        of_field = [_deviation(seen[target, info["out_irrep_idx"]], info["in_irrep"]) for info in infos]
        fields = expansion._in_count[source] * expansion._out_count[target]
        deviations.append(torch.tensor(of_field).repeat(fields))
    return torch.cat(deviations)


def _deviation(kernels_of: dict[tuple[int, ...], int], irrep: tuple[int, ...]) -> float:
    return float((len(kernels_of) * kernels_of[irrep]) ** -0.5)
