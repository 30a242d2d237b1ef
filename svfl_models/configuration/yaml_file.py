"""Reading of a YAML file whose values keep their line numbers, and writing of settings as YAML."""

import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import asdict, is_dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from svfl_data.errors import FormatError, UsageError
from svfl_data.system.printable import printable
from svfl_data.system.regular_file import read_regular
from svfl_models.configuration.setting import Setting

PROGRAM = "program"
"""Key that names the program which the settings are for."""
PLAIN = ("tag:yaml.org,2002:seq", "tag:yaml.org,2002:map")
LARGEST = 2**20
"""Largest size of a file of settings, [bytes]."""
BREAKS = frozenset("\x85\u2028\u2029")
"""Characters that YAML takes for line breaks, beside the usual ones."""
DEEPEST = 8
"""Most levels of mappings and lists inside each other."""
WIDTH = 100


class Located(dict[str, Any]):
    """Mapping of a YAML file.

    Attributes:
        lines: Line of each key, counted from 1.
    """

    lines: dict[str, int]


@cache
def _yaml() -> Any:  # noqa: ANN401 - a module with two classes, see below
    """Return PyYAML with a loader and a dumper of our own; it is imported here because ``--help`` does without it.

    The loader builds plain values only, takes ``1e-3`` for the number that it is, and refuses aliases, which can
    multiply what a file holds. The dumper quotes each text that the loader would take for a number.
    """
    import yaml

    class Loader(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:  # noqa: ANN401 - as PyYAML declares it
            if self.check_event(yaml.AliasEvent):
                raise yaml.constructor.ConstructorError(problem="an alias", problem_mark=self.peek_event().start_mark)
            return super().compose_node(parent, index)

    class Dumper(yaml.SafeDumper):
        pass

    for side in (Loader, Dumper):
        side.add_implicit_resolver(
            "tag:yaml.org,2002:float", re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"), list("-+0123456789")
        )
    return SimpleNamespace(yaml=yaml, Loader=Loader, Dumper=Dumper)


def read_yaml(path: Path) -> Located:
    """Return the mapping of a YAML file; mappings inside it are `Located` too.

    Args:
        path: File, or link to one.

    Raises:
        UsageError: If the file cannot be read, is larger than `LARGEST`, or holds something other than a mapping of
            plain values.
    """
    try:
        text = read_regular(path.resolve(), LARGEST).decode()
        loader = _yaml().Loader(text)
        node = loader.get_single_node()
        found = _value(loader, node, path, 0) if node else Located()
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror or error})") from error
    except FormatError as error:
        raise UsageError(str(error)) from error
    except (_yaml().yaml.YAMLError, UnicodeDecodeError, ValueError, RecursionError) as error:
        raise UsageError(f"{path}{_place(error)}: not YAML: {_short(error)}") from error
    if not isinstance(found, Located):
        raise UsageError(f"{path}: holds no mapping of settings to values")
    return found


def parse_value(text: str) -> Any:  # noqa: ANN401 - any plain value
    """Return the plain value that a text stands for in YAML, such as ``[1, 2]`` or ``1e-3``.

    Raises:
        ValueError: If the text is not YAML, or holds something other than plain values.
    """
    try:
        loader = _yaml().Loader(text)
        node = loader.get_single_node()
        return _value(loader, node, Path("value"), 0) if node else None
    except (_yaml().yaml.YAMLError, UsageError, RecursionError) as error:
        raise ValueError(f"{text!r} is not a value: {_short(error)}") from None


def text_of(program: str, values: Mapping[str, Any], settings: Sequence[Setting] = ()) -> str:
    """Return the settings of a program as the text of a YAML file that `read_yaml` reads.

    Args:
        program: Name of the program.
        values: Values by name of the setting.
        settings: Declarations of the settings, whose help texts become comments; none for a text without comments.
    """
    helps = {setting.name: setting.help for setting in settings}
    lines: list[str] = []
    for name, value in ({PROGRAM: program} | dict(values)).items():
        if words := helps.get(name):
            lines += textwrap.wrap(words, WIDTH, initial_indent="# ", subsequent_indent="# ")
        plain = asdict(value) if is_dataclass(value) and not isinstance(value, type) else value
        lines.append(f"{name}: {_flow(plain)}")
    return "\n".join(lines) + "\n"


def _flow(value: object) -> str:
    """Return a plain value as YAML on one line."""
    own = _yaml()
    written = json.dumps(value, ensure_ascii=False)
    readable = not BREAKS & {*written}  # PyYAML would write these as line breaks, which are read as spaces
    text = own.yaml.dump(
        value, Dumper=own.Dumper, sort_keys=False, width=2**20, default_flow_style=True, allow_unicode=readable
    )
    return str(text).removesuffix("\n...\n").strip()


def _value(loader: Any, node: Any, path: Path, depth: int) -> Any:  # noqa: ANN401 - any plain value, PyYAML's types
    """Return the plain value of a node."""
    line, nodes = node.start_mark.line + 1, _yaml().yaml.nodes
    if depth > DEEPEST:
        raise UsageError(f"{path}:{line}: more than {DEEPEST} levels of mappings and lists")
    if not isinstance(node, nodes.ScalarNode) and node.tag not in PLAIN:
        raise UsageError(f"{path}:{line}: not YAML of plain values: {printable(node.tag, 60)}")
    if isinstance(node, nodes.SequenceNode):
        return [_value(loader, one, path, depth + 1) for one in node.value]
    if not isinstance(node, nodes.MappingNode):
        return loader.construct_object(node)
    found = Located()
    found.lines = {}
    for key, value in node.value:
        name = loader.construct_object(key) if isinstance(key, nodes.ScalarNode) else None
        at = key.start_mark.line + 1
        if not isinstance(name, str):
            raise UsageError(f"{path}:{at}: {printable(name, 40)} is not the name of a setting")
        if name in found:
            raise UsageError(f"{path}:{at}: {printable(name, 40)} is there twice, also in line {found.lines[name]}")
        found[name] = _value(loader, value, path, depth + 1)
        found.lines[name] = at
    return found


def _place(error: Exception) -> str:
    mark = getattr(error, "problem_mark", None)
    return f":{mark.line + 1}" if mark else ""


def _short(error: Exception) -> str:
    return printable(" ".join(str(getattr(error, "problem", None) or error).split()), 200)
