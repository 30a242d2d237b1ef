"""Types of command-line arguments that several commands use, in the form that argparse asks for."""

import argparse
import math
from collections.abc import Callable

LAST_PORT = 2**16 - 2


def positive(text: str) -> int:
    """Parse a command-line argument that must be an integer of at least 1.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 1)


def natural(text: str) -> int:
    """Parse a command-line argument that must be an integer of at least 0.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 0)


def port(text: str) -> int:
    """Parse a command-line argument that must be the number of a TCP port, and not the last one.

    Raises:
        argparse.ArgumentTypeError: If the text is not such an integer.
    """
    return _integer(text, 1, LAST_PORT)


def yes_no(text: str) -> bool:
    """Parse a command-line argument that must be ``yes`` or ``no``.

    Raises:
        argparse.ArgumentTypeError: If it is neither.
    """
    if text not in ("yes", "no"):
        raise argparse.ArgumentTypeError(f"{text!r} is neither yes nor no")
    return text == "yes"


def between(low: float, high: float, what: str) -> Callable[[str], float]:
    """Return an argument type that accepts a number in a range.

    Args:
        low: Smallest number that is accepted.
        high: Largest number that is accepted.
        what: Name of the quantity for the error message, such as ``an angle in degrees``.

    Returns:
        Function for argparse that turns a text into a number.
    """

    def number(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text!r} is not {what} between {low:g} and {high:g}")
        return value

    return number


def _integer(text: str, least: int, most: int | None = None) -> int:
    try:
        value = int(text)
    except ValueError:
        value = least - 1
    if value < least or (most is not None and value > most):
        possible = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise argparse.ArgumentTypeError(f"{text!r} is not an integer {possible}")
    return value
