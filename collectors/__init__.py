"""Collectors: everything that produces episodes, in simulation and on real robots.

The names below are the public interface: they are documented and kept stable. All other names in this package are
private. Each public name is loaded when it is first used. `Environment` and `make` load the simulation as well.

    >>> import collectors
    >>> dir(collectors)
    ['Environment', 'Robot', 'TASKS', '__version__', 'make', 'record']
"""

from typing import TYPE_CHECKING

import svfl_data  # noqa: F401 - makes the error for a missing library name the extra that installs it
from svfl_data.system.lazy_names import lazy_names

if TYPE_CHECKING:
    from collectors.environment import Environment as Environment
    from collectors.environment import make as make
    from collectors.recording.loop import Robot as Robot
    from collectors.recording.loop import record as record
    from collectors.tasks import TASKS as TASKS

    __version__: str

HOMES = {
    "Environment": "environment", "Robot": "recording.loop", "TASKS": "tasks", "make": "environment",
    "record": "recording.loop",
}  # fmt: skip
"""Module of each public name, relative to this package."""

__getattr__, __dir__ = lazy_names(__name__, HOMES)
