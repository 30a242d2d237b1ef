"""An exported program that somebody else has made runs nothing but operators on tensors, whatever is in its file."""

import copy
import io
import json
import math
import os
import pickle
import random
import zipfile

import pytest
import torch

from svfl_data.errors import FormatError, TrainingError
from svfl_models.programs import exported_policy, program
from svfl_models.programs.exported_policy import FACTS
from svfl_models.programs.operators import operator

GRAPH = "models/model.json"
WEIGHTS = "data/weights/model_weights_config.json"
CONSTANTS = "data/constants/model_constants_config.json"
INPUTS = "data/sample_inputs/model.pt"


class Network(torch.nn.Module):
    """Has a weight, a buffer, a constant, an operator that gives several values and one with keywords."""

    def __init__(self):
        super().__init__()
        self.layer = torch.nn.Linear(5, 5)
        self.register_buffer("shift", torch.full((5,), 0.5))

    def forward(self, image, wrench, proprio):
        one, other = torch.nn.functional.softplus(self.layer(proprio) + self.shift).split([2, 3], dim=1)
        return torch.cat([one, other], dim=1) + image.mean() * torch.tensor([0.0, 1.0, 2.0, 3.0, 4.0])


class Payload:
    """Makes a file when it is unpickled."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


@pytest.fixture(scope="module")
def content():
    torch.manual_seed(0)
    return exported_policy.exported(Network(), (8, 8))


@pytest.fixture
def marker(tmp_path):
    return tmp_path / "the payload ran"


def members(content):
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name.partition("/")[2]: archive.read(name) for name in archive.namelist()}


def write(path, found, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, data in found.items():
            archive.writestr(f"policy/{name}", data)
    return path


def refused(path, marker):
    """The one line that says why a file is refused."""
    with pytest.raises(FormatError) as caught:
        exported_policy.load(path)
    assert not marker.exists()
    line = str(caught.value)
    assert str(path) in line
    assert "\n" not in line
    assert line.isprintable()
    return line


def payloads(marker):
    saved = io.BytesIO()
    torch.save(Payload(marker), saved)
    return {"saved": saved.getvalue(), "pickled": pickle.dumps(Payload(marker))}


def test_the_payload_would_run(marker):
    """Otherwise nothing below would be shown."""
    torch.load(io.BytesIO(payloads(marker)["saved"]), weights_only=False)
    assert marker.exists()


def test_pytorch_itself_would_run_it(content, marker, tmp_path):
    found = members(content) | {INPUTS: payloads(marker)["saved"]}
    with pytest.raises(Exception, match=r"."):
        torch.export.load(write(tmp_path / "policy.pt2", found))
    assert marker.exists()


@pytest.mark.parametrize("kind", ["saved", "pickled"])
def test_a_payload_in_any_member_never_runs(content, tmp_path, marker, kind):
    good = members(content)
    expected = exported_policy.opened(content, "x").program(
        *(torch.ones(shape) for shape in ((1, 4, 8, 8), (1, 64, 6), (1, 5)))
    )
    read = [GRAPH, WEIGHTS, CONSTANTS, f"extra/{FACTS}"]
    for name in good:
        path = write(tmp_path / "policy.pt2", good | {name: payloads(marker)[kind]})
        if name in read:
            refused(path, marker)
            continue
        try:  # numbers that are others now, or a member that nobody reads
            policy = exported_policy.load(path)
        except FormatError:
            continue
        finally:
            assert not marker.exists(), name
        if not name.startswith("data/weights/") and not name.startswith("data/constants/"):
            found = policy.program(*(torch.ones(shape) for shape in policy.program.inputs))
            assert torch.equal(found[0], expected[0]), name


@pytest.mark.parametrize(
    "name",
    [
        "data/aotinductor/model/x.so",
        "data/aotinductor/model/x.cpp",
        "data/executorch/x",
        "data/xl_model_weights/x",
        "x.py",
    ],
)
def test_members_of_other_kinds_are_refused(content, tmp_path, marker, name):
    path = write(tmp_path / "policy.pt2", members(content) | {name: b"\x7fELF"})
    assert f"it holds {name!r}" in refused(path, marker)


@pytest.mark.parametrize("config", [WEIGHTS, CONSTANTS])
@pytest.mark.parametrize("name", ["weight_0", "tensor_0", "custom_obj_0", "opaque_obj_0", "../sample_inputs/model.pt"])
def test_pickled_numbers_and_objects_are_refused(content, tmp_path, marker, config, name):
    found = members(content)
    entry = {"path_name": name, "is_param": False, "use_pickle": True, "tensor_meta": None}
    found[config] = json.dumps({"config": {"layer.weight": entry, "shift": entry}}).encode()
    for payload in payloads(marker).values():
        found[f"{config.rpartition('/')[0]}/{name.removeprefix('../')}"] = payload
        assert "is pickled" in refused(write(tmp_path / "policy.pt2", found), marker)


@pytest.mark.parametrize("name", ["data/weights/model.pt", "data/constants/model.pt"])
def test_an_older_format_of_weights_is_not_read(content, tmp_path, marker, name):
    path = write(tmp_path / "policy.pt2", members(content) | {name: payloads(marker)["saved"]})
    exported_policy.load(path)
    assert not marker.exists()
    without = {one: data for one, data in members(content).items() if not one.endswith("config.json")}
    refused(write(tmp_path / "policy.pt2", without | {name: payloads(marker)["saved"]}), marker)


@pytest.mark.parametrize(
    "target",
    [
        "torch.hub.load", "torch.load", "torch.serialization.pickle.loads", "torch.os.system", "torch.os.mkdir",
        "_operator.attrgetter", "math.exp", "builtins.eval", "os.system", "#module", "call_delegate",
        "torch.ops.aten.from_file.default", "torch.ops.aten._print.default", "torch.ops.aten.mul_.Tensor",
        "torch.ops.load_library", "torch.ops.aten.__class__.__init__", "torch.ops.higher_order.cond",
        "torch.ops.aten.relu.default.__globals__", "torch.ops.aten.relu", "torch.ops.aten.empty.memory_format", "",
    ],
)  # fmt: skip
def test_no_other_function_is_called(content, tmp_path, marker, target):
    assert operator(target) is None
    found = members(content)
    graph = json.loads(found[GRAPH])
    step = graph["graph_module"]["graph"]["nodes"][0]
    step["target"], step["inputs"] = target, [{"name": "path", "arg": {"as_string": str(marker)}, "kind": 1}]
    path = write(tmp_path / "policy.pt2", found | {GRAPH: json.dumps(graph).encode()})
    assert f"it uses {target}, which a program may not" in refused(path, marker)


def test_expressions_and_guards_are_not_evaluated(content, tmp_path, marker):
    found = members(content)
    code = f"__import__('os').mkdir({str(marker)!r})"
    expression = {"as_expr": {"expr_str": code, "hint": {"as_int": 1}}}
    graph = json.loads(found[GRAPH])
    graph["guards_code"] = [code]
    inside = graph["graph_module"]["graph"]
    inside["sym_int_values"] = {"s0": expression}
    inside["tensor_values"]["proprio"]["sizes"][0] = expression
    exported_policy.load(write(tmp_path / "policy.pt2", found | {GRAPH: json.dumps(graph).encode()}))
    assert not marker.exists()
    argument = {"name": "size", "arg": {"as_sym_int": {"as_expr": expression}}, "kind": 1}
    inside["nodes"][0]["inputs"].append(argument)
    refused(write(tmp_path / "policy.pt2", found | {GRAPH: json.dumps(graph).encode()}), marker)


def test_what_is_compressed_or_repeated_is_refused(content, tmp_path, marker):
    found = members(content)
    assert "compressed" in refused(write(tmp_path / "a.pt2", found, zipfile.ZIP_DEFLATED), marker)
    twice = write(tmp_path / "a.pt2", found | {GRAPH.replace("model.", "modeL."): b"{}"})
    twice.write_bytes(twice.read_bytes().replace(b"modeL.", b"model."))
    assert "two members of the same name" in refused(tmp_path / "a.pt2", marker)


@pytest.mark.parametrize("sizes", [[10**11], [10**6, 10**6], [-1], [2**62, 4], [6, 5]])
@pytest.mark.parametrize("strides", ["dense", 0])
def test_a_weight_is_no_larger_than_what_the_file_holds(content, tmp_path, marker, sizes, strides):
    found = members(content)
    config = json.loads(found[WEIGHTS])
    steps = [math.prod(sizes[place + 1 :]) if strides else 0 for place in range(len(sizes))]
    meta = config["config"]["layer.weight"]["tensor_meta"]
    meta["sizes"], meta["strides"] = ([{"as_int": number} for number in numbers] for numbers in (sizes, steps))
    path = write(tmp_path / "policy.pt2", found | {WEIGHTS: json.dumps(config).encode()})
    assert "layer.weight" in refused(path, marker)


@pytest.mark.parametrize("shape", [[10**12], [10**6, 10**6]])
def test_a_step_needs_no_more_memory_than_allowed(content, tmp_path, marker, shape):
    found = members(content)
    graph = json.loads(found[GRAPH])
    arguments = [("size", {"as_ints": shape}, 1), ("device", {"as_device": {"type": "cpu", "index": None}}, 2)]
    inputs = [{"name": name, "arg": value, "kind": kind} for name, value, kind in arguments]
    step = {"target": "torch.ops.aten.zeros.default", "inputs": inputs, "outputs": [{"as_tensor": {"name": "large"}}]}
    graph["graph_module"]["graph"]["nodes"].insert(0, step)
    path = write(tmp_path / "policy.pt2", found | {GRAPH: json.dumps(graph).encode()})
    assert "numbers at once; at most" in refused(path, marker)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_weights_that_are_not_finite_are_named(content, tmp_path, marker, value):
    found = members(content)
    name = json.loads(found[WEIGHTS])["config"]["layer.bias"]["path_name"]
    data = torch.full((5,), value).numpy().tobytes()
    path = write(tmp_path / "policy.pt2", found | {f"data/weights/{name}": data})
    assert "layer.bias has numbers that are not finite" in refused(path, marker)


def leaves(value, path=()):
    """Every place in JSON."""
    yield path
    for key, one in value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ():
        yield from leaves(one, (*path, key))


@pytest.mark.parametrize("name", [GRAPH, WEIGHTS, f"extra/{FACTS}"])
def test_json_that_is_changed_anywhere_is_one_line_or_a_policy(content, tmp_path, marker, name):
    found = members(content)
    good = json.loads(found[name])
    places = [place for place in leaves(good) if place and "metadata" not in place]
    drawn = random.Random(0)
    others = (None, -1, 2**70, 1e308, "\x1b[2J\n", [], {}, [[]], {"as_tensor": {"name": "x"}}, True, "x" * 10_000)
    for place in drawn.sample(places, min(len(places), 150)):
        bad = copy.deepcopy(good)
        *way, last = place
        inside = bad
        for key in way:
            inside = inside[key]
        inside[last] = drawn.choice(others)
        path = write(tmp_path / "policy.pt2", found | {name: json.dumps(bad).encode()})
        try:
            exported_policy.load(path)
        except FormatError:
            refused(path, marker)
        assert not marker.exists()


def test_json_as_deep_as_one_likes_is_one_line(content, tmp_path, marker):
    deep = b'{"graph_module": {"graph": {"nodes": [], "tensor_values": ' + b'{"a":' * 10**6
    refused(write(tmp_path / "policy.pt2", members(content) | {GRAPH: deep}), marker)


def test_a_pipe_is_not_waited_for(tmp_path, marker):
    os.mkfifo(tmp_path / "policy.pt2")
    refused(tmp_path / "policy.pt2", marker)


def test_what_cannot_be_loaded_is_not_exported(tmp_path):
    class Drawing(Network):
        def forward(self, image, wrench, proprio):
            return super().forward(image, wrench, proprio) + torch.rand(1, 5)

    with pytest.raises(TrainingError, match=r"aten\.rand\.default"):
        exported_policy.save(Drawing(), tmp_path / "policy.pt2", (8, 8))
    assert not list(tmp_path.iterdir())


def test_a_program_says_what_its_network_says(content):
    torch.manual_seed(0)
    network = Network().eval()
    ours, facts = program.from_bytes(content, FACTS)
    assert json.loads(facts) == {"depth_scale": 1e-4, "camera": None}
    for _ in range(3):
        inputs = [torch.randn(shape) for shape in ours.inputs]
        assert torch.equal(ours(*inputs)[0], network(*inputs))
