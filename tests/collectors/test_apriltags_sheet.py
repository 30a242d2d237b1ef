"""Sheets have true sizes, in vectors and pixels, and every tag on them is found."""

import re

import numpy as np
import pytest

from collectors.apriltags.detector import TagDetector
from collectors.apriltags.layout import Layout
from collectors.apriltags.paper import pdf, picture, png
from collectors.apriltags.sheet import PAPERS, RULER, board_page, cell_mm, tag_pages
from collectors.cli import build_parser
from svfl_data.errors import UsageError

DPI = 100


def collect(*words):
    arguments = build_parser().parse_args(["tags", *map(str, words)])
    arguments.command(arguments)


def mm(pixels):
    return (np.asarray(pixels) + 0.5) * 25.4 / DPI


def drawn(document):
    """The black rectangles of a PDF in pixels, (H, W) uint8: what any viewer does with its commands."""
    width, height = (float(part) for part in re.search(rb"MediaBox \[0 0 (\S+) (\S+)\]", document).groups())
    scale = DPI / 72
    image = np.full((round(height * scale), round(width * scale)), 255, np.uint8)
    for x, y, w, h in re.findall(rb"([\d.]+) ([\d.]+) ([\d.]+) ([\d.]+) re", document):
        left, right = (round(float(v) * scale) for v in (x, float(x) + float(w)))
        top, bottom = (round((height - v) * scale) for v in (float(y) + float(h), float(y)))
        image[top:bottom, left:right] = 0
    return image


@pytest.mark.parametrize("paper", PAPERS)
def test_tags_have_their_size_and_number(paper):
    (page,) = tag_pages("tag36h11", list(range(5, 11)), 40.0, paper)
    found = TagDetector()(picture(page, DPI))
    assert [one.id for one in found] == list(range(5, 11))
    for one in found:
        edges = np.linalg.norm(np.roll(mm(one.corners), -1, axis=0) - mm(one.corners), axis=1)
        assert np.abs(edges - 40.0).max() < 0.3
    assert max(line.width for line in page.lines) == RULER


def test_the_pdf_shows_what_the_picture_shows():
    (page,) = tag_pages("tag25h9", [0, 1, 2], 35.0, "a4")
    document = pdf([page])
    found, same = (TagDetector("tag25h9")(image) for image in (drawn(document), picture(page, DPI)))
    assert [one.id for one in found] == [one.id for one in same] == [0, 1, 2]
    assert np.abs(np.array([a.corners - b.corners for a, b in zip(found, same, strict=True)])).max() < 0.7
    assert document.startswith(b"%PDF-1.4")
    offsets = [int(line[:10]) for line in document.split(b"xref\n")[1].splitlines()[2:7]]
    assert all(document[at:].startswith(b"%d 0 obj" % number) for number, at in enumerate(offsets, start=1))


def test_the_board_file_says_where_the_tags_of_the_board_are():
    page = board_page("tag36h11", 4, 3, 30.0, 7, "letter")
    cell = cell_mm("tag36h11", 30.0)
    layout = Layout.grid(4, 3, 0.03, 1e-3 * cell, first=7)
    found = TagDetector()(picture(page, DPI))
    assert [one.id for one in found] == list(layout.tags)
    origin = np.array([(page.width - 4 * cell) / 2, 20.0 + 3 * cell])  # lower left corner of the piece
    for one in found:
        on_board = (mm(one.corners) - origin) * (1, -1)
        assert np.abs(on_board - 1e3 * layout.tags[one.id].corners[:, :2]).max() < 0.3


def test_a_png_says_its_resolution():
    page = board_page("tag16h5", 1, 1, 30.0, 0, "a4")
    data = png(page, 300)
    at = data.index(b"pHYs") + 4
    assert int.from_bytes(data[at : at + 4], "big") == 11811  # pixels in a metre
    assert data[at + 8] == 1


def test_the_command_writes_sheet_and_layout(tmp_path, capsys):
    collect("--cube", 50, "--out", tmp_path / "block.pdf")
    layout = Layout.read(tmp_path / "block.json")
    assert len(layout.tags) == 6
    assert layout.tags[0].size == pytest.approx(0.04)
    assert np.allclose(layout.tags[0].T_body_tag[:3, 3], [0, 0, 0.025])
    collect("--count", 200, "--size", 30, "--out", tmp_path / "many.pdf")
    assert (tmp_path / "many.pdf").read_bytes().count(b"/Type /Page ") == 10
    assert "tags of 30 mm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--board", "9x9", "--out", "x.pdf"], "do not fit on a4: at most 16 mm"),
        (["--size", "200", "--out", "x.pdf"], "at most 148 mm"),
        (["--out", "x.jpg"], r"FILE\.pdf"),
        (["--count", "40", "--family", "tag16h5", "--out", "x.pdf"], "0 to 29"),
    ],
)
def test_what_does_not_fit_is_refused(words, message):
    with pytest.raises(UsageError, match=message):
        collect(*words)
