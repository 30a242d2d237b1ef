"""Results of an evaluation: numbers, and samples of one episode for its figures."""

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
from svfl_models.training.provenance.session import Session


@dataclass(frozen=True)
class Evaluation:
    """Numbers of the evaluation of a model; what it was not trained for is None and is named in `left_out`.

    Attributes:
        checkpoint: Path of the model's checkpoint.
        model: Kind of model: ``vtt``, ``poe`` or ``concat``.
        steps: Number of optimiser steps of the model's training.
        camera: Name of the camera whose images the model takes.
        of: Description of the evaluated episodes in words.
        episodes: Number of evaluated episodes.
        frames: Number of frames in the evaluated episodes.
        learned_frames: Number of training frames that linear maps were fitted on.
        missing_episodes: Number of episodes that were evaluated again without some modalities.
        reconstruction: Fidelity of decoded and predicted images.
        contact: Scores of the contact of the frame.
        next_contact: Scores of the contact between a frame and the next.
        alignment: Evaluation on matched and mismatched pairs of image and wrench.
        next_gripper: Errors of the predicted next proprioception.
        probes: Scores of the linear probes of features.
        missing: Scores for each subset of the modalities.
        attention: Attention of VTT; None for other models.
        experts: Weights of PoE's experts; None for other models.
        symmetry: Symmetry of the features.
        left_out: What was not evaluated and why, in words.
        provenance: What the evaluation was made with; None if it is not known.
    """

    checkpoint: str
    model: str
    steps: int
    camera: str
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
    provenance: Session | None = None

    def plain(self) -> dict[str, Any]:
        """Return the attributes as a dictionary of plain values for files."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class SampleFigures:
    """Samples of one episode at P of its frames, for figures.

    Attributes:
        episode: Index of the episode.
        step: Numbers of the frames in the episode, shape (P,).
        original: Recorded images, shape (P, 4, 64, 64), colour 0..1 and depth in [m].
        picture: Images decoded from the posterior states, with the same shape and units.
        contact: Whether each frame is in contact, shape (P,), bool.
        looked: Attention of VTT's contact token to the image patches, shape (P, side, side); None for other models.
    """

    episode: int
    step: Tensor
    original: Tensor
    picture: Tensor
    contact: Tensor
    looked: Tensor | None
