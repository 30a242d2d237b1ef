"""How far a latent is from symmetric.

Nothing says how a group element should act on a learned feature: any action would do, if there were one. So three
things are measured that need none, for elements of D4, which move pixels exactly:

- ``not_linear``: 1 - R^2 of the best linear map from features of frames to features of the transformed frames, fitted
  on training episodes and evaluated on others. A feature on which the element acts as a matrix, as it does on the
  hidden fields of symmetric networks, has 0; at 1, one feature says no more about the other than its mean does.
- ``change``: distance between the two features, in units of the distance of two frames drawn at random. An invariant
  feature has 0. It need not be 0: the feature has to tell where things are.
- ``contact``, ``alignment``: mean absolute change of these probabilities, which the truth does not change by.

The whole world turns about the middle of the picture and of the workspace: image, wrench window and gripper together.
The camera looks at the workspace from one side, so that the turned pictures are not exactly those of a turned scene;
the same is taken for a symmetry everywhere in this package.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from svfl_models.latent.evaluation.frames import Encoded, Frames, numbers
from svfl_models.latent.evaluation.probing.ridge import fit_ridge
from svfl_models.latent.evaluation.scores import r_squared
from svfl_models.latent.inputs import Batch
from svfl_models.symmetry.actions import act_on_batch
from svfl_models.symmetry.groups import GROUPS

MOVES = dict(
    zip(
        ("turn 90", "turn 180", "turn 270", "flip", "flip, turn 90", "flip, turn 180", "flip, turn 270"),
        GROUPS["D4"].elements[1:],
        strict=True,
    )
)
"""All elements of D4 but the identity, those of C4 first, as `svfl_data.symmetry.dihedral` orders them."""
CYCLIC = 3
"""So many of them are of C4."""


@dataclass(frozen=True)
class Asymmetry:
    """What a transformation of the world does to a model.

    Attributes:
        not_linear: 1 - R^2 of the best linear map between the features; None if they do not vary.
        change: Root mean square distance of the features, over that of two frames at random.
        contact: Mean absolute change of the probability of contact.
        alignment: Mean absolute change of the probability of alignment.
    """

    not_linear: float | None
    change: float
    contact: float
    alignment: float


@dataclass(frozen=True)
class Symmetry:
    """`Asymmetry` of each element, and the mean over groups without their identity.

    Attributes:
        elements: By name in `MOVES`.
        groups: ``C4`` and ``D4``.
    """

    elements: dict[str, Asymmetry]
    groups: dict[str, Asymmetry]


def symmetry(encode: Callable[[Batch], Encoded], learned: Frames, evaluated: Frames) -> Symmetry:
    """Measure all elements of D4.

    Args:
        encode: The encoder, of physical observations.
        learned: Training frames.
        evaluated: Frames of other episodes.
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
