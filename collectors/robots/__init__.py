"""Simulated robots by name: those of this package, and those that other packages add.

A package adds a robot by a class of its configuration, a frozen dataclass on
`collectors.simulation.arms.arm.RobotConfig` whose field `name` has the robot's name as its default, and by an entry
point of that name for the class:

    [project.entry-points."svfl.robots"]
    my_robot = "my_package.my_robot:MyRobotConfig"

Then commands take ``--robot my_robot``, and episodes of the robot can be replayed.
"""

from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from svfl_data.errors import UsageError
from svfl_data.system.printable import printable

if TYPE_CHECKING:
    from collectors.simulation.arms.arm import RobotConfig

GROUP = "svfl.robots"
DEFAULT = "panda_sim"
OWN = {
    "panda_sim": "collectors.simulation.arms.panda:PandaConfig",
    "ur5e_sim": "collectors.simulation.arms.ur5e:UR5eConfig",
}
"""Robots of this package, which are known where the package is not installed as well."""


def robots() -> dict[str, str]:
    """Return the place of every robot's configuration class, as ``module:class``, by the robot's name.

    A name of this package means this package's robot, whatever other packages declare.
    """
    return {entry.name: entry.value for entry in entry_points(group=GROUP)} | OWN


def robot_class(name: str) -> "type[RobotConfig]":
    """Return the configuration class of the robot with a given name.

    Raises:
        UsageError: If no robot has that name, or its package does not have what it declares.
    """
    known = robots()
    if name not in known:
        raise UsageError(f"no robot {printable(name)!r}; the robots are {', '.join(sorted(known))}")
    module, _, attribute = known[name].partition(":")
    try:
        found: type[RobotConfig] = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        if name in OWN:
            raise
        raise UsageError(f"robot {name}: {known[name]} cannot be loaded ({printable(error)})") from error
    return found


def make(name: str) -> "RobotConfig":
    """Return the configuration of the robot with a given name, with its default numbers.

    Raises:
        UsageError: If no robot has that name, or its package does not have what it declares.

    Example:
        >>> make("panda_sim").name
        'panda_sim'
    """
    return robot_class(name)()


def recorded_class(values: Any) -> "type[RobotConfig]":  # noqa: ANN401 - any JSON value
    """Return the configuration class of a robot whose configuration was stored as JSON values.

    Args:
        values: JSON values that `dataclasses.asdict` made of a robot's configuration.

    Raises:
        UsageError: If the values do not name a robot.
    """
    name = values.get("name") if isinstance(values, dict) else None
    if not isinstance(name, str):
        raise UsageError(f"expected a robot's configuration with its name, got {printable(values, 100)}")
    return robot_class(name)
