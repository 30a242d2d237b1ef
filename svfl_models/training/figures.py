"""The width, resolution and compact file format that all figures of our programs share."""

import io
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from svfl_data.system.atomic_io import write_atomically

WIDTH_IN = 10.0
DPI = 100


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as a PNG file, and return the file.

    Args:
        figure: Figure to write.
        path: File to write; an existing one is replaced.

    Raises:
        StorageError: If the file cannot be written.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    # No palette: with the shades of smooth edges there are more than 256 colours, and a palette merged some of them.
    small = io.BytesIO()
    Image.open(buffer).convert("RGB").save(small, format="png", optimize=True)
    write_atomically(path, small.getvalue())
    return path
