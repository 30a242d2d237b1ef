"""Writes the results of an evaluation: a Markdown page, the numbers as JSON, and figures."""

import math
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError
from svfl_data.system.printable import markdown
from svfl_models.latent.evaluation.pages import figures
from svfl_models.latent.evaluation.pages.tables import tables
from svfl_models.latent.evaluation.results import Evaluation, SampleFigures
from svfl_models.training.provenance.words import section
from svfl_models.training.writing import write_json, write_text

NUMBERS, PAGE = "evaluation.json", "report.md"


def prepare(out: Path) -> None:
    """Create the output folder, so that a folder that cannot be created is reported before a long evaluation.

    Args:
        out: The folder.

    Raises:
        StorageError: If the folder cannot be created.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}") from error


def write(out: Path, found: Evaluation, samples: SampleFigures) -> list[Path]:
    """Write the numbers, the page and the figures into an existing folder, over the files of an earlier evaluation.

    Args:
        out: The folder.
        found: Numbers of the evaluation.
        samples: Samples of one episode for its figures.

    Returns:
        The files that were written, the page first.

    Raises:
        StorageError: If the folder cannot be written.
    """
    pictures = figures.draw(out, found, samples)
    write_json(out / NUMBERS, plain(found.plain()))
    write_text(out / PAGE, page(found, pictures))
    return [out / PAGE, out / NUMBERS, *pictures]


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Convert values to what JSON can hold; infinite values (the PSNR of equal images) and NaN become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def page(found: Evaluation, pictures: list[Path]) -> str:
    """Return the report of an evaluation in Markdown.

    Args:
        found: Numbers of the evaluation.
        pictures: Files of the figures, which lie in the folder of the page.
    """
    left_out = "".join(f"- Not evaluated: {markdown(line)}.\n" for line in found.left_out)
    provenance = "" if found.provenance is None else f"\n{section(found.provenance)}"
    shown = "\n".join(f"![{path.stem}]({path.name})" for path in pictures)
    return f"""# Evaluation of {found.model} after {found.steps:,} steps

- Checkpoint: {markdown(found.checkpoint)}.
- Evaluated: {found.episodes} {markdown(found.of)}; {found.frames} frames, each episode followed from its first.
- Camera: {markdown(found.camera)}.
{left_out}
{shown}

{chr(10).join(table.markdown() for table in tables(found))}{provenance}"""
