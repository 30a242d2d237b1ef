"""Every artefact of a training says where it comes from, and ``svfl-train info`` shows it, whatever stands in it."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from rich.console import Console

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import identity
from svfl_data.errors import FormatError
from svfl_data.storage.store import write_episode
from svfl_models import cli
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.train import train_cloning
from svfl_models.deployment import export
from svfl_models.deployment.inspection import inspect
from svfl_models.latent import config as presets
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.train import train_latent
from svfl_models.training import run_folder
from svfl_models.training.progress import MetricsFile
from svfl_models.training.provenance import session
from svfl_models.training.provenance.commit import Commit
from svfl_models.training.provenance.record import KEY, of_checkpoint, plain, recorded
from tests.helpers import latent_evaluated
from tests.helpers.builders import make_episode
from tests.helpers.command_page import json_keys
from tests.helpers.demonstrations import demonstrations
from tests.helpers.latent_small import SIZES
from tests.hostile.json_attributes import HIDDEN

pytestmark = pytest.mark.slow

QUIET = Console(quiet=True)
FIRST, SECOND = Commit("1" * 40, True), Commit("2" * 40, False)


@pytest.fixture(autouse=True)
def first_commit(monkeypatch):
    monkeypatch.setattr(session, "own_commit", lambda: FIRST)


@pytest.fixture(scope="module")
def cloning(tmp_path_factory):
    data = demonstrations(tmp_path_factory.mktemp("data") / "picking")
    return CloningConfig(
        str(data), episodes=6, encoder="p", preset="tiny", image_size=8, valid=1 / 3, epochs=3, batch_size=10
    )


@pytest.fixture(scope="module")
def policy(cloning, tmp_path_factory):
    out = tmp_path_factory.mktemp("bc")
    train_cloning(cloning, out, QUIET)
    return out / run_folder.CHECKPOINT


@pytest.fixture(scope="module")
def classifier(tmp_path_factory):
    """A block-centering network, beside whose data lies a separate test set."""
    folder = tmp_path_factory.mktemp("centering")
    for name, seed in (("data", 0), ("test", 1)):
        Dataset.create_or_resume(folder / name, "centering", seed, {})
        for index in range(16):
            episode = make_episode(index, seed, steps=3, size=76, angle=index % 4 * np.pi / 2 + 0.1)
            write_episode(episode, folder / name / Dataset.file_name(index))
    config = TrainingConfig(str(folder / "data"), encoder="f", preset="tiny", train_samples=8, test_samples=8, epochs=1)
    train_centering(config, folder / "run", folder / "test", QUIET)
    return folder / "run" / run_folder.CHECKPOINT


@pytest.fixture(scope="module")
def latent(tmp_path_factory):
    folder = tmp_path_factory.mktemp("latent")
    return latent_evaluated.trained(latent_evaluated.dataset(folder / "data"), folder / "run")


def weights(out):
    return torch.load(out / run_folder.CHECKPOINT, weights_only=True)


def sessions_of(out):
    """The sessions in a run's checkpoint."""
    return of_checkpoint(weights(out), out)


def told(capsys, *words):
    """What `info` prints, as text and as JSON."""
    assert cli.main(["info", *map(str, words)]) == 0
    text = capsys.readouterr().out
    assert cli.main(["info", *map(str, words), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts.keys() == json_keys("svfl-train info")
    return text, facts


@pytest.mark.parametrize("kind", ["policy", "classifier", "latent"])
def test_every_training_leaves_its_provenance(kind, request):
    checkpoint = request.getfixturevalue(kind)
    (one,) = recorded(checkpoint.parent)
    assert sessions_of(checkpoint.parent) == [one]
    data = one.data["data"]
    assert data.sha256 == identity(Dataset.open(data.path)).sha256
    assert (one.seeds, one.command) == ((0,), session.FROM_PYTHON)
    assert {"svfl", "torch", "lightning", "python"} <= one.packages.keys()
    assert one.device


def test_a_report_has_a_section_on_it(classifier):
    page = (classifier.parent / run_folder.REPORT).read_text()
    (one,) = recorded(classifier.parent)
    assert "## Provenance" in page
    assert one.data["data"].sha256[:12] in page
    assert one.data["separate-test"].sha256[:12] in page
    assert one.data["separate-test"].sha256 != one.data["data"].sha256


def stop_in_the_second_epoch(self, trainer, *rest):
    if trainer.current_epoch == 1:
        raise KeyboardInterrupt


def test_a_training_that_goes_on_elsewhere_lists_each_start_and_gives_the_same(cloning, policy, tmp_path, monkeypatch):
    out = tmp_path / "cut"
    with monkeypatch.context() as patched:
        patched.setattr(MetricsFile, "on_train_batch_end", stop_in_the_second_epoch)
        with pytest.raises(KeyboardInterrupt):
            train_cloning(cloning, out, QUIET)
    assert [one.commit for one in recorded(out)] == [FIRST.sha]
    monkeypatch.setattr(session, "own_commit", lambda: SECOND)
    train_cloning(cloning, out, QUIET)
    both = recorded(out)
    assert [(one.commit, one.clean) for one in both] == [(FIRST.sha, True), (SECOND.sha, False)]
    assert sessions_of(out) == both
    configs = [(folder / run_folder.CONFIG).read_bytes() for folder in (out, policy.parent)]
    assert configs[0] == configs[1]
    whole = weights(policy.parent)
    assert all(torch.equal(value, weights(out)["state_dict"][name]) for name, value in whole["state_dict"].items())


def test_a_latent_model_that_goes_on_lists_each_start(latent, tmp_path, monkeypatch):
    out = tmp_path / "run"
    out.mkdir()
    for file in latent.parent.iterdir():
        (out / file.name).write_bytes(file.read_bytes())
    config = LatentConfig(**load_latent(latent).hparams["training"])
    monkeypatch.setitem(presets.PRESETS, config.preset, replace(presets.PRESETS[config.preset], sizes=SIZES))
    monkeypatch.setattr(session, "own_commit", lambda: SECOND)
    train_latent(replace(config, steps=4), out, console=QUIET)
    assert [one.commit for one in recorded(out)] == [recorded(latent.parent)[0].commit, SECOND.sha]
    assert sessions_of(out) == recorded(out)


def test_a_new_training_in_the_same_folder_begins_a_new_list(cloning, tmp_path):
    for _ in range(2):
        train_cloning(replace(cloning, epochs=1), tmp_path, QUIET)
        assert len(recorded(tmp_path)) == 1


def test_info_tells_a_policy(policy, cloning, capsys):
    text, found = told(capsys, policy)
    for words in ("policy for block_picking", "svfl-train bc", "group", "D4", "tiny", "proprio", cloning.data):
        assert words in text
    assert f"commit {FIRST.sha[:12]} (clean)" in text or recorded(policy.parent)[0].commit[:12] in text
    assert found["configuration"] == cloning.plain()
    assert found["network"]["parameters"] == sum(one.numel() for one in load_policy(policy).parameters())
    assert found["inputs"].keys() == {"proprio"}
    assert found["provenance"] == json.loads((policy.parent / run_folder.PROVENANCE).read_text())["sessions"]
    assert found["results"]["result.json"]["epochs"] == 3


def test_info_tells_a_classifier(classifier, capsys):
    text, found = told(capsys, classifier)
    assert "block-centering network" in text
    assert "separate-test" in text
    assert found["inputs"] == {"wrench": "64 readings"}
    assert found["network"]["group"] == "D4"
    assert found["network"]["widths"]["latent"] == 4
    assert 0 <= found["results"]["result.json"]["test_accuracy"] <= 1


def test_info_tells_the_sizes_of_the_layers_that_there_are(cloning, tmp_path, capsys):
    """Not those of the preset, some of which were replaced."""
    train_cloning(replace(cloning, epochs=1, widths={"latent": 5}), tmp_path, QUIET)
    widths = told(capsys, tmp_path)[1]["network"]["widths"]
    assert (widths["latent"], widths["proprio"]) == (5, [2, 2, 4])


def test_info_tells_a_latent_model(latent, capsys):
    text, found = told(capsys, latent)
    assert "latent model" in text
    assert found["network"]["model"] == "poe"
    assert found["inputs"]["image"].endswith("camera front")
    assert found["configuration"]["steps"] == 2


def test_info_tells_the_folder_of_a_training(policy, tmp_path, capsys):
    """All its starts, also one that has not come to a checkpoint."""
    assert told(capsys, policy.parent)[1] == told(capsys, policy)[1]
    for file in policy.parent.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    sessions = recorded(policy.parent) * 2
    content = json.loads((policy.parent / run_folder.PROVENANCE).read_text())
    (tmp_path / run_folder.PROVENANCE).write_text(json.dumps(content | {"sessions": plain(sessions)}))
    text, found = told(capsys, tmp_path)
    assert len(found["provenance"]) == 2
    assert "provenance 2 of 2" in text


def test_an_exported_network_keeps_its_provenance(policy, classifier, tmp_path, capsys):
    for checkpoint, what in ((policy, "exported policy"), (classifier, "exported block-centering network")):
        for suffix in (".pt2",) if checkpoint is policy else export.SAVERS:
            out = tmp_path / f"{checkpoint.parent.name}{suffix}"
            assert cli.main(["export", str(checkpoint), "--out", str(out)]) == 0
            capsys.readouterr()
            text, found = told(capsys, out)
            assert what in text
            *trained, own = found["provenance"]
            assert trained == json.loads((checkpoint.parent / run_folder.PROVENANCE).read_text())["sessions"]
            assert own["data"]["checkpoint"]["sha256"] == session.file(checkpoint).sha256
            assert own["commit"] == FIRST.sha
            assert found["network"]["weights and constants"] > 0


def test_results_of_another_run_are_not_shown(policy, tmp_path):
    checkpoint = tmp_path / run_folder.CHECKPOINT
    checkpoint.write_bytes(policy.read_bytes())
    other = json.loads((policy.parent / run_folder.RESULT).read_text())
    other["config"]["seed"] += 1
    (tmp_path / run_folder.RESULT).write_text(json.dumps(other))
    evaluated = {"success": [True], "rate": 1.0, "provenance": {"data": {"checkpoint": {"sha256": "0" * 64}}}}
    (tmp_path / run_folder.EVALUATION).write_text(json.dumps(evaluated))
    assert inspect(checkpoint).results == {}
    evaluated["provenance"]["data"]["checkpoint"]["sha256"] = session.file(checkpoint).sha256
    (tmp_path / run_folder.EVALUATION).write_text(json.dumps(evaluated))
    assert inspect(checkpoint).results == {run_folder.EVALUATION: {"rate": 1.0, "episodes": 1}}


def test_checkpoints_from_before_there_was_provenance_are_told_too(policy, tmp_path, capsys):
    content = weights(policy.parent)
    del content[KEY]
    torch.save(content, tmp_path / "old.ckpt")
    text, found = told(capsys, tmp_path / "old.ckpt")
    assert "provenance     unknown" in text
    assert found["provenance"] == []


@pytest.mark.parametrize("value", ["text", [1], [{"started": "x" * 10**6}], [{"started": torch.zeros(2)}]])
def test_a_damaged_provenance_is_one_line_and_stops_nobody_else(value, policy, tmp_path, capsys):
    torch.save(weights(policy.parent) | {KEY: value}, tmp_path / "odd.ckpt")
    assert cli.main(["info", str(tmp_path / "odd.ckpt")]) == 1
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert "provenance" in complaint
    load_policy(tmp_path / "odd.ckpt")


def test_hostile_texts_are_shown_harmlessly(policy, tmp_path, capsys):
    evil = f"{HIDDEN}\n\x1b[2JFORGED\u202e"
    sessions = plain(sessions_of(policy.parent))
    sessions[0] |= {"command": evil, "started": evil, "packages": {evil: evil}, "commit": evil[:64]}
    sessions[0]["data"] = {evil: {"path": evil, "sha256": evil[:64], "episodes": 1}}
    content = weights(policy.parent) | {KEY: sessions}
    content["hyper_parameters"]["training"]["data"] = evil
    content["hyper_parameters"]["deployment"]["task"] = evil
    torch.save(content, tmp_path / "evil.ckpt")
    assert cli.main(["info", str(tmp_path / "evil.ckpt")]) == 0
    text = capsys.readouterr().out
    assert all(line.isprintable() for line in text.splitlines())
    assert not any(line.startswith("FORGED") for line in text.splitlines())
    assert cli.main(["info", str(tmp_path / "evil.ckpt"), "--json"]) == 0
    assert all(line.isprintable() for line in capsys.readouterr().out.splitlines())


@pytest.mark.parametrize(
    "name", ["nothing.ckpt", "nothing.pt2", "nothing.onnx", "nothing", "text.ckpt", "text.pt2", "text.onnx", "folder"]
)
def test_what_is_no_network_is_one_line(name, tmp_path, capsys):
    (tmp_path / "text.ckpt").write_text("hello")
    (tmp_path / "text.pt2").write_text("hello")
    (tmp_path / "text.onnx").write_text("hello")
    (tmp_path / "folder").mkdir()
    assert cli.main(["info", str(tmp_path / name)]) == 1
    complaint = capsys.readouterr().err
    assert complaint.count("\n") == 1
    assert str(tmp_path / name) in complaint


def test_a_checkpoint_of_another_program_is_named(tmp_path):
    torch.save({"state_dict": {}, "svfl": {"format": "svfl-other"}}, tmp_path / "other.ckpt")
    with pytest.raises(FormatError, match=r"svfl-other.*svfl-policy"):
        inspect(tmp_path / "other.ckpt")
