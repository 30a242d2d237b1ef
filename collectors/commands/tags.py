"""``svfl-collect tags``: write a page of tags to print in true size."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, add_json, between, natural, positive, report

SIZE_MM = 30.0  # default size of a tag


def add(commands: Commands) -> None:
    """Add ``tags`` to the commands of the command line."""
    parser = commands.add_parser(
        "tags",
        help="write a page of AprilTags to print: for objects, for a cube, or a board for calibration",
        description="Write a page of AprilTags (PDF or PNG) to be printed in true size. It has cut marks, ids, and a "
        "line of 100 mm with which the scale of the printer is checked. With --cube and --board, a JSON file of the "
        "same name is written as well, which states where the tags are on the body; the tracker and svfl-collect "
        "calibrate read it.",
        example="svfl-collect tags --count 12 --size 30 --out tags.pdf\n"
        "svfl-collect tags --cube 50 --out block.pdf                  # a tag for each face, as large as fits\n"
        "svfl-collect tags --cube 50 --printed 99.4 --out block.pdf   # the printed line is 99.4 mm long\n"
        "svfl-collect tags --board 4x5 --size 30 --paper letter --out board.pdf",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--count", type=positive, default=12, metavar="N", help="number of single tags (default: %(default)s)"
    )
    what.add_argument(
        "--cube", type=between(5, 200, "a length in mm"), metavar="MM",
        help="a tag for each face of a cube whose edge has this length, mm, between 5 and 200 (default: single tags)",
    )  # fmt: skip
    what.add_argument(
        "--board", type=_grid, metavar="CxR",
        help="a board of tags in C columns and R rows, such as 4x5 (default: single tags)",
    )  # fmt: skip
    parser.add_argument(
        "--first", type=natural, default=0, metavar="ID",
        help="id of the first tag, at least 0; the others have the ids after it (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--size", type=between(3, 250, "a length in mm"), metavar="MM",
        help="edge of the square between the corners of a tag, mm, between 3 and 250 "
        f"(default: {SIZE_MM:g}; with --cube the largest that fits on a face)",
    )  # fmt: skip
    parser.add_argument(
        "--family", default="tag36h11", metavar="NAME",
        help="AprilTag family, such as tag36h11 or tagStandard41h12 (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--printed", type=between(50, 200, "a length in mm"), default=100.0, metavar="MM",
        help="measured length of the 100 mm line on the printed page, mm, between 50 and 200; with --cube, corrects "
        "the size of the tags in the JSON file; for a board, give it to svfl-collect calibrate (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument(
        "--paper", choices=["a4", "letter"], default="a4", help="size of the paper (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE",
        help="file to write; its name ends in .pdf or .png; pages after the first are added to the PDF file, or are "
        "PNG files with a number",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Write the page and, for a cube or a board, the layout file, and print what was written.

    Args:
        arguments: Parsed options of the command.

    Raises:
        UsageError: If the file is neither PDF nor PNG, the tags do not fit, or --printed is not for a cube.
    """
    from collectors.apriltags.layout import FACES, Layout
    from collectors.apriltags.print_files import write
    from collectors.apriltags.print_layout import RULER, board_page, cell_mm, tag_pages
    from svfl_data.errors import UsageError

    out, family, first, paper = (getattr(arguments, name) for name in ("out", "family", "first", "paper"))
    size = arguments.size or SIZE_MM
    if out.suffix not in (".pdf", ".png"):
        raise UsageError(f"--out {out}: the name of a page must end in .pdf or .png")
    if arguments.printed != RULER and not arguments.cube:
        raise UsageError("--printed corrects the file of a --cube; for a board give it to svfl-collect calibrate")
    layout = None
    if arguments.board:
        columns, rows = arguments.board
        pages = [board_page(family, columns, rows, size, first, paper)]
        layout = Layout.grid(columns, rows, 1e-3 * size, 1e-3 * cell_mm(family, size), first, family)
    elif arguments.cube:
        largest = arguments.cube * size / cell_mm(family, size)
        size = arguments.size or largest
        if size > largest:
            raise UsageError(f"--size {size:g}: a face of {arguments.cube:g} mm has room for {largest:.4g} mm")
        ids, places = list(range(first, first + len(FACES))), [f"on {face}" for face in FACES]
        pages = tag_pages(family, ids, size, paper, places, arguments.cube)
        layout = Layout.cube(5e-4 * arguments.cube, 1e-3 * size * arguments.printed / RULER, first, family)
    else:
        pages = tag_pages(family, list(range(first, first + arguments.count)), size, paper)
    files = write(pages, out)
    lines = [f"{file}: {paper}, {family}, tags of {size:g} mm" for file in files]
    file = out.with_suffix(".json") if layout else None
    if layout and file:
        layout.write(file)
        lines.append(f"{file}: where its {len(layout.tags)} tags are")
    facts = {"files": files, "layout": file, "family": family, "paper": paper, "size_mm": size}
    report(arguments.json, facts, *lines)


def _grid(text: str) -> tuple[int, int]:
    try:
        columns, rows = map(int, text.lower().split("x"))
    except ValueError:
        columns = rows = 0
    if min(columns, rows) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a grid such as 4x5")
    return columns, rows
