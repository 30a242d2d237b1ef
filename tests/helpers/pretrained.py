"""Checkpoints of narrow latent models that nobody has pretrained, as ``svfl-train latent`` would write them."""

import numpy as np
import torch

from svfl_models.latent.config import LatentConfig, plain
from svfl_models.latent.module import LatentModule
from tests.helpers.latent_small import SIZES

STEPS = 7


def write_latent(path, model="poe", seed=0):
    """A checkpoint with statistics of its own; returns its path."""
    torch.manual_seed(seed)
    config = LatentConfig("data/picking", model)
    module = LatentModule({"model": model, "sizes": plain(SIZES)}, config.objective(), training=config.plain())
    module.earlier_steps = STEPS
    rng = np.random.default_rng(seed)
    shapes = {"image": (20, 4, 8, 8), "wrench": (20, 64, 6), "proprio": (20, 5)}
    module.network.inputs.fit(**{name: rng.normal(1, 2, shape).astype(np.float32) for name, shape in shapes.items()})
    found = {"state_dict": module.state_dict(), "hyper_parameters": dict(module.hparams)}
    module.on_save_checkpoint(found)
    torch.save(found, path)
    return path
