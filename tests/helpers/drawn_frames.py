"""Random frames for latent evaluations."""

import torch

from svfl_models.latent.evaluation.frames import Frames
from tests.helpers import latent_small as small


def drawn_frames(count, seed=0):
    touching = torch.arange(count) % 3 == 0
    observations = small.frames(count, seed)
    return Frames(observations, torch.arange(count) // 8, torch.arange(count) % 8, touching, touching)
