"""Description of an exported network (``.pt2``), read as for use: nothing in it is unpickled."""

from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError
from svfl_data.schema.action_fields import planar_action
from svfl_data.system.printable import printable
from svfl_data.system.side_files import check_format, parse_json
from svfl_models.deployment.export import FACTS as CENTERING
from svfl_models.deployment.export import FORMAT, FORMAT_VERSION
from svfl_models.deployment.inspection import Inspection
from svfl_models.programs import exported_policy, own_policy, program
from svfl_models.programs.program import Program
from svfl_models.programs.program_file import text_of
from svfl_models.training.provenance.record import TEXT, of_text
from svfl_models.training.provenance.session import file

PLANAR_INPUTS = ("image", "wrench", "proprio")


def inspect_exported(path: Path) -> Inspection:
    """Return what is known of a network from its exported file.

    Args:
        path: A ``.pt2`` file of ``svfl-train export``.

    Raises:
        FormatError: If the file is missing, damaged, or not an exported network.
    """
    kinds = {CENTERING: _centering, own_policy.FACTS: _own_policy, exported_policy.FACTS: _policy}
    named = next((name for name in kinds if text_of(path, name) is not None), None)
    if named is None:
        raise FormatError(f"{path}: not a network of svfl-train export (it has none of {', '.join(kinds)})")
    what, version, inputs, output, network = kinds[named](path)
    kept = text_of(path, TEXT)
    sessions = [] if kept is None else of_text(kept, f"{path}, {TEXT}")
    return Inspection(
        str(path), what, "svfl-train export", version, path.stat().st_size, file(path).sha256, {}, inputs, output,
        network, sessions,
    )  # fmt: skip


Facts = tuple[str, str, dict[str, str], str, dict[str, Any]]
"""The attributes `what`, `format`, `inputs`, `output` and `network` of an `Inspection`."""


def _centering(path: Path) -> Facts:
    opened, text = program.read(path, CENTERING)
    found = parse_json(text, path)
    check_format(found, FORMAT, FORMAT_VERSION, path, "not an exported block-centering network")
    names = found.get("inputs")
    if not isinstance(names, dict) or len(names) != len(opened.inputs):
        raise FormatError(f"{path}: takes {len(opened.inputs)} inputs, but {CENTERING} in it does not name them")
    inputs = {str(name): _form(shape) for name, shape in zip(names, opened.inputs, strict=True)}
    known = {name: printable(found.get(name), 100) for name in ("group", "image_size", "view", "camera", "target")}
    version = f"{FORMAT} {found['format_version']}"
    return "exported block-centering network", version, inputs, _outputs(opened), known | _sizes(opened)


def _policy(path: Path) -> Facts:
    policy = exported_policy.load(path)
    inputs = {name: _form(shape) for name, shape in zip(PLANAR_INPUTS, policy.program.inputs, strict=True)}
    if policy.camera == "":
        inputs["image"] += ", ignored"
    elif policy.camera is not None:
        inputs["image"] += f", camera {policy.camera}"
    output = f"action of {', '.join(planar_action().components)}"
    return "exported policy", exported_policy.FACTS, inputs, output, _sizes(policy.program)


def _own_policy(path: Path) -> Facts:
    policy = own_policy.load(path)
    inputs = {
        one.path: f"{_form((1, *one.shape))}{f' at {one.rate_hz:g} Hz' if one.rate_hz else ''}"
        for one in policy.facts.inputs
    }
    output = f"action of {', '.join(policy.facts.components)} ({policy.facts.action})"
    return "exported policy of own inputs", own_policy.FACTS, inputs, output, _sizes(policy.program)


def _form(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape[1:]))


def _outputs(opened: Program) -> str:
    return ", ".join(_form(shape) for shape in opened.outputs) + " numbers"


def _sizes(opened: Program) -> dict[str, Any]:
    return {"weights and constants": opened.numbers}
