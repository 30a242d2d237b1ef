"""Sheets of tags to print: what is where on the paper, in millimetres from its upper left corner."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from collectors.apriltags.picture import modules, shape
from svfl_data.errors import UsageError

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # [mm] width and height
MARGIN = 12.0  # [mm] that printers may leave white
FOOT = 16.0  # [mm] at the lower end for the ruler
HEAD = 8.0  # [mm] at the upper end for the title
GAP = 7.0  # [mm] between tags that are to be cut out, for marks and numbers
LETTER = 1.6  # [mm] width of one in the words below a tag, at most
MARK = 2.5  # [mm] length of a cut mark
RULER = 100.0  # [mm]
THIN = 0.15  # [mm]


@dataclass(frozen=True)
class Block:
    """A filled rectangle, [mm]."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Text:
    """A line of text whose lower left corner is at x, y, [mm]; its size is the height of a line, [mm]."""

    x: float
    y: float
    size: float
    words: str


@dataclass(frozen=True)
class Page:
    """One sheet of paper.

    Attributes:
        width: [mm].
        height: [mm].
        tags: The black modules of each tag.
        lines: Thin rectangles: cut marks, ruler.
        texts: Ids, title, measures.
    """

    width: float
    height: float
    tags: list[list[Block]]
    lines: list[Block]
    texts: list[Text]


def cell_mm(family: str, size_mm: float) -> float:
    """Edge of the whole picture of a tag with the white margin that it needs, [mm]."""
    measures = shape(family)
    return size_mm * measures.total / measures.border


def tag_pages(
    family: str, ids: list[int], size_mm: float, paper: str, places: Sequence[str] = (), piece: float = 0.0
) -> list[Page]:
    """Single tags to cut out, as many pages as they need.

    Args:
        family: Of the tags.
        ids: Their numbers.
        size_mm: Edge of the square between a tag's corners, [mm].
        paper: One of `PAPERS`.
        places: Where each belongs, such as the faces of a cube; they stand beside the numbers.
        piece: Edge of what the marks cut out, the tag in its middle, [mm]; at least `cell_mm`.

    Raises:
        UsageError: If a tag does not fit on the paper, or there is no such tag.
    """
    width, height = PAPERS[paper]
    whole = cell_mm(family, size_mm)
    cell = max(whole, piece)
    columns, rows = (int((room + GAP) // (cell + GAP)) for room in _room(paper))
    if not columns * rows:
        most = min(_room(paper))
        raise UsageError(
            f"a tag of {size_mm:g} mm is {cell:.1f} mm wide with its margin, too large for {paper}: at most "
            f"{math.floor(most * size_mm / whole)} mm, {math.floor(most)} mm with its margin"
        )
    pages = []
    left = (width - columns * cell - (columns - 1) * GAP) / 2
    for start in range(0, len(ids), columns * rows):
        on_page = ids[start : start + columns * rows]
        tags, lines, texts = [], _ruler(width, height), [_title(width, family, on_page, size_mm)]
        for number, tag in enumerate(on_page):
            row, column = divmod(number, columns)
            x, y = left + column * (cell + GAP), MARGIN + HEAD + row * (cell + GAP)
            tags.append(_blocks(family, tag, x + (cell - whole) / 2, y + (cell - whole) / 2, whole))
            lines += _cut_marks(x, y, cell, cell)
            place = places[start + number] if places else ""
            texts.append(Text(x + 1.0, y + cell + 3.6, 2.8, _label(family, tag, place, cell)))
        texts.append(_scale_words(width, height))
        pages.append(Page(width, height, tags, lines, texts))
    return pages


def board_page(family: str, columns: int, rows: int, size_mm: float, first: int, paper: str) -> Page:
    """A board for calibration: tags side by side on one piece, as `Layout.grid` with a pitch of `cell_mm`.

    Args:
        family: Of the tags.
        columns: Tags beside each other.
        rows: Tags above each other.
        size_mm: Of a tag, [mm].
        first: Id of the upper left tag.
        paper: One of `PAPERS`.

    Raises:
        UsageError: If it does not fit on the paper.
    """
    width, height = PAPERS[paper]
    cell, (across, down) = cell_mm(family, size_mm), _room(paper)
    if columns * cell > across or rows * cell + GAP > down:
        most = math.floor(size_mm * min(across / (columns * cell), (down - GAP) / (rows * cell)))
        advice = f": at most {most} mm" if most else ", whatever their size"
        raise UsageError(f"{columns} x {rows} tags of {size_mm:g} mm do not fit on {paper}{advice}")
    left, top = (width - columns * cell) / 2, MARGIN + HEAD
    ids = list(range(first, first + columns * rows))
    tags = []
    for number, tag in enumerate(ids):
        row, column = divmod(number, columns)
        tags.append(_blocks(family, tag, left + column * cell, top + row * cell, cell))
    bottom = top + rows * cell
    lines = _ruler(width, height) + _cut_marks(left, top, columns * cell, rows * cell)
    lines += [Block(left, bottom + 1.0, 8.0, 0.4), Block(left - 1.4, bottom - 8.0, 0.4, 8.0)]  # the board's axes
    texts = [
        _title(width, family, ids, size_mm),
        Text(left + 8.6, bottom + 2.2, 2.8, "x     origin: lower left corner of the piece that the marks cut out"),
        Text(left - 2.2, bottom - 8.6, 2.8, "y"),
        _scale_words(width, height),
    ]
    return Page(width, height, tags, lines, texts)


def _room(paper: str) -> tuple[float, float]:
    """Width and height that tags may take, [mm]."""
    width, height = PAPERS[paper]
    return width - 2 * MARGIN, height - 2 * MARGIN - HEAD - FOOT


def _blocks(family: str, tag: int, x: float, y: float, cell: float) -> list[Block]:
    """The black modules of a tag, runs in one piece."""
    black = modules(family, tag)
    module = cell / len(black)
    blocks = []
    for row, line in enumerate(black):
        start = None
        for column, filled in enumerate([*line, False]):
            if filled and start is None:
                start = column
            elif not filled and start is not None:
                blocks.append(Block(x + start * module, y + row * module, (column - start) * module, module))
                start = None
    return blocks


def _cut_marks(x: float, y: float, width: float, height: float) -> list[Block]:
    """Two strokes outside each corner of a rectangle."""
    marks = []
    for right in (x, x + width):
        for end in (y - MARK, y + height):
            marks.append(Block(right - THIN / 2, end, THIN, MARK))
    for below in (y, y + height):
        for end in (x - MARK, x + width):
            marks.append(Block(end, below - THIN / 2, MARK, THIN))
    return marks


def _ruler(width: float, height: float) -> list[Block]:
    """A line of `RULER` with a stroke every 10 mm."""
    left, y = (width - RULER) / 2, height - MARGIN - 6.0
    strokes = [
        Block(left + at - THIN / 2, y - (3.0 if at % 50 == 0 else 1.5), THIN, 3.0 if at % 50 == 0 else 1.5)
        for at in range(0, int(RULER) + 1, 10)
    ]
    return [Block(left, y - THIN / 2, RULER, THIN), *strokes]


def _label(family: str, tag: int, place: str, room: float) -> str:
    """What stands below a tag, as much of it as there is room for, [mm]."""
    choices = [f"{family}  id {tag}  {place}", f"id {tag}  {place}", f"{tag} {place}"]
    return next((words.rstrip() for words in choices if len(words) * LETTER < room), choices[-1].rstrip())


def _title(width: float, family: str, ids: list[int], size_mm: float) -> Text:
    runs = f"{ids[0]}" if len(ids) == 1 else f"{ids[0]} to {ids[-1]}"
    return Text(MARGIN, MARGIN + 2.5, 3.6, f"{family}   id {runs}   edge between the corners {size_mm:g} mm")


def _scale_words(width: float, height: float) -> Text:
    words = f"Print at 100 %. This line is {RULER:g} mm long: measure it, between the outer strokes."
    return Text((width - RULER) / 2, height - MARGIN - 1.5, 2.8, words)
