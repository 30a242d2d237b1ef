"""What programs leave for people, written whole or not at all: text, JSON, tables (also read again) and figures."""

import csv
import io
import json
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from svfl_data.errors import FormatError
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable

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


def read_rows(path: Path) -> list[dict[str, str]]:
    """Read a table that has a line of names, by these.

    Raises:
        FormatError: If it is no such table.
        OSError: If it cannot be read.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file, restkey="", restval=""))
    except (UnicodeDecodeError, csv.Error) as error:
        raise FormatError(f"{path}: not a table ({error})") from error
    if any("" in row for row in rows):
        raise FormatError(f"{path}: not a table (a line has more columns than the first one)")
    return rows


def read_numbers(path: Path) -> list[dict[str, float]]:
    """Read a table of numbers; cells without one are left out.

    Raises:
        FormatError: If it is no such table.
        OSError: If it cannot be read.
    """
    try:
        return [{name: float(value) for name, value in row.items() if value} for row in read_rows(path)]
    except ValueError as error:
        raise FormatError(f"{path}: not a table of numbers ({printable(error)})") from error


def write_figure(figure: "Figure", path: Path, dpi: int) -> None:
    """Write a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    write_atomically(path, buffer.getvalue())


def copy_file(source: Path, target: Path) -> None:
    """Write a copy of a file."""
    write_atomically(target, source.read_bytes())
