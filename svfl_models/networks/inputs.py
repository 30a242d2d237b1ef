"""The inputs of each encoder, by the names that configurations and commands use. This module is light to import."""

ENCODERS = ("v", "f", "vf")
IMAGE_SIZES = (8, 16, 32, 64, 128)
CROP = 64 / 76
"""Share of an image's side that a crop keeps (Kohler et al., CoRL 2023, appendix: 76 px are cropped to 64)."""
INPUTS = {
    "v": ("image",), "f": ("wrench",), "vf": ("image", "wrench"), "vfp": ("image", "wrench", "proprio"),
}  # fmt: skip
"""Entries of a batch that each encoder takes; all other entries are left out of the batches."""
