"""Finding of the value of each setting among defaults, a file, ``--set`` and flags."""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from svfl_data.errors import UsageError
from svfl_data.system.printable import printable
from svfl_models.configuration.setting import UNSET, Setting, closest, settings_of
from svfl_models.configuration.yaml_file import PROGRAM, Located, parse_value, read_yaml

Kind = TypeVar("Kind")


def resolve(
    settings: Sequence[Setting],
    file: Path | None = None,
    assignments: Iterable[str] = (),
    flags: Mapping[str, Any] | None = None,
    program: str = "",
) -> dict[str, Any]:
    """Return the value of each setting that is given: in a file, and on the command line, which has precedence.

    Args:
        settings: Settings of the program.
        file: YAML file with values; None for no file.
        assignments: Texts ``NAME=VALUE`` of ``--set``; a dot leads into a mapping, as in ``widths.latent=12``.
        flags: Values of the flags that were given, by name of the setting; a dot as in `assignments`.
        program: Name of the program. A file whose key ``program`` names another one is refused.

    Returns:
        Checked values by name. Of a mapping there is what was given of it.

    Raises:
        UsageError: If a setting is unknown, a value is impossible, or a flag contradicts ``--set``.
    """
    found: dict[str, Any] = {}
    if file is not None:
        values = read_yaml(file)
        meant = values.pop(PROGRAM, program)
        if program and meant != program:
            raise UsageError(f"{file}: holds the settings of svfl-train {printable(meant, 40)}, not of {program}")
        _take(settings, values, found, file)
    line: dict[str, Any] = {}
    for text in assignments:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise UsageError(f"--set {printable(text, 60)}: must be NAME=VALUE, such as --set epochs=20")
        _assign(settings, name.split("."), value, line, f"--set {printable(text, 60)}")
    for name, value in (flags or {}).items():
        _put(line, name.split("."), value)
    return _merged(found, line)


def complete(settings: Sequence[Setting], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for every setting: the given one, or the default.

    Args:
        settings: Settings of the program.
        given: Values that `resolve` returned.

    Raises:
        UsageError: If a setting without a default is not given.
    """
    values: dict[str, Any] = {}
    for setting in settings:
        value = given.get(setting.name, setting.default)
        if value is UNSET:
            raise UsageError(f"{setting.name} is missing: give {_flag(setting.name)}, or {setting.name}: in --config")
        kind = setting.plain_type
        if dataclasses.is_dataclass(kind) and isinstance(value, Mapping):
            base = setting.default if dataclasses.is_dataclass(setting.default) else None
            value = _instance(kind, value, base, setting.name)
        values[setting.name] = value
    return values


def build(kind: type[Kind], values: Mapping[str, Any]) -> Kind:
    """Return the dataclass whose fields are among the values of `complete`."""
    return kind(**{setting.name: values[setting.name] for setting in settings_of(kind)})


def _take(settings: Sequence[Setting], values: Located, found: dict[str, Any], file: Path) -> None:
    """Check the values of a file, and put them into `found`."""
    known = {setting.name: setting for setting in settings}
    for key, value in values.items():
        where = f"{file}:{values.lines[key]}"
        if key not in known:
            raise UsageError(f"{where}: {_unknown(key, known)}")
        inside = _inside(known[key])
        if inside and isinstance(value, Located):
            part: dict[str, Any] = {}
            _take(inside, value, part, file)
            found[key] = part
        else:
            found[key] = _checked(known[key], value, where)


def _assign(settings: Sequence[Setting], path: list[str], text: str, found: dict[str, Any], where: str) -> None:
    """Check the value of one ``--set``, and put it into `found`."""
    known = {setting.name: setting for setting in settings}
    if path[0] not in known:
        raise UsageError(f"{where}: {_unknown(path[0], known)}")
    setting, inside = known[path[0]], _inside(known[path[0]])
    if len(path) > 1:
        if not inside:
            raise UsageError(f"{where}: {path[0]} is {setting.words}, it has nothing inside")
        _assign(inside, path[1:], text, found.setdefault(path[0], {}), where)
        return
    try:
        value = parse_value(text)
    except ValueError as error:
        raise UsageError(f"{where}: {error}") from error
    if setting.plain_type is str and value is not None and not isinstance(value, str):
        value = text
    found[path[0]] = _checked(setting, value, where)


def _checked(setting: Setting, value: Any, where: str) -> Any:  # noqa: ANN401 - any plain value
    inside = _inside(setting)
    if inside and not (value is None and setting.optional):
        if not isinstance(value, Mapping):
            names = ", ".join(one.name for one in inside)
            raise UsageError(f"{where}: {setting.name}: {printable(value, 60)} is not a mapping of {names}")
        within = {one.name: one for one in inside}
        if strange := [name for name in value if name not in within]:
            raise UsageError(f"{where}: {_unknown(strange[0], within)}")
        return {name: _checked(within[name], part, where) for name, part in value.items()}
    try:
        return setting.checked(value)
    except ValueError as error:
        raise UsageError(f"{where}: {setting.name}: {printable(error, 300)}") from error


def _inside(setting: Setting) -> tuple[Setting, ...]:
    kind = setting.plain_type
    return tuple(settings_of(kind)) if dataclasses.is_dataclass(kind) else setting.inside


def _instance(kind: Any, value: Mapping[str, Any], base: Any, name: str) -> Any:  # noqa: ANN401 - a dataclass
    if base is not None:
        return dataclasses.replace(base, **value)
    missing = [one.name for one in settings_of(kind) if one.default is UNSET and one.name not in value]
    if missing:
        raise UsageError(f"{name} lacks {', '.join(missing)}")
    return kind(**value)


def _put(found: dict[str, Any], path: list[str], value: Any) -> None:  # noqa: ANN401 - any plain value
    for name in path[:-1]:
        found = found.setdefault(name, {})
    if path[-1] in found and found[path[-1]] != value:
        other = f"--set {'.'.join(path)}={found[path[-1]]}"
        raise UsageError(f"{_flag(path[-1])} {value} and {other} contradict each other")
    found[path[-1]] = value


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    out = dict(below)
    for name, value in above.items():
        both = isinstance(value, dict) and isinstance(out.get(name), dict)
        out[name] = _merged(out[name], value) if both else value
    return out


def _unknown(name: str, known: Mapping[str, Setting]) -> str:
    near = closest(name, list(known))
    return f"no setting {printable(name, 40)}{near or '; there are ' + ', '.join(known)}"


def _flag(name: str) -> str:
    return f"--{name.replace('_', '-')}"
