"""Robots by name: those of this package, and those that other packages add.

A package adds a robot by an entry point of the robot's name:

    [project.entry-points."svfl.robots"]
    my_arm_sim = "my_package.my_robot:MyRobotConfig"
    my_arm = "my_package.my_robot:MyRobot"

A simulated robot is a class of its configuration, a frozen dataclass on `collectors.simulation.arms.arm.RobotConfig`
whose field `name` has the robot's name as its default. Then all commands take ``--robot my_arm_sim``, and episodes of
the robot can be replayed. Any other robot is a class, or a function without arguments, that makes a
`svfl_data.schema.robot.Robot`; ``svfl-collect teleop`` and ``svfl-collect policy`` take it.
"""

from collections.abc import Callable, Collection
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any

from svfl_data.errors import UsageError
from svfl_data.schema.robot import Robot
from svfl_data.system.near_names import instead
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
METHODS = [name for name, member in vars(Robot).items() if callable(member) and not name.startswith("_")]
FACTS = [name for name, member in vars(Robot).items() if isinstance(member, property)]
"""What the contract asks for; the facts may become known by connecting."""


def robots() -> dict[str, str]:
    """Return the place of every robot, as ``module:attribute``, by the robot's name.

    A name of this package means this package's robot, whatever other packages declare.
    """
    return {entry.name: entry.value for entry in entry_points(group=GROUP)} | OWN


def is_simulated(name: str) -> bool:
    """Return whether the robot with a given name is a simulated one.

    Raises:
        UsageError: If no robot has that name, or its package does not have what it declares.
    """
    if name in OWN:
        return True
    from collectors.simulation.arms.arm import RobotConfig

    found = _loaded(name)
    return isinstance(found, type) and issubclass(found, RobotConfig)


def robot_class(name: str) -> "type[RobotConfig]":
    """Return the configuration class of the simulated robot with a given name.

    Raises:
        UsageError: If no robot has that name, its package does not have what it declares, or it is not simulated.
    """
    if not is_simulated(name):
        raise UsageError(f"robot {name} is not simulated, which this needs; simulated are {', '.join(sorted(OWN))}")
    found: type[RobotConfig] = _loaded(name)
    return found


def make(name: str) -> "RobotConfig":
    """Return the configuration of the simulated robot with a given name, with its default numbers.

    Raises:
        UsageError: If no robot has that name, its package does not have what it declares, or it is not simulated.

    Example:
        >>> make("panda_sim").name
        'panda_sim'
    """
    return robot_class(name)()


def connected(name: str) -> Robot:
    """Return the robot with a given name that is not simulated, connected.

    Raises:
        UsageError: If no such robot has that name, its package does not have what it declares, or it is no robot.
        CollectError: If the robot cannot be reached.
    """
    if is_simulated(name):
        raise UsageError(f"robot {name} is simulated; it needs a World and a task")
    make_robot: Callable[[], Robot] = _loaded(name)
    robot = make_robot()
    _require(robot, METHODS, name)
    robot.connect()
    try:
        _require(robot, FACTS, name)
    except UsageError:
        robot.close()
        raise
    return robot


def _require(robot: Robot, members: Collection[str], name: str) -> None:
    if lacking := [member for member in members if not hasattr(robot, member)]:
        words = f"{robots()[name]} has no {', '.join(lacking)}"
        raise UsageError(f"robot {name}: {words}, which every robot needs (svfl_data.Robot)")


def recorded_class(values: Any) -> "type[RobotConfig]":  # noqa: ANN401 - any JSON value
    """Return the configuration class of a robot whose configuration was stored as JSON values.

    Args:
        values: JSON values that `dataclasses.asdict` made of a robot's configuration.

    Raises:
        UsageError: If the values do not name a simulated robot.
    """
    name = values.get("name") if isinstance(values, dict) else None
    if not isinstance(name, str):
        raise UsageError(f"expected a robot's configuration with its name, got {printable(values, 100)}")
    return robot_class(name)


def _loaded(name: str) -> Any:  # noqa: ANN401 - whatever a package declares
    known = robots()
    if name not in known:
        raise UsageError(f"no robot {printable(name)!r}; {instead(name, sorted(known))}")
    module, _, attribute = known[name].partition(":")
    try:
        found = getattr(import_module(module), attribute)
        if not callable(found):
            raise AttributeError(f"{attribute} is neither a class nor a function")
    except (ImportError, AttributeError) as error:
        if name in OWN:
            raise
        raise UsageError(f"robot {name}: {known[name]} cannot be loaded ({printable(error)})") from error
    return found
