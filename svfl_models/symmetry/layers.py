"""Symmetric layers on plain tensors.

escnn finds the kernels that commute with the group; `SymmetricConv` and `SymmetricLinear` combine them with learned
weights and hand the result to PyTorch's own operations. Layers keep a field's group channels together: channels are
ordered (field, group element), so that splitting channels into contiguous runs of whole fields, as attention heads do,
keeps the symmetry.
"""

from itertools import groupby

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_models.symmetry.kernels import Kernels, initial_deviations, kernels_between
from svfl_models.symmetry.planar_escnn import FieldType, Representation


class Block(nn.Module):
    """The part of a filter between a run of equal fields and another: one set of kernels, weights for every pair.

    Args:
        kernels: From one input field to one output field.
        outputs: Output fields.
        inputs: Input fields.
    """

    kernels: Tensor

    def __init__(self, kernels: Kernels, outputs: int, inputs: int) -> None:
        super().__init__()
        self.outputs, self.inputs = outputs, inputs
        self.weights_count = outputs * inputs * len(kernels)
        self.register_buffer("kernels", kernels.values.clone())

    def forward(self, weights: Tensor) -> Tensor:
        """Weights (outputs * inputs * kernels,) -> filter (channels out, channels in, side, side)."""
        combined = weights.view(self.outputs * self.inputs, len(self.kernels)) @ self.kernels.flatten(1)
        pairs = combined.view(self.outputs, self.inputs, *self.kernels.shape[1:])
        return pairs.transpose(1, 2).flatten(2, 3).flatten(0, 1)  # (O, I, o, i, ...) -> (O * o, I * i, ...)


class SymmetricConv(nn.Module):
    """Equivariant convolution whose filter always follows its weights.

    Nothing depends on the past: the filter is combined anew in every call and never kept, so changed
    weights (an optimiser's step, averaging, loading) take effect at once, and copies, pickles and state dicts are those
    of any PyTorch module. (escnn's own layers keep the filter while in eval mode, and share kernels between networks.)
    The kernels are saved with the weights, which mean nothing without them.

    Args:
        source: Type of the input.
        target: Type of the output.
        kernel_size: Side of the square kernel.
        padding: Zeros on each side.

    Attributes:
        weights: One number per (block, output field, input field, kernel); blocks row by row.
        bias: One number per trivial irreducible part of the output: only those may have a constant added.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> layers = layer_factory(GROUPS["D4"])
        >>> SymmetricConv(layers.image(4), layers.hidden(2), kernel_size=3, padding=1)(torch.randn(1, 4, 8, 8)).shape
        torch.Size([1, 16, 8, 8])
    """

    bias_expansion: Tensor

    def __init__(self, source: FieldType, target: FieldType, kernel_size: int, padding: int) -> None:
        super().__init__()
        self.kernel_size, self.padding = kernel_size, padding
        rows, columns = _runs(target), _runs(source)
        kinds = (frozenset(run[0] for run in runs) for runs in (columns, rows))
        found = kernels_between(source.gspace, *kinds, kernel_size)
        self.blocks = nn.ModuleList()
        weights = []
        for row, outputs in rows:
            seen = [(found[column.name, row.name], inputs) for column, inputs in columns]
            self.blocks.extend(Block(kernels, outputs, inputs) for kernels, inputs in seen)
            for deviations, (_, inputs) in zip(initial_deviations(seen), seen, strict=True):
                weights.append((deviations * torch.randn(outputs * inputs, len(deviations))).flatten())
        self.rows = len(rows)
        self.weights = nn.Parameter(torch.cat(weights))
        self.register_buffer("bias_expansion", torch.block_diag(*(_trivial_part(kind) for kind in target)))
        self.bias = nn.Parameter(torch.zeros(self.bias_expansion.shape[1]))

    def expand_parameters(self) -> tuple[Tensor, Tensor]:
        """Filter (C', C, side, side) and bias (C',)."""
        weights = self.weights.split([block.weights_count for block in self.blocks])
        blocks = [block(one) for block, one in zip(self.blocks, weights, strict=True)]
        columns = len(blocks) // self.rows
        rows = [_joined(blocks[start : start + columns], dim=1) for start in range(0, len(blocks), columns)]
        return _joined(rows, dim=0), self.bias_expansion @ self.bias

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C', H', W')."""
        kernel, bias = self.expand_parameters()
        return functional.conv2d(x, kernel, bias, padding=self.padding)


class SymmetricLinear(SymmetricConv):
    """Equivariant linear map of the last axis: a 1 x 1 convolution's kernel as a matrix, never as a convolution.

    For fewer rows than output channels the matrix holds more numbers than the rows that it is applied to, and combining
    it and its gradient takes longer than using it. A kernel of a single point has low rank (that of an irreducible
    representation, 1 or 2), so in training few rows go through the factors of every kernel instead, with the weights in
    between: the same up to rounding. In eval mode the matrix is used, so that an exported network agrees to the bit.

    Args:
        source: Type of the input.
        target: Type of the output.

    Example:
        >>> from svfl_models.networks.layer_factory import layer_factory
        >>> layers = layer_factory(GROUPS["D4"])
        >>> SymmetricLinear(layers.hidden(2), layers.hidden(3))(torch.randn(5, 16)).shape
        torch.Size([5, 24])
    """

    first: Tensor | None
    last: Tensor | None

    def __init__(self, source: FieldType, target: FieldType) -> None:
        super().__init__(source, target, kernel_size=1, padding=0)
        self.fields: tuple[int, int] = (len(target), len(source))
        uniform = len(self.blocks) == 1
        first, last = low_rank(self.blocks[0].get_buffer("kernels")[..., 0, 0]) if uniform else (None, None)
        self.register_buffer("first", first)
        self.register_buffer("last", last)

    def forward(self, x: Tensor) -> Tensor:
        """(..., C) -> (..., C')."""
        if self.training and self.first is not None and x.shape[:-1].numel() < len(self.bias_expansion):
            return self._factored(x.flatten(0, -2)).unflatten(0, x.shape[:-1])
        kernel, bias = self.expand_parameters()
        return functional.linear(x, kernel.flatten(1), bias)

    def _factored(self, x: Tensor) -> Tensor:
        """(N, C) -> (N, C')."""
        assert self.first is not None
        assert self.last is not None
        rows, (kernels, rank, size) = len(x), self.last.shape
        seen = x.view(rows, self.fields[1], len(self.first)) @ self.first  # (N, I, kernels * rank)
        seen = seen.unflatten(2, (kernels, rank)).permute(2, 0, 3, 1).flatten(1, 2)
        mixed = torch.bmm(seen, self.weights.view(*self.fields, kernels).permute(2, 1, 0))  # (kernels, N * rank, O)
        mixed = mixed.unflatten(1, (rows, rank)).permute(1, 3, 0, 2).flatten(2)
        return (mixed @ self.last.view(-1, size)).flatten(1) + self.bias_expansion @ self.bias


def low_rank(kernels: Tensor) -> tuple[Tensor, Tensor]:
    """Matrices as products of a tall and a wide one.

    Args:
        kernels: Shape (K, o, i).

    Returns:
        First factors, shape (i, K * R), and last factors, shape (K, R, o), where R is the largest rank: kernel k is the
        transpose of ``first[:, k * R : (k + 1) * R] @ last[k]``.
    """
    left, size, right = torch.linalg.svd(kernels.double(), full_matrices=False)  # (K, o, r), (K, r), (K, r, i)
    rank = int((size > 1e-4 * size.max()).sum(1).max())
    first, last = right[:, :rank], (left * size[:, None]).mT[:, :rank]
    return first.flatten(0, 1).T.to(kernels), last.contiguous().to(kernels)


def _runs(kind: FieldType) -> list[tuple[Representation, int]]:
    """A type as representations, each with the number of its fields in a row."""
    runs = [list(run) for _, run in groupby(kind.representations, key=str)]
    return [(run[0], len(run)) for run in runs]


def _joined(pieces: list[Tensor], dim: int) -> Tensor:
    return torch.cat(pieces, dim) if len(pieces) > 1 else pieces[0]


def _trivial_part(representation: Representation) -> Tensor:
    """What a constant can be added along, shape (size, number of trivial irreducible parts)."""
    irreps = [representation.group.irrep(*name) for name in representation.irreps]
    trivial = [irrep.is_trivial() for irrep in irreps for _ in range(irrep.size)]
    return torch.tensor(representation.change_of_basis, dtype=torch.float32)[:, trivial]
