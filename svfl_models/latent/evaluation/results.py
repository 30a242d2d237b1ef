"""What an evaluation found: numbers, and samples of one episode for its figures."""

from dataclasses import asdict, dataclass
from typing import Any

from torch import Tensor

from svfl_models.latent.evaluation.alignment import Alignment
from svfl_models.latent.evaluation.attention import Attention
from svfl_models.latent.evaluation.contact import Detection
from svfl_models.latent.evaluation.experts import Experts
from svfl_models.latent.evaluation.following import NextHand
from svfl_models.latent.evaluation.missing import Remaining
from svfl_models.latent.evaluation.probing.probes import Reading
from svfl_models.latent.evaluation.reconstruction import Reconstruction
from svfl_models.latent.evaluation.symmetry import Symmetry


@dataclass(frozen=True)
class Evaluation:
    """What a model is worth; what it was not trained for is None, and `left_out` says so.

    Attributes:
        checkpoint: File of the model.
        model: ``vtt``, ``poe`` or ``concat``.
        steps: Of its training.
        of: What was evaluated, in words.
        episodes: How many were evaluated.
        frames: In them.
        learned_frames: Training frames that linear maps were fitted on.
        missing_episodes: Episodes that were evaluated again without some modalities.
        reconstruction: Of pictures.
        contact: Of the frame.
        next_contact: Of the next one.
        alignment: Of image and wrench.
        next_gripper: Prediction of the next proprioception.
        probes: Of features.
        missing: Each subset of the modalities.
        attention: Of VTT.
        experts: Of PoE.
        symmetry: Of features.
        left_out: What was not evaluated, and why.
    """

    checkpoint: str
    model: str
    steps: int
    of: str
    episodes: int
    frames: int
    learned_frames: int
    missing_episodes: int
    reconstruction: Reconstruction
    contact: Detection | None
    next_contact: Detection | None
    alignment: Alignment | None
    next_gripper: NextHand | None
    probes: list[Reading]
    missing: list[Remaining]
    attention: Attention | None
    experts: Experts | None
    symmetry: Symmetry
    left_out: list[str]

    def plain(self) -> dict[str, Any]:
        """As a dictionary of plain values, for files."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class SampleFigures:
    """One episode in pictures, at some of its frames.

    Attributes:
        episode: Its index.
        step: Shape (P,).
        original: Shape (P, 4, 64, 64), colour 0..1 and depth in [m].
        picture: From the posterior states, likewise.
        contact: Whether a frame is in contact, shape (P,), bool.
        looked: VTT's attention of the contact token over the image, shape (P, side, side); None for other models.
    """

    episode: int
    step: Tensor
    original: Tensor
    picture: Tensor
    contact: Tensor
    looked: Tensor | None
