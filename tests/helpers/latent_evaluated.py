"""Pretrained models for the tests of their evaluation: narrow, hardly trained, with a dataset beside them."""

import dataclasses

from rich.console import Console

from svfl_models.latent import config as presets
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.train import train_latent
from svfl_models.training import run_folder
from tests.helpers.latent_small import SIZES, lifting, written


def dataset(folder, count=5, first=0):
    """Episodes of ten steps, in the last three of which something is lifted."""
    return written(folder, [lifting(first + index) for index in range(count)])


def trained(data, out, model="poe", preset="svfl_2023"):
    """A checkpoint of two steps."""
    whole = presets.PRESETS[preset]
    presets.PRESETS[preset] = dataclasses.replace(whole, sizes=SIZES)
    try:
        config = LatentConfig(str(data), model, preset, steps=2, checkpoint_every=2, batch_size=4, sequence=3)
        train_latent(config, out, console=Console(quiet=True))
    finally:
        presets.PRESETS[preset] = whole
    return out / run_folder.CHECKPOINT
