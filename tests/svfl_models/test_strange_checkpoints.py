"""Checkpoints that somebody else has made: never run, never larger than their file, never of numbers that are none."""

import io
import json
import os
import pickle
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile

import pytest
import torch

from svfl_data.errors import FormatError, TrainingError
from svfl_models import cli
from svfl_models.centering.checkpoint import load_classifier
from svfl_models.centering.pretrained import describe
from svfl_models.cloning import acting
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.module import CloningModule
from svfl_models.deployment import predictions
from svfl_models.latent.checkpoint import load_latent
from svfl_models.training.checkpoint_plugin import WholeCheckpoints
from tests.helpers.pretrained import write_latent
from tests.helpers.synthetic import centering_samples
from tests.helpers.trained import contents, untrained

pytestmark = pytest.mark.slow

DEPLOYMENT = {
    "task": "block_picking", "camera": "front", "image_axes": [[1.0, 0.0], [0.0, 1.0]],
    "projection": [[60.0, 0.0, 38.0, 0.0], [0.0, 60.0, 38.0, 0.0], [0.0, 0.0, 1.0, 1.0]], "centre": [0.5, 0.0],
    "table": 0.0, "image_side": 76, "depth_scale": 1e-4, "step_ms": 50.0, "switch": True,
}  # fmt: skip
LOADERS = {"centering": load_classifier, "policy": load_policy, "latent": load_latent}


class Payload:
    """Makes a folder when it is unpickled."""

    def __init__(self, marker):
        self.marker = marker

    def __reduce__(self):
        return os.mkdir, (str(self.marker),)


def policy_contents(group="none"):
    torch.manual_seed(0)
    config = CloningConfig("nowhere", encoder="fp", group=group, preset="tiny")
    module = CloningModule(config.network(), dict(DEPLOYMENT), training=config.plain())
    return contents(module)


@pytest.fixture(scope="module")
def kinds(tmp_path_factory):
    """What a checkpoint of each kind holds."""
    latent = write_latent(tmp_path_factory.mktemp("latent") / "checkpoint.ckpt")
    samples = centering_samples(8, seed=0)
    return {
        "centering": contents(untrained(samples, encoder="f", group="none")[0]),
        "policy": policy_contents(),
        "latent": torch.load(latent, weights_only=True),
    }


@pytest.fixture(params=list(LOADERS))
def kind(request):
    return request.param


@pytest.fixture
def good(kinds, kind):
    found = kinds[kind]
    return {key: dict(value) if isinstance(value, dict) else value for key, value in found.items()}


@pytest.fixture
def marker(tmp_path):
    return tmp_path / "the payload ran"


def saved(content, path):
    torch.save(content, path)
    return path


def refusal(kind, path, marker=None):
    with pytest.raises(FormatError) as caught:
        LOADERS[kind](path)
    assert marker is None or not marker.exists()
    line = str(caught.value)
    assert str(path) in line
    assert "\n" not in line
    assert line.isprintable()
    return line


def test_good_ones_open(kind, good, tmp_path):
    LOADERS[kind](saved(good, tmp_path / "checkpoint.ckpt"))
    (tmp_path / "latest.ckpt").symlink_to("checkpoint.ckpt")
    LOADERS[kind](tmp_path / "latest.ckpt")


@pytest.mark.parametrize("place", ["alone", "mark", "state_dict", "hyper_parameters", "other"])
def test_a_payload_never_runs(kind, good, tmp_path, marker, place):
    payload = Payload(marker)
    content = {
        "alone": payload, "mark": good | {"svfl": payload}, "other": good | {"optimizer_states": [payload]},
        "state_dict": good | {"state_dict": {**good["state_dict"], "x": payload}},
        "hyper_parameters": good | {"hyper_parameters": {"network": payload}},
    }[place]  # fmt: skip
    assert "not readable" in refusal(kind, saved(content, tmp_path / "checkpoint.ckpt"), marker)


def rewritten(path, change):
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in change(members).items():
            archive.writestr(name, data)
    return path


def test_a_payload_in_any_member_never_runs(kind, good, tmp_path, marker):
    path = saved(good, tmp_path / "checkpoint.ckpt")
    with zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if "/data/" not in name or name.endswith("/data/0")]
    for name in [*names, "checkpoint/constants.pkl", "checkpoint/code/x.py"]:
        saved(good, path)
        rewritten(path, lambda members, name=name: members | {name: pickle.dumps(Payload(marker))})
        try:
            LOADERS[kind](path)
        except FormatError:
            refusal(kind, path, marker)
        assert not marker.exists(), name


def test_older_formats_never_run(kind, tmp_path, marker):
    path = tmp_path / "checkpoint.ckpt"
    path.write_bytes(pickle.dumps(Payload(marker)))
    refusal(kind, path, marker)
    torch.save(Payload(marker), path, _use_new_zipfile_serialization=False)
    refusal(kind, path, marker)
    with tarfile.open(path, "w") as archive:
        archive.addfile(tarfile.TarInfo("pickle"), io.BytesIO())
    refusal(kind, path, marker)
    empty = io.BytesIO()
    with zipfile.ZipFile(empty, "w") as archive:
        archive.writestr("x/data.pkl", b"")
    path.write_bytes(pickle.dumps(Payload(marker)) + empty.getvalue())
    assert "archive" in refusal(kind, path, marker)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_none_is_named(kind, good, tmp_path, value):
    name, weight = next((name, weight) for name, weight in good["state_dict"].items() if weight.is_floating_point())
    bad = weight.clone()
    bad.view(-1)[-1] = value
    path = saved(good | {"state_dict": {**good["state_dict"], name: bad}}, tmp_path / "checkpoint.ckpt")
    assert re.search(rf"\b{re.escape(name)} .*not finite", refusal(kind, path))


@pytest.mark.parametrize("dtype", [torch.complex64, torch.float64, torch.int32, torch.bool], ids=str)
def test_numbers_of_another_type_are_named(kind, good, tmp_path, dtype):
    name, weight = next((name, weight) for name, weight in good["state_dict"].items() if weight.is_floating_point())
    path = saved(good | {"state_dict": {**good["state_dict"], name: weight.to(dtype)}}, tmp_path / "checkpoint.ckpt")
    assert re.search(rf"\b{re.escape(name)} .*{dtype}.* torch\.float32", refusal(kind, path))


@pytest.mark.parametrize("lie", ["expanded", "meta", "sparse", "text", "None"])
def test_what_is_no_tensor_of_the_file_is_named(kind, good, tmp_path, lie):
    name = next(iter(good["state_dict"]))
    bad = {
        "expanded": torch.zeros(1).expand(10**11), "meta": torch.empty(10**13, device="meta"), "text": "weights",
        "sparse": torch.sparse_coo_tensor(torch.zeros(1, 1, dtype=torch.long), [1.0], (10**11,)), "None": None,
    }[lie]  # fmt: skip
    path = saved(good | {"state_dict": {**good["state_dict"], name: bad}}, tmp_path / "checkpoint.ckpt")
    line = refusal(kind, path)
    assert re.search(rf"\b{re.escape(name)} .*({10**11} numbers.* 1\b|no tensor)", line)


STRANGE = [
    None, 3, [], "x", {"network": None}, {"network": {}}, {"network": {"window": 10**9, "image_size": 10**9}},
    {"network": {"encoder": ["v"] * 1000}}, {"network": {"model": "vtt", "sizes": {"hidden": 10**6}}},
    {"network": {"model": "vtt", "sizes": {"hidden": 4000, "feature": 4000, "dim": 4000, "depth": 60}}},
    {"network": {"model": "vtt", "sizes": {"depth": 4000}}}, {"network": {"model": 7, "sizes": 7}},
    {"network": {"encoder": "vf", "group": "D4000"}}, {"network": {"encoder": "\x1b[2J\n\u202e"}},
]  # fmt: skip


@pytest.mark.parametrize("described", STRANGE, ids=lambda value: str(value)[:40].encode("unicode_escape").decode())
def test_descriptions_of_strange_networks_are_one_line(kind, good, tmp_path, described):
    usual = good["hyper_parameters"]
    whole = usual | described if isinstance(described, dict) else described
    refusal(kind, saved(good | {"hyper_parameters": whole}, tmp_path / "checkpoint.ckpt"))


@pytest.mark.parametrize("key", ["state_dict", "hyper_parameters", "svfl"])
@pytest.mark.parametrize("value", [None, 3, [], "x", {3: 4}])
def test_other_types_in_their_places_are_one_line(kind, good, tmp_path, key, value):
    refusal(kind, saved(good | {key: value}, tmp_path / "checkpoint.ckpt"))


@pytest.mark.parametrize("training", [3, [], {"data": 3}, {"seed": "0"}, {"learning_rate": None}])
def test_settings_of_a_training_have_their_types(kind, good, tmp_path, training):
    described = good["hyper_parameters"]
    if isinstance(training, dict):
        training = described["training"] | training
    path = saved(good | {"hyper_parameters": described | {"training": training}}, tmp_path / "checkpoint.ckpt")
    assert "Expected `" in refusal(kind, path)


@pytest.mark.parametrize(
    "change",
    [
        {"image_axes": [[1.0, 0.0]]}, {"projection": "x"}, {"centre": [float("nan"), 0.0]}, {"depth_scale": 0.0},
        {"image_side": 10**9}, {"image_side": 76.5}, {"table": None}, {"unknown": 1},
    ],
)  # fmt: skip
def test_a_deployment_that_is_none_is_one_line(kinds, tmp_path, change):
    good = kinds["policy"]
    described = good["hyper_parameters"] | {"deployment": DEPLOYMENT | change}
    refusal("policy", saved(good | {"hyper_parameters": described}, tmp_path / "checkpoint.ckpt"))


def test_every_command_says_it_in_one_line(tmp_path, marker, capsys):
    path = saved(Payload(marker), tmp_path / "checkpoint.ckpt")
    out = str(tmp_path / "out")
    for arguments in (
        ["export", path, "--out", tmp_path / "x.pt2"], ["export", path, "--out", tmp_path / "x.onnx"],
        ["evaluate", path], ["latent-eval", path], ["centering", "--data", tmp_path, "--latent", path, "--out", out],
        ["centering-latents", "--data", tmp_path, "--latents", path, "--out", out],
    ):  # fmt: skip
        assert cli.main([str(one) for one in arguments]) == 1
        said = capsys.readouterr().err
        assert said.count("\n") == 1, said
        assert str(path) in said
        assert not marker.exists()
    assert sorted(os.listdir(tmp_path)) == ["checkpoint.ckpt"]
    for load in (predictions.load, acting.load, lambda file: describe(file, "fine-tuned")):
        with pytest.raises(FormatError):
            load(path)
        assert not marker.exists()


def test_lightning_reads_the_named_checkpoint_only(tmp_path, marker):
    """It would go on by itself from ``hpc_ckpt_N.ckpt`` in the folder."""
    asked, other = tmp_path / "checkpoint.ckpt", saved(Payload(marker), tmp_path / "hpc_ckpt_1.ckpt")
    saved({"epoch": 3}, asked)
    assert WholeCheckpoints(asked).load_checkpoint(str(asked)) == {"epoch": 3}
    for reader in (WholeCheckpoints(asked), WholeCheckpoints()):
        with pytest.raises(TrainingError, match=r"hpc_ckpt_1\.ckpt"):
            reader.load_checkpoint(other, weights_only=False)
    shutil.copy(other, asked)
    with pytest.raises(FormatError, match=r"checkpoint\.ckpt: not readable"):
        WholeCheckpoints(asked).load_checkpoint(asked, weights_only=False)
    assert not marker.exists()


def test_a_small_file_that_declares_much_takes_little_memory(kinds, tmp_path):
    """Peak of a process that opens it, beside that of one which opens an ordinary one."""
    latent = kinds["latent"]
    sizes = {"hidden": 4096, "feature": 4096, "dim": 4096, "depth": 4, "z2": 4096, "joined": 4096}
    described = latent["hyper_parameters"] | {"network": {"model": "vtt", "sizes": sizes}}
    large = saved(latent | {"hyper_parameters": described}, tmp_path / "large.ckpt")
    usual = saved(latent, tmp_path / "usual.ckpt")
    peaks = [int(subprocess.check_output([sys.executable, "-c", PEAK, path], text=True)) for path in (large, usual)]
    assert peaks[0] < peaks[1] + 2 * large.stat().st_size + 200 * 2**20, json.dumps(peaks)


PEAK = """
import resource, sys
from svfl_data.errors import FormatError
from svfl_models.latent.checkpoint import load_latent
try:
    load_latent(sys.argv[1])
except FormatError:
    pass
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""
