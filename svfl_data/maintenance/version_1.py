"""Reading of episodes of version 1 of the format, which is only done to upgrade them (`svfl_data.maintenance.upgrade`).

An episode of version 1 has the standard arrays of its time (`PATHS`), whose declarations were part of the software, and
the user's own arrays below ``extra/``. Its readers ignored any other array. The bounds of its actions stand in its
configuration, or nowhere. The file is treated like one of the present version: its seal is checked first, only the
examiner lets HDF5 read it, and all limits of `svfl_data.storage.admission` hold.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from svfl_data.errors import FieldError, FormatError, OldVersionError
from svfl_data.schema.action_fields import ACTION, EXPERT_ACTION, expert, planar_action
from svfl_data.schema.declarations import CHOSEN, Declarations, standard_field
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import FARTHEST
from svfl_data.schema.fields import CAMERA, EXTRA
from svfl_data.storage.admission import Description
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import Header, check_format, checked_seal, examined
from svfl_data.storage.metadata import JSON_ATTRIBUTES, PLAIN_ATTRIBUTES, parse_meta
from svfl_data.storage.reader import load_arrays
from svfl_data.storage.seal import SEAL_SIZE
from svfl_data.system.printable import printable

PATHS = frozenset(
    {
        "observations/t_ns", "observations/proprio", "actions/action", "actions/expert_action",
        "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare",
        "streams/joints/t_ns", "streams/joints/position",
        "streams/object/t_ns", "streams/object/pose", "streams/object/half_extents",
        "streams/tags/t_ns", "streams/tags/pose", "streams/tags/age", "streams/tags/error", "streams/tags/margin",
        "streams/tags/count",
        "cameras/{camera}/t_ns", "cameras/{camera}/color", "cameras/{camera}/depth", "cameras/{camera}/depth_scale",
        "cameras/{camera}/intrinsics", "cameras/{camera}/T_base_camera", "cameras/{camera}/image_axes",
        "workspace", "labels/offset", "labels/direction",
    }
)  # fmt: skip
"""Dataset paths of the standard arrays of version 1. Their meaning is that of the standard fields of these paths."""
MEANING = ("unit", "axes", "about")
"""Attributes of an array that had to be equal to those of its standard field."""
ADDED = ("instruction", "robot", "operator")
"""Attributes of an episode that version 1 does not have."""
NAMES = {
    "names": ["format", "format_version", *(key for key in PLAIN_ATTRIBUTES if key not in ADDED), *JSON_ATTRIBUTES],
    "meaning": list(MEANING),
}
SIMULATED = "world"
"""Key that the configuration of every simulated episode has, whose robot is `SIMULATED_ROBOT`."""
SIMULATED_ROBOT = "panda_sim"


@dataclass(frozen=True)
class OldEpisode:
    """An episode of version 1, declared as the present version declares it.

    Attributes:
        episode: The episode; its images are still on disk.
        version: Format version of its file, such as ``1.0``.
        seal: Seal of its file: the SHA-256 of its content, in hexadecimal.
        left_out: Dataset paths of the arrays that no reader of version 1 knew.
    """

    episode: Episode
    version: str
    seal: str
    left_out: tuple[str, ...]


def read_version_1(extent: Extent) -> OldEpisode | None:
    """Read an episode of version 1.

    Args:
        extent: Place of the episode.

    Returns:
        The episode; None if it is of the present version.

    Raises:
        FormatError: If the file is damaged, is not an episode, is of another version or is refused.
        FieldError: If a field is missing or does not fit its declaration.
        StorageError: If the examiner cannot be started.
    """
    seal, size = checked_seal(extent), extent.size - SEAL_SIZE
    answer = examined(extent, size, NAMES)
    description = Description(answer, extent)
    try:
        if not (description.problem and not description.attributes):
            check_format(description.attributes, extent)
            return None
    except OldVersionError:
        pass
    if description.problem:
        raise FormatError(f"{extent}: {description.problem}")
    left_out = tuple(path for path in description.arrays if not _known(path))
    for path, said in description.arrays.items():
        _check_meaning(path, said, extent)
    attributes: dict[str, Any] = {**description.attributes, **dict.fromkeys(ADDED, "")}
    config = parse_meta(attributes, extent).config
    attributes["robot"] = SIMULATED_ROBOT if SIMULATED in config else ""
    declarations = _declarations(config, description.arrays)
    placements = description.placements(size, declarations, left_out)
    found = Header(seal, attributes, placements, declarations, True, len(answer))
    version = str(description.attributes["format_version"])
    return OldEpisode(load_arrays(extent, found, images=False), version, seal, left_out)


def _known(path: str) -> bool:
    """Return whether readers of version 1 knew an array."""
    group, _, rest = path.partition("/")
    leaf = rest.partition("/")[2]
    return path.startswith(EXTRA) or (f"cameras/{CAMERA}/{leaf}" if group == "cameras" else path) in PATHS


def _check_meaning(path: str, found: Mapping[str, Any], extent: Extent) -> None:
    """Raise an error if an array is said to have another unit, other axes or another point than its field."""
    field = standard_field(path) if _known(path) else None
    for name in MEANING if field else ():
        here, there = found.get(name), getattr(field, name)
        if here != there:
            raise FieldError(f"{extent}: field {path} has {name} {printable(repr(here), 100)}, expected {there!r}")


def _declarations(config: Mapping[str, Any], paths: Iterable[str]) -> Declarations:
    """Return the declarations of an episode: the standard ones, and actions with the bounds of its configuration."""
    found = config.get(SIMULATED, config)
    move, turn = (found.get(name) for name in ("max_move", "max_turn")) if isinstance(found, dict) else (None, None)
    declared = _positive(move) and _positive(turn)
    action = planar_action(float(move), float(turn)) if declared else replace(planar_action(), assumed=("bounds",))  # type: ignore[arg-type] # _positive: a number
    actions = {ACTION: action, EXPERT_ACTION: expert(action)}
    return Declarations(actions[path] for path in CHOSEN if path in paths)


def _positive(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 < value <= FARTHEST
