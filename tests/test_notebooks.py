"""The notebooks run from top to bottom, show what they promise, and are stored without a trace of who ran them."""

import os
import re
from pathlib import Path

import nbclient
import nbformat
import pytest
from nbformat import NotebookNode

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
CLEAN = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
each = pytest.mark.parametrize("file", NOTEBOOKS, ids=lambda file: file.stem)


def read(file: Path) -> NotebookNode:
    return nbformat.read(file, as_version=nbformat.NO_CONVERT)


def traces(notebook: NotebookNode) -> list[str]:
    """What a run left in a notebook: outputs, counts, marks of an editor, the kernel of a machine."""
    found = [] if notebook.metadata == CLEAN else [f"metadata of the notebook: {dict(notebook.metadata)}"]
    for number, cell in enumerate(notebook.cells):
        if cell.metadata:
            found.append(f"metadata of cell {number}: {dict(cell.metadata)}")
        if cell.get("outputs") or cell.get("execution_count") is not None:
            found.append(f"cell {number} is stored with what it gave")
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
    monkeypatch.setenv("IPYTHONDIR", str(home / "ipython"))  # no history of ours in the user's
    monkeypatch.setenv("JUPYTER_RUNTIME_DIR", str(home / "runtime"))
    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel's own shows figures in the notebook
    kernel = {"metadata": {"path": str(home / "notebooks")}}
    return nbclient.NotebookClient(read(file), timeout=None, resources=kernel).execute()


def test_there_are_four():
    assert [file.stem[:2] for file in NOTEBOOKS] == ["01", "02", "03", "04"]


@each
def test_each_runs_and_shows_its_figures(file, executed, home):
    for cell in executed.cells:
        outputs = cell.get("outputs", [])
        said = "".join(output.text for output in outputs if output.output_type == "stream")
        assert not re.search(r"^svfl-\w+: ", said, re.M), said  # a command's complaint, which stops no notebook
        pictures = [output for output in outputs if "image/png" in output.get("data", {})]
        assert len(pictures) == cell.source.count("plt.show()"), cell.source
    for saved in re.findall(r'--out \{HOME / "(.*?)"\}', "\n".join(cell.source for cell in executed.cells)):
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
def test_each_is_stored_without_traces(file):
    notebook = read(file)
    nbformat.validate(notebook)
    assert traces(notebook) == []


def test_traces_are_found():
    notebook = read(NOTEBOOKS[0])
    code = next(cell for cell in notebook.cells if cell.cell_type == "code")
    code.outputs.append(nbformat.v4.new_output("stream", text="done"))
    notebook.cells[0].metadata["tags"] = ["mine"]
    notebook.metadata.language_info["version"] = "3.11.9"
    assert len(traces(notebook)) == 3


@each
def test_links_lead_somewhere(file):
    text = "\n".join(cell.source for cell in read(file).cells if cell.cell_type == "markdown")
    for target in re.findall(r"\]\((?!https?:)([^)#]+)\)", text):
        assert (FOLDER / target).exists(), target
