"""Names of the trackers, and the check that a tracker's library is installed; loads none of the libraries."""

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Literal, get_args

from svfl_data.errors import UsageError
from svfl_data.system.extras import needs
from svfl_data.system.printable import printable

TrackerName = Literal["tensorboard", "wandb", "mlflow"]
"""Name of a tracker, which is also the name of its library and of the extra that installs it."""
TRACKERS: tuple[str, ...] = get_args(TrackerName)


def check_trackers(names: Sequence[str]) -> None:
    """Refuse trackers that do not exist or whose library is not installed.

    Args:
        names: Names of the trackers, each once.

    Raises:
        UsageError: If a name is unknown or repeated, or a library is missing; the message names the extra.
    """
    for name in names:
        if name not in TRACKERS:
            raise UsageError(f"--logger {printable(name, 40)}: no such tracker; possible: {', '.join(TRACKERS)}")
        if names.count(name) > 1:
            raise UsageError(f"--logger {name} is given twice")
        if not _installed(name):
            raise UsageError(f"--logger {name} {needs(name)}")


def _installed(library: str) -> bool:
    try:
        return find_spec(library) is not None
    except ModuleNotFoundError:  # what `svfl_data.system.extras` raises for a missing library
        return False
