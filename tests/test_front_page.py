"""The front page agrees with the results, the project's metadata and the file that says how to cite it."""

import csv
import re
import tomllib

import pytest
import yaml
from PIL import Image

from docs.badges import BADGES, badges
from docs.centering_figure import stored_accuracies
from svfl_models.centering.paper_figures import CENTERING
from svfl_models.centering.report import NAMES
from svfl_models.experiments.page import MODELS
from svfl_models.experiments.table import accuracy_figure
from tests.helpers.pages import ROOT

PAGE = (ROOT / "README.md").read_text()
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
COUNTS = (10, 25, 50, 100)
MOST_BYTES = 3_000_000


def rows() -> dict[tuple[str, str], list[tuple[str, str]]]:
    """Our figure and the paper's for each number of training samples, by input and network."""
    encoders = {words: encoder for encoder, words in NAMES.items()}
    found, encoder = {}, ""
    for first, model, cells in re.findall(
        r"^\| (\S*) ?\| (?:\*\*)?(SVFL|CNN)(?:\*\*)? \(paper\) \|(.*)\|$", PAGE, re.M
    ):
        encoder = encoders[first] if first else encoder
        found[encoder, model.lower()] = re.findall(r"([\d.]+)\*{0,2} \(([\d.]+)\)", cells)
    return found


def test_the_table_has_the_stored_accuracies_and_the_papers():
    with (ROOT / "docs" / "centering" / "table.csv").open(newline="") as file:
        stored = {(row["encoder"], row["group"], int(row["train_samples"])): row for row in csv.DictReader(file)}
    assert rows().keys() == CENTERING.keys()
    for (encoder, model), cells in rows().items():
        ours = [float(stored[encoder, MODELS[model], count]["separate_test"]) for count in COUNTS]
        assert [float(one) for one, _ in cells] == pytest.approx(ours, abs=0.0501)
        assert [float(one) for _, one in cells] == [CENTERING[encoder, model][count][0] for count in COUNTS]


def test_the_figure_shows_the_numbers_of_the_table():
    figure = accuracy_figure(stored_accuracies(), "accuracy, %")
    shown = [
        [line.get_ydata().tolist() for line in (bars.lines[0] for bars in panel.containers)] for panel in figure.axes
    ]
    for lines, encoder in zip(shown, dict.fromkeys(encoder for encoder, _ in CENTERING), strict=True):
        ours = [[float(one) for one, _ in rows()[encoder, model]] for model in MODELS]
        papers = [[float(one) for _, one in rows()[encoder, model]] for model in MODELS]
        for drawn, listed in zip(lines, [ours[0], papers[0], ours[1], papers[1]], strict=True):
            assert drawn == pytest.approx(listed, abs=0.0501)


def test_badges_are_those_of_the_project():
    assert {file.name: file.read_text() for file in BADGES.glob("*.svg")} == badges()


def test_the_moving_picture_moves_and_is_small():
    file = ROOT / "docs" / "images" / "moving_episode.webp"
    assert file.stat().st_size < MOST_BYTES
    with Image.open(file) as picture:
        assert picture.n_frames >= 15
        assert picture.info["loop"] == 0


def test_the_wheel_that_is_installed_is_the_one_that_is_built():
    assert f"dist/svfl-{PROJECT['version']}-py3-none-any.whl" in PAGE


def test_what_to_cite_is_complete():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert cited["cff-version"] == "1.2.0"
    assert cited["version"] == PROJECT["version"]
    assert cited["license"] == PROJECT["license"]
    released = re.search(rf"^## {re.escape(PROJECT['version'])} - (\S+)$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert str(cited["date-released"]) == released[1]
    assert all(cited[key] for key in ("message", "title", "type", "abstract"))
    for work in (cited, *cited["references"]):
        assert work["title"]
        assert work["authors"]
        assert all("name" in one or {"family-names", "given-names"} <= one.keys() for one in work["authors"])
    (paper,) = cited["references"]
    assert [one["family-names"] for one in paper["authors"]] == ["Kohler", "Srikanth", "Arora", "Platt"]
    assert all(one["family-names"] in PAGE for one in paper["authors"])
    assert paper["doi"] in PAGE
    assert paper["url"] in PAGE
