"""Run the notebooks and store what they show: small pictures and texts without traces of the machine.

python notebooks/refresh.py        # all four, about twelve minutes on two idle cores
python notebooks/refresh.py 01 03  # two of them

Run this after a change of a code cell; `tests/test_notebooks.py` compares what is stored with the cells.
"""

import argparse
import base64
import hashlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import nbclient
import nbformat
from nbformat import NotebookNode
from PIL import Image

FOLDER = Path(__file__).resolve().parent
LARGEST_PICTURE = 100_000  # bytes
COLORS = 128  # of a stored picture, each with a palette of its own
ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
PROGRESS = re.compile(r".*[━╸╺].*")  # a bar, with the time that is left
DURATION = re.compile(r" in [\d:.]+ (s|min|h)\b( \([^)]*/s\))?")  # how long a command took
CLEAN = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
"""Metadata that every notebook is stored with, besides the digest of the cells that were run."""
DIGEST = "svfl_executed_cells"


def digest(notebook: NotebookNode) -> str:
    """Return the SHA-256 of the code cells of a notebook, in order."""
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(code).encode()).hexdigest()


def execute(notebook: NotebookNode, home: Path) -> NotebookNode:
    """Run a notebook as if it lay in ``home/notebooks``.

    Args:
        notebook: The notebook, whose outputs are replaced.
        home: Folder that takes the place of the repository: data sets are made below ``home/data``.

    Raises:
        nbclient.exceptions.CellExecutionError: If a cell fails.
    """
    (home / "notebooks").mkdir(exist_ok=True)
    kernel = {"metadata": {"path": str(home / "notebooks")}}
    return nbclient.NotebookClient(notebook, timeout=None, resources=kernel).execute()


def private_environment(home: Path) -> dict[str, str]:
    """Return variables with which the kernel leaves the user's own history and settings alone."""
    return {"IPYTHONDIR": str(home / "ipython"), "JUPYTER_RUNTIME_DIR": str(home / "runtime")}


def small(png: bytes) -> bytes:
    """Return a picture with a palette of few colours and without metadata, which is a third of the size.

    Args:
        png: A picture, as Matplotlib shows it in a notebook.

    Raises:
        ValueError: If the result is larger than `LARGEST_PICTURE`.
    """
    picture = Image.open(io.BytesIO(png)).convert("RGB").quantize(COLORS, method=Image.Quantize.MEDIANCUT)
    stored = io.BytesIO()
    picture.save(stored, "png", optimize=True)
    if stored.tell() > LARGEST_PICTURE:
        raise ValueError(f"a picture of {picture.size} has {stored.tell()} bytes, more than {LARGEST_PICTURE}")
    return stored.getvalue()


def lasting(text: str) -> str:
    """Return what a terminal shows in the end, and would show again: no colours, no progress, no durations."""
    lines = [line.rstrip("\r").rsplit("\r", 1)[-1].rstrip() for line in ESCAPE.sub("", text).split("\n")]
    return DURATION.sub("", "\n".join(line for line in lines if not PROGRESS.fullmatch(line))).strip("\n") + "\n"


def shown(outputs: list[NotebookNode]) -> list[NotebookNode]:
    """Return the outputs of a cell as they are stored: texts joined, pictures small, nothing else.

    Args:
        outputs: The outputs of one code cell.
    """
    kept: list[NotebookNode] = []
    for output in outputs:
        png = output.get("data", {}).get("image/png")
        if png is not None:
            data = {"image/png": base64.b64encode(small(base64.b64decode(png))).decode()}
            kept.append(nbformat.v4.new_output("display_data", data=data))
        elif output.output_type == "stream" and output.name == "stdout":
            if kept and kept[-1].output_type == "stream":
                kept[-1].text += output.text
            else:
                kept.append(nbformat.v4.new_output("stream", name="stdout", text=output.text))
    for output in kept:
        if output.output_type == "stream":
            output.text = lasting(output.text)
    return [output for output in kept if output.output_type != "stream" or output.text.strip()]


def as_stored(executed: NotebookNode) -> NotebookNode:
    """Return an executed notebook without counts, times and names of the machine that executed it."""
    executed.metadata = nbformat.from_dict(CLEAN | {DIGEST: digest(executed)})
    for cell in executed.cells:
        cell.metadata = nbformat.from_dict({})
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = shown(cell.outputs)
    return executed


def main() -> None:
    """Run the notebooks that the command line names, one after the other on the same data, and store them."""
    parser = argparse.ArgumentParser(description="Run the notebooks and store what they show.")
    parser.add_argument("numbers", nargs="*", metavar="NN", help="numbers of notebooks, such as 02; all without")
    numbers = parser.parse_args().numbers
    with tempfile.TemporaryDirectory() as folder:
        os.environ.update(private_environment(Path(folder)))
        os.environ.pop("MPLBACKEND", None)  # the kernel's own shows figures in the notebook
        for file in sorted(FOLDER.glob("*.ipynb")):
            if not numbers or file.stem[:2] in numbers:
                print(file.name, file=sys.stderr)
                notebook = nbformat.read(file, as_version=nbformat.NO_CONVERT)
                nbformat.write(as_stored(execute(notebook, Path(folder))), file)


if __name__ == "__main__":
    main()
