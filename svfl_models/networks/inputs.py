"""What encoders look at, by the names that configurations and commands give them; light to import."""

ENCODERS = ("v", "f", "vf")
IMAGE_SIZES = (8, 16, 32, 64, 128)
INPUTS = {
    "v": ("image",), "f": ("wrench",), "vf": ("image", "wrench"), "vfp": ("image", "wrench", "proprio"),
}  # fmt: skip
"""What each encoder looks at; the rest is left out of the batches."""
