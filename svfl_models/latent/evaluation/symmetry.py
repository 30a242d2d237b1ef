"""Measures how far a latent feature is from symmetric.

Nothing defines how a group element should act on a learned feature, and any action would be allowed. Three quantities
are therefore measured that need no such definition, for the elements of D4, which map pixels onto pixels exactly:

- ``not_linear``: 1 - R^2 of the best linear map from features of frames to features of the transformed frames, fitted
  on training episodes and evaluated on others. It is 0 for a feature on which the element acts as a matrix, as on the
  hidden fields of symmetric networks. At 1, one feature says no more about the other than the mean of the other does.
- ``change``: distance between the two features, in units of the distance of two frames drawn at random. It is 0 for an
  invariant feature. It need not be 0, because the feature has to tell where things are.
- ``contact``, ``alignment``: mean absolute change of these probabilities, whose true values do not change.

The whole world is transformed about the middle of the image and of the workspace: image, wrench window and gripper
together. The camera looks at the workspace from one side, so that the transformed images are not exactly those of a
transformed scene; this package treats them as such everywhere.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from svfl_models.latent.evaluation.frames import Encoded, Frames, numbers
from svfl_models.latent.evaluation.probing.ridge import fit_ridge
from svfl_models.latent.evaluation.scores import r_squared
from svfl_models.symmetry.actions import Batch, act_on_batch
from svfl_models.symmetry.groups import GROUPS

MOVES = dict(
    zip(
        ("turn 90", "turn 180", "turn 270", "flip", "flip, turn 90", "flip, turn 180", "flip, turn 270"),
        GROUPS["D4"].elements[1:],
        strict=True,
    )
)
"""Matrices of all elements of D4 but the identity, by name; those of C4 come first, as in
`svfl_data.symmetry.dihedral`."""
CYCLIC = 3
"""Number of the elements in `MOVES` that belong to C4."""


@dataclass(frozen=True)
class Asymmetry:
    """Effect of one transformation of the world on the outputs of an encoder.

    Attributes:
        not_linear: 1 - R^2 of the best linear map between the features; None if the features do not vary.
        change: Root mean square distance between the features of a frame and of the transformed frame, divided by that
            of two frames drawn at random.
        contact: Mean absolute change of the probability of contact.
        alignment: Mean absolute change of the probability of alignment.
    """

    not_linear: float | None
    change: float
    contact: float
    alignment: float


@dataclass(frozen=True)
class Symmetry:
    """`Asymmetry` of each element, and its mean over the elements of a group without the identity.

    Attributes:
        elements: Asymmetry of each element, by the names of `MOVES`.
        groups: Mean asymmetry of the groups ``C4`` and ``D4``.
    """

    elements: dict[str, Asymmetry]
    groups: dict[str, Asymmetry]


def symmetry(encode: Callable[[Batch], Encoded], learned: Frames, evaluated: Frames) -> Symmetry:
    """Measure the asymmetry of an encoder under all elements of D4.

    Args:
        encode: Function that encodes a batch of physical observations.
        learned: Training frames, which the linear maps are fitted on.
        evaluated: Frames of other episodes, which the asymmetry is measured on.
    """
    source, still = encode(learned.observations), encode(evaluated.observations)
    x, held = (numbers(one.feature) for one in (source, still))
    spread = np.sqrt(2 * np.square(held - held.mean(axis=0)).sum(axis=1).mean())
    elements = {}
    for name, matrix in MOVES.items():
        y = numbers(encode(act_on_batch(matrix, learned.observations)).feature)
        moved = encode(act_on_batch(matrix, evaluated.observations))
        image = numbers(moved.feature)
        explained = r_squared(fit_ridge(x, y, learned.episode.numpy())(held), image)
        elements[name] = Asymmetry(
            not_linear=None if explained is None else 1 - explained,
            change=float(np.sqrt(np.square(image - held).sum(axis=1).mean()) / spread) if spread > 0 else 0.0,
            contact=float((moved.contact - still.contact).abs().mean()),
            alignment=float((moved.alignment - still.alignment).abs().mean()),
        )
    moves = list(elements.values())
    return Symmetry(elements, {"C4": _mean(moves[:CYCLIC]), "D4": _mean(moves)})


def _mean(moves: list[Asymmetry]) -> Asymmetry:
    known = [one.not_linear for one in moves if one.not_linear is not None]
    return Asymmetry(
        not_linear=float(np.mean(known)) if known else None,
        change=float(np.mean([one.change for one in moves])),
        contact=float(np.mean([one.contact for one in moves])),
        alignment=float(np.mean([one.alignment for one in moves])),
    )
