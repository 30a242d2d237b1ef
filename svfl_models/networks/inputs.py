"""The inputs of each encoder and the views of images, by the names that configurations and commands use.

This module is light to import.
"""

from collections.abc import Sequence

ENCODERS = ("v", "f", "vf")
IMAGE_SIZES = (8, 16, 32, 64, 128)
CROP = 64 / 76
"""Share of an image's side that a crop keeps (Kohler et al., CoRL 2023, appendix: 76 px are cropped to 64)."""
INPUTS = {
    "v": ("image",), "f": ("wrench",), "vf": ("image", "wrench"), "vfp": ("image", "wrench", "proprio"),
}  # fmt: skip
"""Entries of a batch that each encoder takes; all other entries are left out of the batches."""
VIEWS = {"camera": "as recorded", "gripper": "cut out around the gripper", "top": "as seen from straight above"}
"""Views of the images that a network gets, with what they mean."""


def view_help(offered: Sequence[str]) -> str:
    """Return the help of the setting `view` of a program.

    Args:
        offered: Views that the program offers, keys of `VIEWS`.
    """
    return "view of the images: " + ", ".join(f"{name} {VIEWS[name]}" for name in offered)
