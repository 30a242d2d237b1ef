"""The tasks, one file each. A new task needs its file and a line here (docs/adding-a-task.md)."""

from importlib import import_module
from typing import TYPE_CHECKING

from svfl_data.errors import UsageError
from svfl_data.system.near_names import instead

if TYPE_CHECKING:
    from collectors.tasks.task import Task

TASKS = {
    "block_picking": "BlockPicking",
    "block_pushing": "BlockPushing",
    "block_pulling": "BlockPulling",
    "block_corner_pulling": "BlockCornerPulling",
    "mug_picking": "MugPicking",
    "household_picking": "HouseholdPicking",
    "household_picking_heldout": "HouseholdPickingHeldout",
    "peg_insertion": "PegInsertion",
    "drawer_opening": "DrawerOpening",
    "drawer_closing": "DrawerClosing",
    "block_centering": "BlockCentering",
}
"""Class of every task by the task's name.

The name is also that of the task's file in this folder. The task's id in gymnasium is ``svfl/<task>-v0``.
"""

PAPER = tuple(task for task in TASKS if task not in ("household_picking_heldout", "block_centering"))
"""Names of the paper's nine tasks, for which ``--task all`` stands."""


def task_class(name: str) -> "type[Task]":
    """Return the class of the task with a given name.

    Raises:
        UsageError: If no task has that name.
    """
    if name not in TASKS:
        raise UsageError(f"no task {name!r}; {instead(name, TASKS)}")
    found: type[Task] = getattr(import_module(f"collectors.tasks.{name}"), TASKS[name])
    return found
