"""What all figures of our programs share: their width and resolution, and small files."""

import io
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from svfl_data.system.atomic_io import write_atomically

WIDTH_IN = 10.0
DPI = 100


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as PNG; returns the file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    # 256 colours are more than there are in such a figure, and a third of the bytes.
    small = io.BytesIO()
    Image.open(buffer).convert("RGB").quantize(256).save(small, format="png", optimize=True)
    write_atomically(path, small.getvalue())
    return path
