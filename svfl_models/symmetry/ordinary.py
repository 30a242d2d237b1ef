"""Conversion of symmetric networks to ordinary ones, which replaces every equivariant layer by its expanded kernel."""

import copy

import torch
from torch import nn

from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear


def plain(module: nn.Module) -> nn.Module:
    """Return a copy of a network that is made of ordinary layers and has the same outputs.

    Args:
        module: Any network of this package, which is not changed.

    Returns:
        The copy, in eval mode. Every symmetric layer in it is replaced by a convolution or linear map with the expanded
        kernel. The parameters of the copy are frozen, because training an ordinary layer would break the symmetry.
    """
    return _replaced(copy.deepcopy(module)).eval().requires_grad_(False)


def _replaced(module: nn.Module) -> nn.Module:
    if isinstance(module, SymmetricConv):
        return _ordinary(module)
    for name, child in list(module._modules.items()):  # `named_children` would leave out a child's second name
        if child is not None:
            setattr(module, name, _replaced(child))
    return module


@torch.no_grad()
def _ordinary(layer: SymmetricConv) -> nn.Conv2d | nn.Linear:
    kernel, bias = layer.expand_parameters()
    outputs, inputs, *_ = kernel.shape
    new: nn.Conv2d | nn.Linear
    with torch.device("meta"):  # needs no memory and no random numbers; the learned parameters are set below
        if isinstance(layer, SymmetricLinear):
            kernel, new = kernel[:, :, 0, 0], nn.Linear(inputs, outputs)
        else:
            new = nn.Conv2d(inputs, outputs, layer.kernel_size, padding=layer.padding)
    new.weight, new.bias = nn.Parameter(kernel.contiguous()), nn.Parameter(bias)
    return new
