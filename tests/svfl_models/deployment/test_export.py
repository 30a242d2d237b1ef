"""What is exported says what the network says, and needs neither escnn nor this package for it."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from torch import nn

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError, UsageError
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import DIRECTIONS
from svfl_models import cli
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.centering.config import TARGETS
from svfl_models.centering.evaluate import evaluate
from svfl_models.deployment import export
from svfl_models.networks.heads import Actor, Critic
from svfl_models.networks.image_crops import centre_crop, scaled
from svfl_models.networks.inputs import ENCODERS
from svfl_models.networks.layer_factory import layer_factory
from svfl_models.networks.presets import PRESETS
from svfl_models.networks.visual_force import VisualForceEncoder
from svfl_models.programs import program
from svfl_models.symmetry.actions import act_on_hidden
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.layers import SymmetricConv, SymmetricLinear
from svfl_models.symmetry.testing import assert_equivariant, equivariance_error
from tests.helpers.builders import make_episode
from tests.helpers.command_page import json_keys
from tests.helpers.trained import untrained, write

pytestmark = pytest.mark.slow

SCRIPT = Path(__file__).parents[3] / "docs" / "run_exported.py"
ALONE = """
import runpy, sys
class Refuse:
    def find_spec(self, name, path=None, target=None):
        programs = "svfl_models.programs"
        ours = ("svfl_models", programs, *(f"{programs}.{name}" for name in ("operators", "program", "program_file")))
        if name.split(".")[0] in ("escnn", "svfl_models", "collectors", "lightning") and name not in ours:
            raise ImportError(f"{name} is not here")
sys.meta_path.insert(0, Refuse())
script, data, episode, *files = sys.argv[1:]
for file in files:
    sys.argv = [script, file, "--data", data, "--episode", episode]
    runpy.run_path(script, run_name="__main__")
"""


def difference(found, expected):
    assert expected.abs().max() > 0  # otherwise nothing would be compared
    return float((found - expected).detach().abs().max() / expected.detach().abs().max())


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("encoder", ENCODERS)
def test_the_plain_copy_says_the_same(samples, batch, group, encoder):
    batch = {name: values[:2] for name, values in batch.items()}
    for target in TARGETS:
        network = CenteringClassifier(encoder, group, "default", target).eval()
        network.fit(samples)
        plain = export.plain(network)
        assert not any(isinstance(module, SymmetricConv) for module in plain.modules())
        assert difference(plain(batch), network(batch)) < 1e-5


def test_so_it_does_for_a_policy(batch, grippers):
    layers, widths = layer_factory(GROUPS["D4"]), PRESETS["tiny"]["svfl"]
    trunk = VisualForceEncoder(layers, widths, "vfp").eval()
    actor, critic = Actor(layers, widths.latent).eval(), Critic(layers, widths.latent).eval()
    features = trunk(batch | grippers)
    assert difference(export.plain(trunk)(batch | grippers), features) < 1e-5
    expected, found = actor(features), export.plain(actor)(features)
    for name in ("mean", "log_sigma"):
        assert difference(getattr(found, name), getattr(expected, name)) < 1e-5, name
    action = grippers["action"]
    assert difference(export.plain(critic)(features, action), critic(features, action)) < 1e-5


def test_the_plain_copy_is_still_symmetric(batch):
    plain = export.plain(CenteringClassifier("vf", "D4", "tiny"))
    assert_equivariant(plain, batch)
    errors = equivariance_error(plain.trunk, batch, act_on_output=act_on_hidden(), elements=GROUPS["D4"].elements)
    assert max(errors) < 1e-5


def test_the_network_itself_is_left_alone():
    network = CenteringClassifier("f", preset="tiny").double().train()
    state, random = {name: values.clone() for name, values in network.state_dict().items()}, torch.get_rng_state()
    plain = export.plain(network)
    assert torch.equal(torch.get_rng_state(), random)
    assert network.training
    assert isinstance(network.head, SymmetricLinear)
    assert all(torch.equal(values, state[name]) for name, values in network.state_dict().items())
    assert all(values.requires_grad for values in network.parameters())
    assert not any(values.requires_grad for values in plain.parameters())
    assert not plain.training
    assert {values.dtype for values in plain.parameters()} == {torch.float64}


def test_a_layer_with_two_names_and_a_layer_alone():
    layer = CenteringClassifier("f", preset="tiny").head
    both = nn.ModuleDict({"one": layer, "other": layer, "rest": nn.Sequential(layer)})
    assert not any(isinstance(module, SymmetricConv) for module in export.plain(both).modules())
    assert type(export.plain(layer)) is nn.Linear


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "centering"
    Dataset.create_or_resume(folder, "centering", seed=0, config={})
    for index in range(3):
        write_episode(make_episode(index, steps=3, size=76), folder / f"episode_{index:06d}.hdf5")
    return folder


@pytest.fixture(scope="module")
def exported(dataset, tmp_path_factory):
    """A network for images that must be scaled, and the folder with the files that the command made of it."""
    folder = tmp_path_factory.mktemp("run")
    module, _ = untrained(load_centering(dataset), image_size=32, view="top")
    checkpoint = write(module, folder / "checkpoint.ckpt")
    (folder / "network.pt2").write_text("an older one")
    for suffix in export.SAVERS:
        assert cli.main(["export", str(checkpoint), "--out", str(folder / f"network{suffix}")]) == 0
    return module, folder


@pytest.fixture
def small(batch):
    """Inputs of that network."""
    return batch | {"image": batch["image"][..., ::2, ::2].contiguous()}


@pytest.mark.parametrize("count", [1, 3, 8])
def test_files_say_the_same_for_any_number_of_samples(exported, small, count):
    module, folder = exported
    batch = {name: values[:count] for name, values in small.items()}
    assert difference(torch.export.load(folder / "network.pt2").module()(batch), module(batch)) < 1e-5
    ours, _ = program.read(folder / "network.pt2", export.FACTS)
    assert difference(ours(*batch.values())[0], module(batch)) < 1e-5
    session = onnxruntime.InferenceSession(folder / "network.onnx", providers=["CPUExecutionProvider"])
    (scores,) = session.run(["scores"], {name: values.numpy() for name, values in batch.items()})
    assert difference(torch.from_numpy(scores), module(batch)) < 1e-5


def test_files_describe_themselves(exported):
    _, folder = exported
    texts = {export.FACTS: ""}
    torch.export.load(folder / "network.pt2", extra_files=texts)
    facts = json.loads(texts[export.FACTS])
    session = onnxruntime.InferenceSession(folder / "network.onnx", providers=["CPUExecutionProvider"])
    assert json.loads(session.get_modelmeta().custom_metadata_map[export.FACTS]) == facts
    assert {name: one["shape"] for name, one in facts["inputs"].items()} == {
        "image": ["samples", 4, 32, 32],
        "wrench": ["samples", 64, 6],
    }
    assert [node.name for node in session.get_inputs()] == list(facts["inputs"])
    assert facts["directions"] == list(DIRECTIONS)
    assert (facts["group"], facts["target"], facts["view"], facts["image_size"]) == ("D4", "direction", "top", 32)


def test_files_say_how_images_are_cropped(samples):
    """As in the training of the network, whatever the crop of the paper is."""
    module, config = untrained(samples, crop=0.9)
    assert export.facts(module.classifier)["crop"]["share"] == 0.9
    own, usual = (evaluate(module, samples, replace(config, crop=crop)) for crop in (0.9, 64 / 76))
    side = round(0.9 * samples.image.shape[-1])
    with torch.no_grad():
        image = scaled(centre_crop(torch.from_numpy(samples.image), side), 64)
        scores = module({"image": image, "wrench": torch.from_numpy(samples.wrench)})
    assert own.predicted.tolist() == scores.argmax(dim=1).tolist() != usual.predicted.tolist()


def test_a_file_that_would_say_something_else_is_not_written(samples, tmp_path, monkeypatch):
    module, _ = untrained(samples, encoder="f")
    honest, path = export.plain, tmp_path / "network.pt2"
    path.write_text("what was there before")

    def liar(network):
        plain = honest(network)
        plain.head.weight[0] += 1e-3
        return plain

    monkeypatch.setattr(export, "plain", liar)
    with pytest.raises(TrainingError, match=r"network\.pt2: .*outputs differ"):
        export.save_program(module.classifier, path)
    monkeypatch.undo()
    module.classifier.head.weights.data[0] = torch.nan
    with pytest.raises(TrainingError, match=r"head\.weight .*not finite"):
        export.save_program(module.classifier, path)
    assert path.read_text() == "what was there before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_missing_package_is_named(samples, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(TrainingError, match=r"pip install 'svfl\[onnx\]'"):
        export.save_onnx(untrained(samples, encoder="f")[0].classifier, tmp_path / "network.onnx")


@pytest.mark.parametrize("name", ["network.pt", "network", "network.ONNX"])
def test_other_suffixes_are_refused_before_anything_else(name, tmp_path, capsys):
    with pytest.raises(UsageError, match=r"\.pt2, \.onnx"):
        export.saver(tmp_path / name)
    assert cli.main(["export", "nowhere.ckpt", "--out", str(tmp_path / name)]) == 2
    assert ".pt2, .onnx" in capsys.readouterr().err


def test_the_command_says_how_exact_the_file_is(samples, tmp_path, capsys):
    checkpoint = write(untrained(samples, encoder="f")[0], tmp_path / "checkpoint.ckpt")
    assert cli.main(["export", str(checkpoint), "--out", str(tmp_path / "network.pt2")]) == 0
    assert re.search(rf"{tmp_path / 'network.pt2'}: .* [-.e\d]+ of", capsys.readouterr().out)
    assert cli.main(["export", str(checkpoint), "--out", str(tmp_path / "network.pt2"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out).keys() == json_keys("svfl-train export")


@pytest.mark.parametrize("place", ["../secret", "/etc/passwd", "link", "absolute"])
def test_an_onnx_file_reads_nothing_outside_its_folder(place, dataset, tmp_path):
    """Weights can be kept in other files; of those that lie elsewhere, nothing is read."""
    folder, secret = tmp_path / "folder", tmp_path / "secret"
    folder.mkdir()
    secret.write_bytes(b"SECRET" * 100)
    (folder / "link").symlink_to(secret)
    outside = onnx.TensorProto(name="w", data_type=onnx.TensorProto.UINT8, dims=[16])
    outside.data_location = onnx.TensorProto.EXTERNAL
    location = str(secret) if place == "absolute" else place
    outside.external_data.append(onnx.StringStringEntryProto(key="location", value=location))
    given = onnx.helper.make_tensor_value_info("scores", onnx.TensorProto.UINT8, [16])
    graph = onnx.helper.make_graph([onnx.helper.make_node("Identity", ["w"], ["scores"])], "g", [], [given], [outside])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 18)], ir_version=9)
    (folder / "model.onnx").write_bytes(model.SerializeToString())
    with pytest.raises(onnx.checker.ValidationError):
        onnx.load(folder / "model.onnx")
    arguments = [sys.executable, str(SCRIPT), str(folder / "model.onnx"), "--data", str(dataset)]
    done = subprocess.run(arguments, capture_output=True, text=True, cwd=SCRIPT.parents[1])
    assert done.returncode == 2
    assert "External data path validation failed" in done.stderr.splitlines()[-1]
    assert "SECRET" not in done.stdout + done.stderr
    assert "root:" not in done.stdout + done.stderr


def test_the_example_runs_without_the_networks(dataset, exported, tmp_path):
    """Where neither escnn nor what builds networks can be imported, the files say what the networks say."""
    samples = load_centering(dataset, view="top")
    module, folder = exported
    asked, config = untrained(samples, image_size=32, target="offset", view="top")
    export.save_program(asked.classifier, tmp_path / "offset.pt2", "top")
    files = [folder / "network.pt2", folder / "network.onnx", tmp_path / "offset.pt2"]
    arguments = [sys.executable, "-c", ALONE, str(SCRIPT), str(dataset), "2", *map(str, files)]
    done = subprocess.run(arguments, capture_output=True, text=True, cwd=SCRIPT.parents[1])
    assert done.returncode == 0, done.stderr

    one = samples.take(np.array([2]))
    class_ = DIRECTIONS[evaluate(module, one, replace(config, target="direction")).predicted[0]]
    right, up = 1000 * evaluate(asked, one, config).guess[0]
    scores, same, offset = (line for line in done.stdout.splitlines() if line.startswith("network:"))
    assert scores.startswith(f"network: {class_}, scores ")
    assert same.startswith(f"network: {class_}, scores ")
    assert offset == f"network: {right:.1f} mm right, {up:.1f} mm up"
    assert f"label:   {DIRECTIONS[one.direction[0]]}, " in done.stdout
