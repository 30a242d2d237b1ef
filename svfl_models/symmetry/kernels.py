"""The kernels that commute with a group, as escnn finds them, and how large their weights should be at first."""

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
        values: Shape (kernels, channels out, channels in, side, side); no kernels where none commutes.
        parts: For each kernel, which irreducible part of the output it makes, and the kind that it sees of the input.
    """

    values: Tensor
    parts: tuple[tuple[int, tuple[int, ...]], ...] = ()

    def __len__(self) -> int:
        return len(self.values)


@cache
def kernels_between(
    space: GSpace2D, sources: frozenset[Representation], targets: frozenset[Representation], side: int
) -> dict[tuple[str, str], Kernels]:
    """Kernels for all pairs of representations, by their names (source, target).

    Finding them takes escnn tens of milliseconds even when it has their ingredients on disk, and every layer of a
    network asks for the same few: they are found once per process. Callers copy the values, never change them.
    """
    found = {
        (source.name, target.name): Kernels(torch.zeros(0, target.size, source.size, side, side))
        for source in sources
        for target in targets
    }
    types = (FieldType(space, sorted(kinds, key=str)) for kinds in (sources, targets))
    expansion = R2Conv(*types, side, initialize=False, recompute=True).basisexpansion  # else shared with all its layers
    for pair in expansion._representations_pairs:
        block = getattr(expansion, f"block_expansion_{expansion._escape_pair(pair)}")
        parts = tuple((info["out_irrep_idx"], info["in_irrep"]) for info in block.get_basis_info())
        found[pair] = Kernels(block.sampled_basis.unflatten(-1, (side, side)), parts)
    return found


def initial_deviations(column: Sequence[tuple[Kernels, int]]) -> list[Tensor]:
    """Standard deviation of each weight for an output of the input's variance: He's rule on irreducible parts.

    An irreducible part of the output that sees d kinds of irreducible parts of the input, the j-th through n_j kernels,
    gets deviations 1 / sqrt(d n_j). That is ``escnn.nn.init.generalized_he_init`` (Weiler & Cesa, NeurIPS 2019,
    appendix), which visits every weight in Python; equal fields have equal deviations.

    Args:
        column: Everything that one output field sees: kernels from a kind of input field, number of such fields.

    Returns:
        Deviations per kernel, one tensor for each entry of `column`.
    """
    seen: Counter[tuple[int, tuple[int, ...]]] = Counter()
    for kernels, fields in column:
        for part in kernels.parts:
            seen[part] += fields
    kinds = Counter(output for output, _ in seen)
    return [torch.tensor([(kinds[part[0]] * seen[part]) ** -0.5 for part in kernels.parts]) for kernels, _ in column]
