"""Collectors: everything that produces episodes, in simulation and on real robots.

The names below are the public interface, documented and kept stable; all else in this package is private. They are
loaded when they are first used, and the simulation with them.

    >>> import collectors
    >>> dir(collectors)
    ['Environment', 'Robot', 'TASKS', '__version__', 'make', 'record']
"""

from typing import TYPE_CHECKING

import svfl_data  # noqa: F401 - says which extra installs a library that is not there
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
"""The module of every public name."""

__getattr__, __dir__ = lazy_names(__name__, HOMES)
