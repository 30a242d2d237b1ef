"""The notebooks run from top to bottom, show what they promise, and are stored with what they showed.

What is stored (notebooks/refresh.py) is small, belongs to the code above it, and has no trace of who ran it.
"""

import base64
import io
import os
import re
from pathlib import Path

import nbformat
import numpy as np
import pytest
from matplotlib import pyplot as plt
from nbformat import NotebookNode
from PIL import Image

from notebooks.refresh import CLEAN, DIGEST, LARGEST_PICTURE, as_stored, digest, execute, lasting, private_environment

FOLDER = Path(__file__).parents[1] / "notebooks"
LARGEST_TOTAL = 1_000_000  # bytes
MARKS = re.compile(
    r"(?<![\w.])/(?!s\b)\w[\w./-]*|~/|\x1b|\r|━|\b\d+:\d\d:\d\d\b|\bin \d[\d.]* (s|min|h)\b|/s\b|Traceback"
)
"""Absolute paths, terminal codes, progress, how long a command took, errors."""
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
each = pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)


def read(file: Path) -> NotebookNode:
    return nbformat.read(file, as_version=nbformat.NO_CONVERT)


def stored_outputs(notebook: NotebookNode) -> list[NotebookNode]:
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def traces(notebook: NotebookNode) -> list[str]:
    """What a run may leave in a notebook and must not: marks of an editor or a machine, times, errors."""
    known = CLEAN | {DIGEST: notebook.metadata.get(DIGEST)}
    found = [] if notebook.metadata == known else [f"metadata of the notebook: {dict(notebook.metadata)}"]
    for number, cell in enumerate(notebook.cells):
        if cell.metadata:
            found.append(f"metadata of cell {number}: {dict(cell.metadata)}")
        if cell.get("execution_count") is not None:
            found.append(f"cell {number} is stored with a count")
    for output in stored_outputs(notebook):
        if output.output_type not in ("stream", "display_data") or output.get("name") == "stderr":
            found.append(f"output of type {output.output_type}")
        if output.output_type == "stream" and (mark := MARKS.search(output.text)):
            found.append(f"text {mark[0]!r}")
    return found


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Where ``../data/notebooks`` of all notebooks lies, so that they share what they collect."""
    folder = tmp_path_factory.mktemp("home")
    (folder / "notebooks").mkdir()
    return folder


@pytest.fixture
def executed(file, home, monkeypatch):
    monkeypatch.setenv("SVFL_NOTEBOOK_TINY", "1")
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    for name, folder in private_environment(home).items():
        monkeypatch.setenv(name, folder)
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel's own shows figures in the notebook
    return execute(read(file), home)


def test_there_are_four():
    assert [file.stem[:2] for file in NOTEBOOKS] == ["01", "02", "03", "04"]


@pytest.mark.slow
@each
def test_each_runs_and_shows_its_figures(file, executed, home):
    for cell in executed.cells:
        outputs = cell.get("outputs", [])
        said = "".join(output.text for output in outputs if output.output_type == "stream")
        assert not re.search(r"^svfl-\w+: ", said, re.M), said  # a command's complaint, which stops no notebook
        pictures = [output for output in outputs if "image/png" in output.get("data", {})]
        assert len(pictures) == cell.source.count("plt.show()"), cell.source
    for saved in re.findall(r'--save \{HOME / "(.*?)"\}', "\n".join(cell.source for cell in executed.cells)):
        assert (home / "data" / "notebooks" / "tiny" / saved).stat().st_size > 0


@each
def test_each_finds_the_same_data_from_its_folder_and_from_the_root(file, tmp_path, monkeypatch):
    (tmp_path / "notebooks").mkdir()
    settings = next(cell.source for cell in read(file).cells if cell.cell_type == "code")
    for folder in (tmp_path, tmp_path / "notebooks"):
        monkeypatch.chdir(folder)
        monkeypatch.setenv("PATH", os.environ["PATH"])  # the cell puts its environment there
        found: dict[str, Path] = {}
        exec(settings, found)
        assert found["DATA"].resolve().is_relative_to(tmp_path / "data" / "notebooks")


@each
def test_each_is_stored_with_what_its_code_showed(file):
    notebook = read(file)
    nbformat.validate(notebook)
    assert notebook.metadata.get(DIGEST) == digest(notebook), "a code cell was changed: run make notebooks"
    assert traces(notebook) == []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            pictures = [one.data["image/png"] for one in cell.outputs if "image/png" in one.get("data", {})]
            assert len(pictures) == cell.source.count("plt.show()")
            assert "print(" not in cell.source or any(one.output_type == "stream" for one in cell.outputs)


@each
def test_stored_pictures_are_small(file):
    for output in stored_outputs(read(file)):
        for kind, picture in output.get("data", {}).items():
            assert kind == "image/png"
            assert len(base64.b64decode(picture)) <= LARGEST_PICTURE
    assert sum(one.stat().st_size for one in NOTEBOOKS) < LARGEST_TOTAL


def test_traces_are_found():
    notebook = read(NOTEBOOKS[0])
    code = next(cell for cell in notebook.cells if cell.cell_type == "code")
    for text in ("written to /home/me/data", "done in 7 s", "\x1b[1m3/4\x1b[0m", "at 20 steps/s"):
        code.outputs = [nbformat.v4.new_output("stream", text=text)]
        assert len(traces(notebook)) == 1, text
    code.outputs = [nbformat.v4.new_output("stream", name="stderr", text="careful")]
    notebook.cells[0].metadata["tags"] = ["mine"]
    notebook.metadata.language_info["version"] = "3.11.9"
    code.execution_count = 3
    assert len(traces(notebook)) == 4


def test_what_is_stored_has_no_traces():
    figure, axis = plt.subplots(figsize=(8, 6))
    axis.imshow(np.random.default_rng(0).random((40, 40, 3)))
    drawn = io.BytesIO()
    figure.savefig(drawn)
    plt.close(figure)
    data = {"image/png": base64.b64encode(drawn.getvalue()).decode(), "text/plain": "<Figure>"}
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("print(1)", metadata={"tags": ["mine"]})])
    notebook.cells[0].outputs = [
        nbformat.v4.new_output(
            "stream", text="\x1b[2Kwork ━━━ 1/2 0:00:07 left\rwork ━━━ 2/2\nmade 2 in 8 s (3 steps/s)\n"
        ),
        nbformat.v4.new_output("stream", name="stderr", text="careful"),
        nbformat.v4.new_output("stream", text="1\n"),
        nbformat.v4.new_output("display_data", data=data),
    ]
    stored = as_stored(notebook)
    assert traces(stored) == []
    text, picture = stored_outputs(stored)
    assert text.text == "made 2\n1\n"
    assert picture.data.keys() == {"image/png"}
    png = base64.b64decode(picture.data["image/png"])
    assert len(png) <= LARGEST_PICTURE
    assert Image.open(io.BytesIO(png)).size == (800, 600)
    assert not Image.open(io.BytesIO(png)).info.keys() & {"Software", "Creation Time"}


def test_what_a_terminal_overwrites_is_gone():
    assert lasting("1 of 2\r2 of 2\r\nall\n\n") == "2 of 2\nall\n"


@each
def test_links_lead_somewhere(file):
    text = "\n".join(cell.source for cell in read(file).cells if cell.cell_type == "markdown")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", text):
        assert (FOLDER / target).exists(), target
