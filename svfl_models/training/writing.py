"""Writing of text, JSON, tables and figures, completely or not at all, and reading of tables."""

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
    """Write a text as UTF-8.

    Args:
        path: File to write; an existing one is replaced.
        text: Content of the file.

    Raises:
        StorageError: If the file cannot be written; an earlier file then stays as it was.
    """
    write_atomically(path, text.encode())


def write_json(path: Path, content: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
    """Write plain values as JSON.

    Args:
        path: File to write; an existing one is replaced.
        content: Values that JSON can hold.

    Raises:
        StorageError: If the file cannot be written; an earlier file then stays as it was.
    """
    write_text(path, json.dumps(content, indent=2) + "\n")


def write_rows(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Write a table as CSV.

    Args:
        path: File to write; an existing one is replaced.
        rows: Rows of the table, the header first.

    Raises:
        StorageError: If the file cannot be written; an earlier file then stays as it was.
    """
    buffer = io.StringIO(newline="")
    csv.writer(buffer).writerows(rows)
    write_text(path, buffer.getvalue())


def read_rows(path: Path) -> list[dict[str, str]]:
    """Read a CSV table whose first line names the columns.

    Args:
        path: File to read.

    Returns:
        A dictionary for each row, of the cells by the names of their columns.

    Raises:
        FormatError: If the file is not such a table.
        OSError: If the file cannot be read.
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
    """Read a CSV table of numbers whose first line names the columns.

    Args:
        path: File to read.

    Returns:
        A dictionary for each row, of the numbers by the names of their columns. Empty cells are left out.

    Raises:
        FormatError: If the file is not such a table.
        OSError: If the file cannot be read.
    """
    try:
        return [{name: float(value) for name, value in row.items() if value} for row in read_rows(path)]
    except ValueError as error:
        raise FormatError(f"{path}: not a table of numbers ({printable(error)})") from error


def write_figure(figure: "Figure", path: Path, dpi: int) -> None:
    """Write a figure as PNG.

    Args:
        figure: Figure to write.
        path: File to write; an existing one is replaced.
        dpi: Resolution, in pixels per inch.

    Raises:
        StorageError: If the file cannot be written; an earlier file then stays as it was.
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi)
    write_atomically(path, buffer.getvalue())


def copy_file(source: Path, target: Path) -> None:
    """Copy a file.

    Args:
        source: File to read.
        target: File to write; an existing one is replaced.

    Raises:
        OSError: If `source` cannot be read.
        StorageError: If `target` cannot be written; an earlier file then stays as it was.
    """
    write_atomically(target, source.read_bytes())
