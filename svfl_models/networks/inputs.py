"""The inputs of each encoder, by the names that configurations and commands use. This module is light to import."""

ENCODERS = ("v", "f", "vf")
IMAGE_SIZES = (8, 16, 32, 64, 128)
INPUTS = {
    "v": ("image",), "f": ("wrench",), "vf": ("image", "wrench"), "vfp": ("image", "wrench", "proprio"),
}  # fmt: skip
"""Entries of a batch that each encoder takes; all other entries are left out of the batches."""
