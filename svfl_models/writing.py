"""What programs leave for people, written whole or not at all: text, JSON, tables and figures."""

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svfl_data.atomically import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write_text(path: Path, text: str) -> None:
    """Write a text.

    Raises:
        StorageError: If the disk refuses, here as below; a file that was there before is untouched.
    """
    write_atomically(path, text.encode())


def write_json(path: Path, content: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
    """Write plain values as JSON."""
    write_text(path, json.dumps(content, indent=2) + "\n")


def write_rows(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write a table as CSV."""
    buffer = io.StringIO(newline="")
    csv.writer(buffer).writerows(rows)
    write_text(path, buffer.getvalue())


def write_figure(figure: "Figure", path: Path, dpi: int) -> None:
    """Write a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    write_atomically(path, buffer.getvalue())


def copy_file(source: Path, target: Path) -> None:
    """Write a copy of a file."""
    write_atomically(target, source.read_bytes())
