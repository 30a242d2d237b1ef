"""Printed pages have true sizes, in vectors and pixels, and every tag on them is found."""

import itertools
import re

import numpy as np
import pypdfium2 as pdfium
import pytest

from collectors.apriltags.detector import TagDetector
from collectors.apriltags.layout import FACES, Layout
from collectors.apriltags.native import CORRECTED
from collectors.apriltags.print_files import pdf, picture, png
from collectors.apriltags.print_layout import GAP, PAPERS, RULER, board_page, cell_mm, tag_pages
from collectors.cli import build_parser
from svfl_data.errors import UsageError

pytestmark = pytest.mark.slow

DPI = 100


def collect(*words):
    arguments = build_parser().parse_args(["tags", *map(str, words)])
    arguments.command(arguments)


def mm(pixels):
    return (np.asarray(pixels) + 0.5) * 25.4 / DPI


def drawn(document):
    """The first page of a PDF as a viewer shows it, (H, W) uint8."""
    return pdfium.PdfDocument(document)[0].render(scale=DPI / 72, grayscale=True).to_numpy().squeeze()


def lines_of_text(file):
    """What is written on the first page of a PDF: left, bottom, right, top in points, and the words."""
    text = pdfium.PdfDocument(file)[0].get_textpage()
    boxes = [text.get_rect(index) for index in range(text.count_rects())]
    return [(*box, text.get_text_bounded(*box).strip()) for box in boxes]


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
    apart = [a.corners - b.corners for a, b in zip(found, same, strict=True)]
    assert np.abs(apart).max() < 1.2  # [px]: the picture rounds to pixels, and the viewer blends them
    assert document == pdf([page])
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


def test_the_command_writes_page_and_layout(tmp_path, capsys):
    collect("--cube", 50, "--out", tmp_path / "block.pdf")
    layout = Layout.read(tmp_path / "block.json")
    assert len(layout.tags) == 6
    assert layout.tags[0].size == pytest.approx(0.04)
    assert np.allclose(layout.tags[0].T_body_tag[:3, 3], [0, 0, 0.025])
    collect("--count", 200, "--size", 30, "--out", tmp_path / "many.pdf")
    assert len(pdfium.PdfDocument(tmp_path / "many.pdf")) == 10
    assert "tags of 30 mm" in capsys.readouterr().out


def test_the_page_of_a_cube_says_where_each_tag_belongs(tmp_path):
    """In words that do not run into each other, however small the tags."""
    for edge, family in ((50, "tag36h11"), (18.75, "tagStandard41h12"), (5, "tag36h11")):
        collect("--cube", edge, "--family", family, "--out", tmp_path / "cube.pdf")
        labels = [line for line in lines_of_text(tmp_path / "cube.pdf") if re.search(r"on [+-][xyz]$", line[-1])]
        assert [words.split()[-1] for *_, words in labels] == list(FACES)
        for (left, bottom, right, _, _), (next_left, next_bottom, *_) in itertools.pairwise(labels):
            assert left < right
            assert abs(bottom - next_bottom) > 1 or right < next_left


def test_a_cube_with_smaller_tags_in_the_middle_of_pieces_as_large_as_its_faces(tmp_path):
    collect("--cube", 50, "--size", 30, "--out", tmp_path / "cube.pdf")
    assert Layout.read(tmp_path / "cube.json").tags[3].size == pytest.approx(0.03)
    (page,) = tag_pages("tag36h11", [0, 1], 30.0, "a4", piece=50.0)
    one, two = TagDetector()(picture(page, DPI))
    assert np.abs(mm(two.corners) - mm(one.corners) - (50.0 + GAP, 0.0)).max() < 0.3
    with pytest.raises(UsageError, match=r"50 mm .*40 mm"):
        collect("--cube", 50, "--size", 41, "--out", tmp_path / "cube.pdf")


def test_a_printer_that_shrinks_shrinks_the_tags_and_not_the_cube(tmp_path):
    collect("--cube", 50, "--printed", 98, "--out", tmp_path / "block.pdf")
    layout = Layout.read(tmp_path / "block.json")
    assert layout.tags[0].size == pytest.approx(0.98 * 0.04)
    assert np.allclose(layout.tags[0].T_body_tag[:3, 3], [0, 0, 0.025])
    with pytest.raises(UsageError, match="svfl-collect calibrate"):
        collect("--board", "4x5", "--printed", 98, "--out", tmp_path / "board.pdf")


@pytest.mark.parametrize("family", CORRECTED)
def test_boards_of_all_families_are_read_from_their_pages(family):
    page, cell = board_page(family, 2, 2, 25.0, 1, "a4"), cell_mm(family, 25.0)
    layout = Layout.grid(2, 2, 0.025, 1e-3 * cell, 1, family)
    found = TagDetector(family)(picture(page, DPI))
    assert [one.id for one in found] == [1, 2, 3, 4]
    origin = np.array([(page.width - 2 * cell) / 2, 20.0 + 2 * cell])
    for one in found:
        on_board = (mm(one.corners) - origin) * (1, -1)
        assert np.abs(on_board - 1e3 * layout.tags[one.id].corners[:, :2]).max() < 0.3


@pytest.mark.parametrize(
    ("words", "facts"),
    [
        (["--board", "9x9", "--out", "x.pdf"], " a4: .*16 mm"),
        (["--board", "200x200", "--out", "x.pdf"], "200 x 200 .*a4"),
        (["--size", "200", "--out", "x.pdf"], "148 mm.* 186 mm"),
        (["--cube", "200", "--out", "x.pdf"], "148 mm.* 186 mm"),
        (["--out", "x.jpg"], r"must end in \.pdf or \.png"),
        (["--count", "40", "--family", "tag16h5", "--out", "x.pdf"], "0 to 29"),
    ],
)
def test_what_does_not_fit_is_refused(words, facts):
    with pytest.raises(UsageError, match=facts):
        collect(*words)
