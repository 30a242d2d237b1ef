"""Arguments that several commands have, added to their parsers."""

from pathlib import Path

from svfl_data.system.command_line import Parser, natural


def add_path(parser: Parser) -> None:
    """Add the argument that names a dataset or an episode file."""
    parser.add_argument("path", type=Path, metavar="PATH", help="dataset folder, or episode file (.hdf5)")


def add_dataset(parser: Parser) -> None:
    """Add the argument that names a dataset."""
    parser.add_argument("path", type=Path, metavar="DATASET", help="dataset folder")


def add_new(parser: Parser, states: str = "absent or empty") -> None:
    """Add the argument that names the new dataset that the command writes.

    Args:
        parser: Parser of the command.
        states: Words for the help text that say what the folder may be.
    """
    parser.add_argument("destination", type=Path, metavar="NEW", help=f"folder of the new dataset: {states}")


def add_episode(parser: Parser, otherwise: str = "the first one") -> None:
    """Add the option ``--episode`` that chooses an episode of a dataset.

    Args:
        parser: Parser of the command.
        otherwise: Words for the help text that say which episode is used without the option.
    """
    parser.add_argument(
        "--episode", type=natural, metavar="N",
        help=f"number of the episode, if PATH is a dataset folder; at least 0 (default: {otherwise})",
    )  # fmt: skip


def add_allowances(parser: Parser) -> None:
    """Add the options ``--varies`` and ``--once``, which decide the episodes that a new dataset may contain."""
    parser.add_argument(
        "--varies", nargs="+", default=[], metavar="NAME",
        help="arrays, or groups of arrays, in which the copied episodes may differ, such as "
        "cameras/front/T_base_camera (default: only those in which the source datasets already allow differences)",
    )  # fmt: skip
    parser.add_argument(
        "--once",
        action="store_true",
        help="copy only the first of several copies of one recording (default: copies of one recording are an error)",
    )


def left_out_words(number: int) -> str:
    """Return words on how many copies were left out, for the end of a line; empty if there were none.

    Args:
        number: Number of copies that were left out.
    """
    return f"; {number} {'copy' if number == 1 else 'copies'} left out" if number else ""
