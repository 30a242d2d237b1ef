"""Runs all parts of the evaluation of a model."""

from collections.abc import Callable
from pathlib import Path

import torch

from svfl_models.latent.checkpoint import load_latent, read_latent
from svfl_models.latent.evaluation.alignment import alignment
from svfl_models.latent.evaluation.attention import Attention, attention, looks, over_image
from svfl_models.latent.evaluation.contact import detection
from svfl_models.latent.evaluation.episodes import material, some, whole
from svfl_models.latent.evaluation.experts import experts
from svfl_models.latent.evaluation.following import next_gripper
from svfl_models.latent.evaluation.frames import Encoded, Followed, Frames, encode, encoded, follow, frames_of, spread
from svfl_models.latent.evaluation.probing.probing import Probing
from svfl_models.latent.evaluation.reconstruction import mean_picture, pictures, reconstruction
from svfl_models.latent.evaluation.results import Evaluation, SampleFigures
from svfl_models.latent.evaluation.symmetry import symmetry
from svfl_models.latent.networks.network import LatentNetwork
from svfl_models.latent.networks.poe import PoEEncoder
from svfl_models.latent.networks.vtt import VTTEncoder
from svfl_models.training.provenance.session import dataset, file, session

LEARNED_EPISODES, LEARNED_FRAMES = 200, 1200
"""Largest numbers of training episodes, drawn at random, and of their frames, spread evenly, that linear maps are
fitted on."""
MISSING_EPISODES = 12
"""Largest number of episodes, spread evenly, that are evaluated again without some modalities."""
LOOKED_AT = 250
"""Largest number of evaluated frames, spread evenly, whose attention is summed."""
TURNED_LEARNED, ROTATED_EVALUATED = 500, 150
"""Largest numbers of training frames and of evaluated frames, spread evenly, that are rotated and flipped. Each of them
is encoded seven more times."""
SHOWN = 6
"""Largest number of frames of the one episode in the figures."""
HEADS = {
    "contact": "contact of the frame",
    "next_contact": "contact of the next frame",
    "mismatch": "alignment",
    "next_proprio": "the next proprioception",
}
"""Predictions by the term of the loss that trains them, in words. A model in which the term has weight 0 was not
trained to make this prediction."""


def evaluate(
    checkpoint: Path, data: Path | None, episodes: int, seed: int, say: Callable[[str], None] = lambda stage: None
) -> tuple[Evaluation, SampleFigures]:
    """Evaluate a pretrained model on episodes that it was not trained on.

    Args:
        checkpoint: Checkpoint file that ``svfl-train latent`` has written.
        data: Dataset folder; None for the one of the training (see `episodes.material`).
        episodes: Largest number of episodes to evaluate.
        seed: Seed of everything that is drawn at random.
        say: Function that is called with a description of each stage as it begins.

    Returns:
        The numbers, and the samples of one episode for its figures.

    Raises:
        SvflError: If the checkpoint or the dataset cannot be used.
    """
    say("reading episodes")
    module = load_latent(checkpoint)
    network, encoder, given = module.network, module.network.encoder, material(module, data, episodes, seed)
    read = {"checkpoint": file(checkpoint), "data": dataset(given.learned.dataset.path)}
    if given.evaluated.dataset.path != given.learned.dataset.path:
        read["evaluated"] = dataset(given.evaluated.dataset.path)
    provenance = session(read, [seed])
    trained = {name for name in HEADS if module.objective.weights.get(name, 0) > 0}
    left_out = [f"{words}: the model was trained without it" for name, words in HEADS.items() if name not in trained]

    say("following episodes")
    followed = follow(network, given.evaluated.recordings)
    frames, seen = frames_of([one.batch for one in followed]), encoded(followed)
    some_learned = some(given.learned.recordings, LEARNED_EPISODES, seed)
    learned = frames_of([whole(one) for one in some_learned], LEARNED_FRAMES)
    next_contact = torch.cat([one.seen.next_contact[0] for one in followed]).sigmoid()
    came = torch.cat([one.batch["next_contact"][0] for one in followed]) > 0
    say("predicting images")
    near = reconstruction(network, followed, mean_picture(learned))
    say("pairing images with wrenches of other frames")
    aligned = alignment(network, frames, seen, seed) if "mismatch" in trained else None
    say("fitting probes")
    probing = Probing(network, given, learned, frames)
    if not probing.posed:
        left_out.append("object pose: it was not recorded with every episode")
    readings = probing.readings(seen)
    say("leaving modalities out")
    again = [followed[place] for place in spread(len(followed), MISSING_EPISODES).tolist()]
    remaining = probing.missing(again)
    say("rotating and flipping observations")
    asymmetry = symmetry(
        lambda observations: encode(network, observations),
        learned.spread(TURNED_LEARNED),
        frames.spread(ROTATED_EVALUATED),
    )
    say("measuring the weights of the modalities")
    found = Evaluation(
        checkpoint=str(checkpoint),
        model=module.hparams["training"]["model"],
        steps=int(read_latent(checkpoint)["svfl"]["steps"]),
        camera=given.evaluated.camera,
        of=given.of,
        episodes=len(followed),
        frames=len(frames),
        learned_frames=len(learned),
        missing_episodes=len(again),
        reconstruction=near,
        contact=detection(seen.contact, frames.contact) if "contact" in trained else None,
        next_contact=detection(next_contact, came) if "next_contact" in trained else None,
        alignment=aligned,
        next_gripper=next_gripper(network, followed) if "next_proprio" in trained else None,
        probes=readings,
        missing=remaining,
        attention=_attention(encoder, seen, frames) if isinstance(encoder, VTTEncoder) else None,
        experts=experts(encoder, seen.parts, frames.contact) if isinstance(encoder, PoEEncoder) else None,
        symmetry=asymmetry,
        left_out=left_out,
        provenance=provenance,
    )
    return found, sample_figures(network, followed)


def _attention(encoder: VTTEncoder, seen: Encoded, frames: Frames) -> Attention:
    rows = spread(len(frames), LOOKED_AT)
    parts = {name: part[rows] for name, part in seen.parts.items()}
    return attention(looks(encoder, parts), parts, frames.contact[rows])


def sample_figures(network: LatentNetwork, followed: list[Followed]) -> SampleFigures:
    """Return samples of the first episode with contact, or of the first episode if none has contact.

    Args:
        network: The latent model, in eval mode.
        followed: Episodes with the outputs of the model.
    """
    one = next((one for one in followed if one.batch["contact"].any()), followed[0])
    rows = spread(one.batch["step"].shape[1], SHOWN)
    looked = None
    if isinstance(network.encoder, VTTEncoder):
        parts = {name: part[rows] for name, part in one.seen.parts.items()}
        looked = over_image(looks(network.encoder, parts), parts["image"].shape[1])
    return SampleFigures(
        episode=int(one.batch["episode"][0]),
        step=rows,
        original=one.batch["image"][0, rows],
        picture=pictures(network, one.seen.states.state[0, rows]),
        contact=one.batch["contact"][0, rows] > 0,
        looked=looked,
    )
