"""Reports of commands: lines of text for people, or with ``--json`` one JSON object for programs."""

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from os import PathLike, fspath
from typing import Any

from svfl_data.system.command_line.parser import Parser
from svfl_data.system.printable import say


def add_json(parser: Parser) -> None:
    """Add the option ``--json``, with which a command prints its report as one JSON object."""
    parser.output.add_argument("--json", action="store_true", help="print one JSON object (default: lines of text)")


def report(as_json: bool, facts: Mapping[str, Any], *lines: object) -> None:
    """Print what a command found or did.

    Args:
        as_json: Whether to print the facts as JSON instead of the lines.
        facts: Names and values for programs.
        *lines: Lines for people, each of which stays a single harmless line.
    """
    if as_json:
        print(json_text(facts), flush=True)
    else:
        say(*lines)


def json_text(value: Any) -> str:  # noqa: ANN401 - any value that `as_json` supports
    r"""Return a value as JSON in ASCII, so that text from files cannot take over a terminal.

    Args:
        value: Value that `as_json` supports.

    Example:
        >>> print(json_text({"name": "a\x7fb"}))
        {
          "name": "a\u007fb"
        }
    """
    return json.dumps(as_json(value), indent=2, allow_nan=False).replace("\x7f", "\\u007f")


def as_json(value: Any) -> Any:  # noqa: ANN401 - any value and its JSON form
    """Return a value in types that JSON has; a number that JSON lacks, such as infinity, becomes null.

    Args:
        value: JSON value, path, dataclass, array or number of numpy, or a mapping or sequence of them.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_json(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): as_json(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(one) for one in value]
    if isinstance(value, PathLike):
        return str(fspath(value))
    if hasattr(value, "tolist"):  # arrays and scalars of numpy, which this module does not import
        return as_json(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
