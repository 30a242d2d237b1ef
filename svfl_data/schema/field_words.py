"""Description of a declaration in words: names and units of components, meaning, assumptions."""

from collections.abc import Container, Iterable
from itertools import groupby
from math import prod

from svfl_data.schema.declarations import Declarations, standard_field
from svfl_data.schema.field import Field
from svfl_data.system.printable import printable

OBSERVED = "observations/t_ns"
WRENCH_UNITS = ("N", "N", "N", "N m", "N m", "N m")
POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
LONGEST = 40
"""Largest number of characters of one name or unit that is shown."""
SHOWN_BOUNDS = 4
"""Largest number of different bounds that are written out."""


def component_names(field: Field, row: tuple[int, ...]) -> list[str]:
    """Return the name of each number of a row: declared names, or numbers from 0 on.

    Args:
        field: Declaration of the array.
        row: Shape of one row. The numbers of a row that has several axes are named by all their indices.

    Example:
        >>> component_names(Field(path="streams/a/b", dtype="float32", shape=("T", 2, 2)), (2, 2))
        ['0,0', '0,1', '1,0', '1,1']
    """
    if not row:
        return [printable(field.path.rpartition("/")[2], LONGEST)]
    last = [printable(name, LONGEST) for name in field.components] or list(map(str, range(row[-1])))
    names = [""]
    for size in row[:-1]:
        names = [f"{name}{index}," for name in names for index in range(size)]
    return [name + one for name in names for one in last]


def component_units(field: Field, row: tuple[int, ...]) -> list[str]:
    """Return the unit of each number of a row; empty for numbers without a unit.

    A declaration may give one unit for each component, or units that belong to no component in particular, such as
    ``rad, m`` for the joints of an arm and its fingers; then every number has all of them.

    Args:
        field: Declaration of the array.
        row: Shape of one row.

    Example:
        >>> component_units(Field(path="a/b", dtype="f4", shape=("T", 2), unit="m, rad"), (2,))
        ['m', 'rad']
    """
    units = [printable(unit, LONGEST) for unit in field.unit.split(", ")]
    if field.components == POSE and len(units) == 2:
        units = units[:1] * 3 + units[1:] * 4
    if not row or len(units) != row[-1]:
        units = [printable(field.unit, LONGEST)] * (row[-1] if row else 1)
    return ["" if unit == "-" else unit for unit in units] * prod(row[:-1])


def labels(field: Field, row: tuple[int, ...]) -> list[str]:
    """Return name and unit of each number of a row, such as ``fx, N``; the name alone if its unit is not known.

    Args:
        field: Declaration of the array.
        row: Shape of one row.
    """
    pairs = zip(component_names(field, row), component_units(field, row), strict=True)
    return [f"{name}, {unit}" if unit and ", " not in unit else name for name, unit in pairs]


def by_unit(field: Field, row: tuple[int, ...]) -> dict[str, list[int]]:
    """Group the numbers of a row by their unit, because numbers of one unit can share an axis of a plot.

    Args:
        field: Declaration of the array.
        row: Shape of one row.

    Returns:
        Indices of the numbers in the flattened row, by unit, in the order in which the units come.
    """
    found: dict[str, list[int]] = {}
    for column, unit in enumerate(component_units(field, row)):
        found.setdefault(unit, []).append(column)
    return found


def title(field: Field, whole: bool = False) -> str:
    """Return the path of an array with its units, such as ``tactile/pressure, kPa``.

    Args:
        field: Declaration of the array.
        whole: Whether to write ``streams/tactile/pressure [kPa]`` instead, as lists of arrays do.
    """
    units = printable(", ".join(dict.fromkeys(unit for unit in field.unit.split(", ") if unit != "-")), LONGEST)
    if whole:
        return printable(field.path, 2 * LONGEST) + (f" [{units}]" if units else "")
    name = printable(field.path.removeprefix("streams/"), 2 * LONGEST)
    return f"{name}, {units}" if units else name


def meaning(field: Field) -> str:
    """Return axes, reference point, bounds and assumptions of an array in words; empty if there are none.

    Args:
        field: Declaration of the array.

    Example:
        >>> meaning(Field(path="streams/a/b", dtype="f4", shape=("T", 3), axes="base", assumed=("axes",)))
        'axes base; assumed: axes'
    """
    said = [f"{word} {value}" for word, value in (("axes", field.axes), ("about", field.about)) if value != "-"]
    if field.bounds:
        said.append(bounds_words(field))
    if field.assumed:
        said.append(f"assumed: {', '.join(field.assumed)}")
    return printable("; ".join(said))


def bounds_words(field: Field) -> str:
    """Return the bounds of a commanded array in words, such as ``dx, dy, dz -0.02 to 0.02 m``.

    Args:
        field: Declaration of an array with bounds.
    """
    row = (len(field.bounds),)
    names, units = component_names(field, row), component_units(field, row)
    columns = groupby(range(len(names)), key=lambda column: (field.bounds[column], units[column]))
    said = []
    for ((low, high), unit), members in columns:
        which = ", ".join(names[column] for column in members)
        said.append(f"{which} {low:.4g} to {high:.4g}{' ' + unit if unit else ''}")
    more = [f"{len(said) - SHOWN_BOUNDS} more"] if len(said) > SHOWN_BOUNDS else []
    return "bounds " + ", ".join([*said[:SHOWN_BOUNDS], *more])


def assumed_words(field: Field) -> list[str]:
    """Return a sentence for each attribute of a declaration that is an assumption, such as ``axes are assumed``.

    Args:
        field: Declaration of the array.
    """
    return [f"{name} {'are' if name.endswith('s') else 'is'} assumed" for name in field.assumed]


def is_wrench(field: Field | None) -> bool:
    """Return whether an array holds the readings of a wrench sensor: ``wrench`` with 3 components in N and 3 in N m.

    Args:
        field: Declaration of the array; None for arrays without one.
    """
    if field is None or field.path.rpartition("/")[2] != "wrench" or not field.path.startswith("streams/"):
        return False
    return field.grows and field.shape[1:] == (6,) and tuple(field.unit.split(", ")) == WRENCH_UNITS


def wrench_groups(paths: Iterable[str], declarations: Declarations) -> list[str]:
    """Return the groups of all wrench sensors of an episode, ``streams/wrench`` first.

    Args:
        paths: Dataset paths of the recorded arrays.
        declarations: Declarations of the arrays.
    """
    found = [path.rpartition("/")[0] for path in paths if is_wrench(declarations.at(path))]
    return sorted(found, key=lambda group: (group != "streams/wrench", group))


def own(paths: Iterable[str], declarations: Declarations) -> list[Field]:
    """Return the declarations of the recorded arrays that are the user's own, without clocks.

    Args:
        paths: Dataset paths of the recorded arrays.
        declarations: Declarations of the arrays.
    """
    fields = (declarations.at(path) for path in paths if standard_field(path) is None and not path.endswith("/t_ns"))
    return [field for field in fields if field]


def clock_of(path: str) -> str:
    """Return the path of the time stamps of an array's rows; those of an action are of the observation before it.

    Args:
        path: Dataset path of the array.
    """
    group = path.rpartition("/")[0]
    return OBSERVED if group == "actions" else f"{group}/t_ns"


def camera_pose(camera: str, paths: Container[str]) -> str:
    """Return in words where a camera is: empty if it is fixed, else ``moves``, ``on the gripper`` or ``no pose``.

    Args:
        camera: Name of the camera.
        paths: Dataset paths of the recorded arrays.
    """
    if f"cameras/{camera}/T_base_camera" in paths:
        return ""
    if f"cameras/{camera}/T_base_camera_per_frame" in paths:
        return "moves"
    return "on the gripper" if f"cameras/{camera}/T_tcp_camera" in paths else "no pose"
