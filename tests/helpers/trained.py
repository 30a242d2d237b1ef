"""Checkpoints of networks that nobody has trained, as ``svfl-train centering`` would write them."""

import torch

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.module import CenteringModule


def untrained(samples, **choices):
    """A module with the samples' statistics, small unless asked otherwise."""
    torch.manual_seed(0)
    config = TrainingConfig(data="nowhere", **{"preset": "tiny"} | choices)
    module = CenteringModule(config.network(), training=config.plain())
    module.classifier.fit(samples)
    return module.eval(), config


def contents(module):
    """What Lightning puts into a checkpoint, as far as anybody reads it."""
    found = {"state_dict": module.state_dict(), "hyper_parameters": dict(module.hparams)}
    module.on_save_checkpoint(found)
    return found


def write(module, path):
    torch.save(contents(module), path)
    return path
