"""What an evaluation leaves: a page, the numbers, and pictures."""

import math
from pathlib import Path
from typing import Any

from svfl_data.errors import StorageError
from svfl_data.system.printable import markdown
from svfl_models.latent.evaluation.pages import figures
from svfl_models.latent.evaluation.pages.tables import tables
from svfl_models.latent.evaluation.results import Evaluation, SampleFigures
from svfl_models.training.writing import write_json, write_text

NUMBERS, PAGE = "evaluation.json", "report.md"


def prepare(out: Path) -> None:
    """Make a folder, before minutes are spent on what is to be written there.

    Raises:
        StorageError: If it cannot be made.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StorageError(f"{out}: {error.strerror or error}") from error


def write(out: Path, found: Evaluation, samples: SampleFigures) -> list[Path]:
    """Write numbers, page and pictures into a folder that exists; what an earlier evaluation left there is replaced.

    Returns:
        The files, the page first.

    Raises:
        StorageError: If the folder cannot be written.
    """
    pictures = figures.draw(out, found, samples)
    write_json(out / NUMBERS, plain(found.plain()))
    write_text(out / PAGE, page(found, pictures))
    return [out / PAGE, out / NUMBERS, *pictures]


def plain(value: Any) -> Any:  # noqa: ANN401 - whatever JSON can hold
    """Values as JSON knows them: it has no infinity (the PSNR of equal pictures), which becomes null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def page(found: Evaluation, pictures: list[Path]) -> str:
    """The evaluation in Markdown."""
    left_out = "".join(f"- Not evaluated: {markdown(line)}.\n" for line in found.left_out)
    shown = "\n".join(f"![{path.stem}]({path.name})" for path in pictures)
    return f"""# What {found.model} is worth after {found.steps:,} steps

- Checkpoint: {markdown(found.checkpoint)}.
- Evaluated: {found.episodes} {markdown(found.of)}; {found.frames} frames, each episode followed from its first.
{left_out}
{shown}

{chr(10).join(table.markdown() for table in tables(found))}"""
