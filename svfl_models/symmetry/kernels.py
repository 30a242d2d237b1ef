"""The kernels that commute with a group, as escnn finds them, and the standard deviations of their initial weights."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from svfl_models.symmetry.planar_escnn import FieldType, GSpace2D, R2Conv, Representation


@dataclass(frozen=True)
class Kernels:
    """A basis of the equivariant kernels from one representation to another.

    Attributes:
        values: Kernels of the basis, shape (kernels, channels out, channels in, side, side). The basis is empty where
            no kernel commutes with the group.
        parts: For each kernel, the index of the irreducible part of the output that it produces, and the irreducible
            representation of the input that it takes.
    """

    values: Tensor
    parts: tuple[tuple[int, tuple[int, ...]], ...] = ()

    def __len__(self) -> int:
        return len(self.values)


@cache
def kernels_between(
    space: GSpace2D, sources: frozenset[Representation], targets: frozenset[Representation], side: int
) -> dict[tuple[str, str], Kernels]:
    """Return the equivariant kernels for all pairs of representations.

    escnn takes tens of milliseconds to find them even when its tables are on disk, and every layer of a network asks
    for the same few. They are therefore found once per process. Callers must copy the values and never change them.

    Args:
        space: The plane with the group acting on it, see `representations.plane`.
        sources: Representations of input fields.
        targets: Representations of output fields.
        side: Height and width of the kernels, [px].

    Returns:
        Bases of kernels by the names of the representations (source, target).
    """
    found = {
        (source.name, target.name): Kernels(torch.zeros(0, target.size, source.size, side, side))
        for source in sources
        for target in targets
    }
    types = (FieldType(space, sorted(kinds, key=str)) for kinds in (sources, targets))
    expansion = R2Conv(*types, side, initialize=False, recompute=True).basisexpansion  # not shared with other layers
    for pair in expansion._representations_pairs:
        block = getattr(expansion, f"block_expansion_{expansion._escape_pair(pair)}")
        parts = tuple((info["out_irrep_idx"], info["in_irrep"]) for info in block.get_basis_info())
        found[pair] = Kernels(block.sampled_basis.unflatten(-1, (side, side)), parts)
    return found


def initial_deviations(column: Sequence[tuple[Kernels, int]]) -> list[Tensor]:
    """Return the standard deviation of each initial weight for which the output has the variance of the input.

    This is He's rule on irreducible parts. If an irreducible part of the output takes d kinds of irreducible parts of
    the input, the j-th kind through n_j kernels, then the weights of these have standard deviation 1 / sqrt(d n_j).
    ``escnn.nn.init.generalized_he_init`` (Weiler & Cesa, NeurIPS 2019, appendix) computes the same, but visits every
    weight in Python; here equal fields share their standard deviations.

    Args:
        column: All inputs of one output field: for each kind of input field, the kernels from it and the number of
            such fields.

    Returns:
        Standard deviations of the weights of each kernel: one tensor, shape (kernels,), for each entry of `column`.
    """
    seen: Counter[tuple[int, tuple[int, ...]]] = Counter()
    for kernels, fields in column:
        for part in kernels.parts:
            seen[part] += fields
    kinds = Counter(output for output, _ in seen)
    return [torch.tensor([(kinds[part[0]] * seen[part]) ** -0.5 for part in kernels.parts]) for kernels, _ in column]
