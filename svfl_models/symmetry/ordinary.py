"""Symmetric networks as ordinary ones: every equivariant layer replaced by its expanded kernel."""

import copy

import torch
from torch import nn

from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear


def plain(module: nn.Module) -> nn.Module:
    """A copy of a network made of ordinary layers, with the same outputs.

    Args:
        module: Any network of this package; it is not changed.

    Returns:
        The copy, in eval mode, every symmetric layer in it replaced by a convolution or linear map with the expanded
        kernel. Its parameters are frozen: learning would break the symmetry, which nothing holds any more.
    """
    return _replaced(copy.deepcopy(module)).eval().requires_grad_(False)


def _replaced(module: nn.Module) -> nn.Module:
    if isinstance(module, SymmetricConv):
        return _ordinary(module)
    for name, child in list(module._modules.items()):  # not `named_children`, which leaves out a child's second name
        if child is not None:
            setattr(module, name, _replaced(child))
    return module


@torch.no_grad()
def _ordinary(layer: SymmetricConv) -> nn.Conv2d | nn.Linear:
    kernel, bias = layer.expand_parameters()
    outputs, inputs, *_ = kernel.shape
    new: nn.Conv2d | nn.Linear
    with torch.device("meta"):  # no memory and no random numbers: what it learned comes below
        if isinstance(layer, SymmetricLinear):
            kernel, new = kernel[:, :, 0, 0], nn.Linear(inputs, outputs)
        else:
            new = nn.Conv2d(inputs, outputs, layer.kernel_size, padding=layer.padding)
    new.weight, new.bias = nn.Parameter(kernel.contiguous()), nn.Parameter(bias)
    return new
