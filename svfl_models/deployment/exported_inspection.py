"""Description of an exported network; nothing in its file is unpickled or executed.

A ``.pt2`` file is read as for use. Of an ``.onnx`` file, which this package does not run, form and texts are read.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from svfl_data.errors import FormatError
from svfl_data.schema.action_fields import planar_action
from svfl_data.system.printable import printable
from svfl_data.system.side_files import check_format, parse_json
from svfl_models.deployment.export import FACTS as CENTERING
from svfl_models.deployment.export import FORMAT, FORMAT_VERSION
from svfl_models.deployment.inspection import Inspection
from svfl_models.deployment.onnx_file import read_onnx
from svfl_models.programs import exported_policy, own_policy, program
from svfl_models.programs.program_file import text_of
from svfl_models.training.provenance.record import TEXT, of_text
from svfl_models.training.provenance.session import file

ONNX = ".onnx"
Shapes = Sequence[tuple[int, ...]]
PLANAR_INPUTS = ("image", "wrench", "proprio")


def inspect_exported(path: Path) -> Inspection:
    """Return what is known of a network from its exported file.

    Args:
        path: A ``.pt2`` or ``.onnx`` file of ``svfl-train export``.

    Raises:
        FormatError: If the file is missing, damaged, or not an exported network.
        TrainingError: If the package that reads ONNX is missing.
    """
    if path.suffix == ONNX:
        return _inspect_onnx(path)
    kinds = {CENTERING: _centering, own_policy.FACTS: _own_policy, exported_policy.FACTS: _policy}
    named = next((name for name in kinds if text_of(path, name) is not None), None)
    if named is None:
        raise FormatError(f"{path}: not a network of svfl-train export (it has none of {', '.join(kinds)})")
    return _inspection(path, kinds[named](path), text_of(path, TEXT))


Facts = tuple[str, str, dict[str, str], str, dict[str, Any]]
"""The attributes `what`, `format`, `inputs`, `output` and `network` of an `Inspection`."""


def _inspection(path: Path, facts: Facts, provenance: str | None) -> Inspection:
    """Return what is known of an exported network.

    Args:
        path: File of the network.
        facts: What the file says.
        provenance: Text with its provenance; None if it holds none.
    """
    what, version, inputs, output, network = facts
    sessions = [] if provenance is None else of_text(provenance, f"{path}, {TEXT}")
    return Inspection(
        str(path), what, "svfl-train export", version, path.stat().st_size, file(path).sha256, {}, inputs, output,
        network, sessions,
    )  # fmt: skip


def _inspect_onnx(path: Path) -> Inspection:
    opened = read_onnx(path)
    if CENTERING not in opened.texts:
        raise FormatError(f"{path}: not a network of svfl-train export (it has no {CENTERING})")
    inputs, outputs = ([(0, *shape) for shape in shapes.values()] for shapes in (opened.inputs, opened.outputs))
    facts = _of_centering(path, opened.texts[CENTERING], inputs, outputs, opened.numbers)
    return _inspection(path, facts, opened.texts.get(TEXT))


def _centering(path: Path) -> Facts:
    opened, text = program.read(path, CENTERING)
    return _of_centering(path, text, opened.inputs, opened.outputs, opened.numbers)


def _of_centering(path: Path, text: str, inputs: Shapes, outputs: Shapes, numbers: int) -> Facts:
    """Return the facts about a block-centering network.

    Args:
        path: File of the network.
        text: Text `CENTERING` of the file.
        inputs: Shapes of its inputs, with the number of samples.
        outputs: Shapes of its outputs, with the number of samples.
        numbers: Number of its weights and constants.

    Raises:
        FormatError: If the text does not fit the network.
    """
    found = parse_json(text, path)
    check_format(found, FORMAT, FORMAT_VERSION, path, "not an exported block-centering network")
    names = found.get("inputs")
    if not isinstance(names, dict) or len(names) != len(inputs):
        raise FormatError(f"{path}: takes {len(inputs)} inputs, but {CENTERING} in it does not name them")
    forms = {str(name): _form(shape) for name, shape in zip(names, inputs, strict=True)}
    known = {name: printable(found.get(name), 100) for name in ("group", "image_size", "view", "camera", "target")}
    version, output = f"{FORMAT} {found['format_version']}", ", ".join(map(_form, outputs)) + " numbers"
    return "exported block-centering network", version, forms, output, known | _sizes(numbers)


def _policy(path: Path) -> Facts:
    policy = exported_policy.load(path)
    inputs = {name: _form(shape) for name, shape in zip(PLANAR_INPUTS, policy.program.inputs, strict=True)}
    if policy.camera == "":
        inputs["image"] += ", ignored"
    elif policy.camera is not None:
        inputs["image"] += f", camera {policy.camera}"
    output = f"action of {', '.join(planar_action().components)}"
    return "exported policy", exported_policy.FACTS, inputs, output, _sizes(policy.program.numbers)


def _own_policy(path: Path) -> Facts:
    policy = own_policy.load(path)
    inputs = {
        one.path: f"{_form((1, *one.shape))}{f' at {one.rate_hz:g} Hz' if one.rate_hz else ''}"
        for one in policy.facts.inputs
    }
    output = f"action of {', '.join(policy.facts.components)} ({policy.facts.action})"
    return "exported policy of own inputs", own_policy.FACTS, inputs, output, _sizes(policy.program.numbers)


def _form(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape[1:]))


def _sizes(numbers: int) -> dict[str, Any]:
    return {"weights and constants": numbers}
