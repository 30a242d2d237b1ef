"""The tasks: one file each. Adding one means its file and a line here (docs/adding-a-task.md)."""

from importlib import import_module
from typing import TYPE_CHECKING

from svfl_data.errors import UsageError

if TYPE_CHECKING:
    from collectors.tasks.task import Task

TASKS = {
    "block_picking": "BlockPicking",
}
"""Name of every task, which is also its file in this folder, and its class; gymnasium's id is ``svfl/<class>-v0``."""


def task_class(name: str) -> "type[Task]":
    """The class of a task.

    Raises:
        UsageError: If there is no such task.
    """
    if name not in TASKS:
        raise UsageError(f"no task {name!r}; the tasks are {', '.join(TASKS)}")
    found: type[Task] = getattr(import_module(f"collectors.tasks.{name}"), TASKS[name])
    return found
