"""Symmetric layers on plain tensors.

escnn finds the kernels that commute with the group; `SymmetricConv` and `SymmetricLinear` combine them with learned
weights and pass the result to PyTorch's own operations. Layers keep the group channels of a field together: channels
are ordered (field, group element). Channels can therefore be split into contiguous runs of whole fields, as attention
heads do, without breaking the symmetry.
"""

from itertools import groupby

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_models.symmetry.kernels import Kernels, initial_deviations, kernels_between
from svfl_models.symmetry.planar_escnn import FieldType, Representation


class Block(nn.Module):
    """The block of a filter from a run of equal input fields to a run of equal output fields.

    All pairs of an input and an output field share one basis of kernels, and each pair has weights of its own.

    Args:
        kernels: Basis of the kernels from one input field to one output field.
        outputs: Number of output fields.
        inputs: Number of input fields.
    """

    kernels: Tensor

    def __init__(self, kernels: Kernels, outputs: int, inputs: int) -> None:
        super().__init__()
        self.outputs, self.inputs = outputs, inputs
        self.weights_count = outputs * inputs * len(kernels)
        self.register_buffer("kernels", kernels.values.clone())

    def forward(self, weights: Tensor) -> Tensor:
        """Combine the kernels with weights.

        Args:
            weights: One number per (output field, input field, kernel), shape (outputs * inputs * kernels,).

        Returns:
            Block of the filter, shape (channels out, channels in, side, side).
        """
        combined = weights.view(self.outputs * self.inputs, len(self.kernels)) @ self.kernels.flatten(1)
        pairs = combined.view(self.outputs, self.inputs, *self.kernels.shape[1:])
        return pairs.transpose(1, 2).flatten(2, 3).flatten(0, 1)  # (O, I, o, i, ...) -> (O * o, I * i, ...)


class SymmetricConv(nn.Module):
    """Equivariant convolution whose filter is always computed from its current weights.

    The filter is combined anew in every call and never kept. Changed weights (by an optimiser's step, averaging or
    loading) therefore take effect at once, and copies, pickles and state dicts are those of any PyTorch module.
    (escnn's own layers keep the filter while in eval mode, and share kernels between networks.) The kernels are saved
    with the weights, because weights have no meaning without their kernels.

    Args:
        source: Type of the input.
        target: Type of the output.
        kernel_size: Height and width of the kernel, [px].
        padding: Rows and columns of zeros that are added on each side, [px].

    Attributes:
        weights: One number per (block, output field, input field, kernel); the blocks are ordered row by row.
        bias: One number per trivial irreducible part of the output, the only parts to which a constant may be added.

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
        """Return the filter, shape (C', C, side, side), and the bias, shape (C',), that the weights stand for."""
        weights = self.weights.split([block.weights_count for block in self.blocks])
        blocks = [block(one) for block, one in zip(self.blocks, weights, strict=True)]
        columns = len(blocks) // self.rows
        rows = [_joined(blocks[start : start + columns], dim=1) for start in range(0, len(blocks), columns)]
        return _joined(rows, dim=0), self.bias_expansion @ self.bias

    def forward(self, x: Tensor) -> Tensor:
        """Convolve feature maps, from shape (B, C, H, W) to shape (B, C', H', W')."""
        kernel, bias = self.expand_parameters()
        return functional.conv2d(x, kernel, bias, padding=self.padding)


class SymmetricLinear(SymmetricConv):
    """Equivariant linear map of the last axis: the kernel of a 1 x 1 convolution, applied as a matrix.

    Where there are fewer input rows than output channels, the matrix holds more numbers than these rows, and computing
    the matrix and its gradient takes longer than applying it. A kernel of a single point has low rank (that of an
    irreducible representation, 1 or 2). In training, few rows are therefore multiplied by the first factor of every
    kernel, by the weights, and by the last factor, which gives the same result up to rounding. In eval mode the matrix
    is used, so that an exported network gives exactly the same outputs.

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
        """Map the last axis, from shape (..., C) to shape (..., C')."""
        if self.training and self.first is not None and x.shape[:-1].numel() < len(self.bias_expansion):
            return self._factored(x.flatten(0, -2)).unflatten(0, x.shape[:-1])
        kernel, bias = self.expand_parameters()
        return functional.linear(x, kernel.flatten(1), bias)

    def _factored(self, x: Tensor) -> Tensor:
        """Map rows, from shape (N, C) to shape (N, C'), by the factors of the kernels instead of the matrix."""
        assert self.first is not None
        assert self.last is not None
        rows, (kernels, rank, size) = len(x), self.last.shape
        seen = x.view(rows, self.fields[1], len(self.first)) @ self.first  # (N, I, kernels * rank)
        seen = seen.unflatten(2, (kernels, rank)).permute(2, 0, 3, 1).flatten(1, 2)
        mixed = torch.bmm(seen, self.weights.view(*self.fields, kernels).permute(2, 1, 0))  # (kernels, N * rank, O)
        mixed = mixed.unflatten(1, (rows, rank)).permute(1, 3, 0, 2).flatten(2)
        return (mixed @ self.last.view(-1, size)).flatten(1) + self.bias_expansion @ self.bias


def low_rank(kernels: Tensor) -> tuple[Tensor, Tensor]:
    """Factor each of several matrices into a product of a tall and a wide one.

    Args:
        kernels: Matrices, shape (K, o, i).

    Returns:
        First factors, shape (i, K * R), and last factors, shape (K, R, o), where R is the largest rank of the matrices.
        Matrix k is the transpose of ``first[:, k * R : (k + 1) * R] @ last[k]``.
    """
    left, size, right = torch.linalg.svd(kernels.double(), full_matrices=False)  # (K, o, r), (K, r), (K, r, i)
    rank = int((size > 1e-4 * size.max()).sum(1).max())
    first, last = right[:, :rank], (left * size[:, None]).mT[:, :rank]
    return first.flatten(0, 1).T.to(kernels), last.contiguous().to(kernels)


def _runs(kind: FieldType) -> list[tuple[Representation, int]]:
    """Return the representations of a type's runs of equal fields, each with the number of fields in its run."""
    runs = [list(run) for _, run in groupby(kind.representations, key=str)]
    return [(run[0], len(run)) for run in runs]


def _joined(pieces: list[Tensor], dim: int) -> Tensor:
    return torch.cat(pieces, dim) if len(pieces) > 1 else pieces[0]


def _trivial_part(representation: Representation) -> Tensor:
    """Return the directions along which a constant can be added, shape (size, number of trivial irreducible parts)."""
    irreps = [representation.group.irrep(*name) for name in representation.irreps]
    trivial = [irrep.is_trivial() for irrep in irreps for _ in range(irrep.size)]
    return torch.tensor(representation.change_of_basis, dtype=torch.float32)[:, trivial]
