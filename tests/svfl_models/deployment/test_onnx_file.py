"""What an ONNX file says is read without running it, without other files, and refused in one line if it is damaged."""

import json
import random
import sys
from contextlib import suppress

import numpy as np
import onnx
import pytest

from svfl_data.errors import FormatError, TrainingError
from svfl_models import cli
from svfl_models.deployment import export
from svfl_models.deployment.exported_inspection import inspect_exported
from svfl_models.deployment.onnx_file import read_onnx
from tests.helpers.trained import untrained

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def file(samples, tmp_path_factory):
    module, _ = untrained(samples, encoder="f", window=32)
    path = tmp_path_factory.mktemp("onnx") / "network.onnx"
    export.save_onnx(module.classifier, path)
    return path


def changed(file, target, change):
    """The model after a change, in another file."""
    model = onnx.load(file)
    change(model)
    target.write_bytes(model.SerializeToString())
    return target


def external(location):
    def change(model):
        tensor = model.graph.initializer[0]
        tensor.ClearField("raw_data")
        tensor.data_location = onnx.TensorProto.EXTERNAL
        tensor.external_data.append(onnx.StringStringEntryProto(key="location", value=location))

    return change


def nested(model):
    """Weights of another file, in a graph inside a step."""
    inside = onnx.TensorProto(name="hidden", data_type=onnx.TensorProto.UINT8, dims=[16])
    inside.data_location = onnx.TensorProto.EXTERNAL
    graph = onnx.helper.make_graph([onnx.helper.make_node("Constant", [], ["x"], value=inside)], "g", [], [])
    model.graph.node.append(onnx.helper.make_node("If", ["c"], ["y"], then_branch=graph, else_branch=graph))


def fact(**values):
    def change(model):
        (kept,) = [one for one in model.metadata_props if one.key == export.FACTS]
        kept.value = json.dumps(json.loads(kept.value) | values)

    return change


def test_a_file_tells_its_form(file):
    found = read_onnx(file)
    assert (found.inputs, found.outputs) == ({"wrench": (32, 6)}, {"scores": (4,)})
    assert found.numbers > 100
    told = inspect_exported(file)
    assert (told.inputs, told.output) == ({"wrench": "32 x 6"}, "4 numbers")
    assert (told.network["group"], told.provenance) == ("D4", [])


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        (external("../secret"), "another file, which is not read"),
        (external("/etc/passwd"), "another file, which is not read"),
        (external("beside"), "another file, which is not read"),
        (nested, "hidden lies in another file"),
        (lambda model: model.graph.initializer[0].dims.append(10**12), "does not hold the numbers"),
        (lambda model: model.graph.initializer.append(onnx.numpy_helper.from_array(np.array([np.nan]))), "finite"),
        (lambda model: model.graph.input[0].type.tensor_type.shape.dim[1].Clear(), "wrench has no size"),
        (lambda model: model.graph.input.pop(), "does not name them"),
        (lambda model: model.ClearField("metadata_props"), f"no {export.FACTS}"),
        (fact(inputs=None), "does not name them"),
        (fact(format="other"), "not an exported block-centering network"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_file_is_one_line(change, facts, file, tmp_path, capsys):
    (tmp_path / "beside").write_bytes(b"SECRET" * 1000)
    target = changed(file, tmp_path / "x.onnx", change)
    with pytest.raises(FormatError, match=facts):
        inspect_exported(target)
    assert cli.main(["info", str(target)]) == 1
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert "SECRET" not in complaint


def test_whatever_is_changed_in_a_file_it_is_told_or_refused(file, tmp_path):
    whole, rng = file.read_bytes(), random.Random(0)
    for number in range(150):
        content = bytearray(whole[: rng.randrange(len(whole))] if number % 3 == 0 else whole)
        for _ in range(rng.randint(1, 20)):
            content[rng.randrange(len(content))] = rng.randrange(256) if content else 0
        (tmp_path / "x.onnx").write_bytes(content)
        with suppress(FormatError):
            inspect_exported(tmp_path / "x.onnx")


def test_a_missing_package_is_named(file, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(TrainingError, match=r"pip install 'svfl\[onnx\]'"):
        read_onnx(file)
