"""Drawing into files leaves the user's Matplotlib alone: a notebook keeps its backend, its settings and its figures."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
SOURCES = [file for package in ("svfl_data", "svfl_models", "collectors") for file in (ROOT / package).rglob("*.py")]

USER = """
import sys
from pathlib import Path

import matplotlib
from matplotlib import pyplot as plt

matplotlib.use("svg")
plt.figure()
before = dict(matplotlib.rcParams)

import numpy as np

from svfl_data.reports import plot
from svfl_models.centering import report
from svfl_models.experiments.figures import panels
from svfl_models.experiments import error_analysis
from svfl_models.latent.evaluation.pages import sample_figures
from svfl_models.training.figures import save
from svfl_models.training.run_report import plot_curves
from tests.helpers.builders import make_episode

out = Path(sys.argv[1])
plot.save(make_episode(), out / "episode.png")
report.plot_confusion(np.eye(4, dtype=int), out / "confusion.png", "title")
plot_curves([{"epoch": 0, "train_loss": 1.0, "train_accuracy": 0.5}], report.CURVES, out / "history.png", "title")
save(panels(1, 2, 2.0)[0], out / "panels.png")

assert matplotlib.get_backend() == "svg", matplotlib.get_backend()
assert dict(matplotlib.rcParams) == before
assert plt.get_fignums() == [1], plt.get_fignums()
"""


def test_drawing_leaves_backend_settings_and_figures_alone(tmp_path):
    user = subprocess.run(
        [sys.executable, "-c", USER, str(tmp_path)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert user.returncode == 0, user.stderr
    assert len(list(tmp_path.glob("*.png"))) == 4


@pytest.mark.parametrize("word", ["pyplot", "matplotlib.use(", "rcParams["])
def test_no_module_touches_what_is_global(word):
    assert [str(file.relative_to(ROOT)) for file in SOURCES if word in _code(file)] == []


def _code(file: Path) -> str:
    """A module's text after its docstring, which may speak of pyplot."""
    return file.read_text().split('"""', 2)[-1]
