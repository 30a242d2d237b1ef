"""Pages of tags to print, as positions on the paper in millimetres from its upper left corner."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from collectors.apriltags.picture import modules, shape
from svfl_data.errors import UsageError

PAPERS = {"a4": (210.0, 297.0), "letter": (215.9, 279.4)}  # [mm] width and height
MARGIN = 12.0  # [mm] width of the edge of the paper that printers may leave white
FOOT = 16.0  # [mm] height at the lower end of the page that is kept for the ruler
HEAD = 8.0  # [mm] height at the upper end of the page that is kept for the title
GAP = 7.0  # [mm] distance between tags that are to be cut out, which leaves room for cut marks and numbers
LETTER = 1.6  # [mm] largest width of a letter in the words below a tag
MARK = 2.5  # [mm] length of a cut mark
RULER = 100.0  # [mm] length of the ruler
THIN = 0.15  # [mm] width of the lines of the ruler and the cut marks


@dataclass(frozen=True)
class Block:
    """Filled rectangle with its upper left corner at x, y, [mm]."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Text:
    """Line of text whose lower left corner is at x, y, [mm]; `size` is the height of the line, [mm]."""

    x: float
    y: float
    size: float
    words: str


@dataclass(frozen=True)
class Page:
    """Content of one page of paper.

    Attributes:
        width: Width of the paper, [mm].
        height: Height of the paper, [mm].
        tags: Black modules of each tag.
        lines: Thin rectangles that make up cut marks, ruler and axes.
        texts: Texts such as ids, title and measures.
    """

    width: float
    height: float
    tags: list[list[Block]]
    lines: list[Block]
    texts: list[Text]


def cell_mm(family: str, size_mm: float) -> float:
    """Return the edge length of a tag's whole picture, including the white margin that the tag needs, [mm].

    Args:
        family: Family of the tag.
        size_mm: Edge of the square between the tag's corners, [mm].

    Raises:
        UsageError: If there is no such family.
    """
    measures = shape(family)
    return size_mm * measures.total / measures.border


def tag_pages(
    family: str, ids: list[int], size_mm: float, paper: str, places: Sequence[str] = (), piece: float = 0.0
) -> list[Page]:
    """Arrange single tags for cutting out on as many pages as they need.

    Args:
        family: Family of the tags.
        ids: Ids of the tags in the family.
        size_mm: Edge of the square between a tag's corners, [mm].
        paper: Paper size, one of `PAPERS`.
        places: Name of the place where each tag belongs, such as the faces of a cube, which is printed beside its id.
            No names by default.
        piece: Edge of the square that the cut marks cut out, with the tag in its middle, [mm]. Values below `cell_mm`
            have the same effect as `cell_mm`.

    Raises:
        UsageError: If a tag does not fit on the paper, or there is no such family or tag.
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
    """Arrange a calibration board, whose tags lie side by side on one piece.

    The board is that of `Layout.grid` with a pitch of `cell_mm`.

    Args:
        family: Family of the tags.
        columns: Number of tags beside each other.
        rows: Number of tags above each other.
        size_mm: Edge of the square between a tag's corners, [mm].
        first: Id of the upper left tag.
        paper: Paper size, one of `PAPERS`.

    Raises:
        UsageError: If the board does not fit on the paper, or there is no such family or tag.
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
    """Return the width and height that tags may take on a paper, [mm]."""
    width, height = PAPERS[paper]
    return width - 2 * MARGIN, height - 2 * MARGIN - HEAD - FOOT


def _blocks(family: str, tag: int, x: float, y: float, cell: float) -> list[Block]:
    """Return the black modules of a tag, with each horizontal run of modules as one block."""
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
    """Return two strokes outside each corner of a rectangle."""
    marks = []
    for right in (x, x + width):
        for end in (y - MARK, y + height):
            marks.append(Block(right - THIN / 2, end, THIN, MARK))
    for below in (y, y + height):
        for end in (x - MARK, x + width):
            marks.append(Block(end, below - THIN / 2, MARK, THIN))
    return marks


def _ruler(width: float, height: float) -> list[Block]:
    """Return a line of length `RULER` with a stroke every 10 mm."""
    left, y = (width - RULER) / 2, height - MARGIN - 6.0
    strokes = [
        Block(left + at - THIN / 2, y - (3.0 if at % 50 == 0 else 1.5), THIN, 3.0 if at % 50 == 0 else 1.5)
        for at in range(0, int(RULER) + 1, 10)
    ]
    return [Block(left, y - THIN / 2, RULER, THIN), *strokes]


def _label(family: str, tag: int, place: str, room: float) -> str:
    """Return the longest label of a tag that fits into a width of `room`, [mm], or else the shortest label."""
    choices = [f"{family}  id {tag}  {place}", f"id {tag}  {place}", f"{tag} {place}"]
    return next((words.rstrip() for words in choices if len(words) * LETTER < room), choices[-1].rstrip())


def _title(width: float, family: str, ids: list[int], size_mm: float) -> Text:
    runs = f"{ids[0]}" if len(ids) == 1 else f"{ids[0]} to {ids[-1]}"
    return Text(MARGIN, MARGIN + 2.5, 3.6, f"{family}   id {runs}   edge between the corners {size_mm:g} mm")


def _scale_words(width: float, height: float) -> Text:
    words = f"Print at 100 %. This line is {RULER:g} mm long: measure it, between the outer strokes."
    return Text((width - RULER) / 2, height - MARGIN - 1.5, 2.8, words)
