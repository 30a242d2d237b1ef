import dataclasses
import json
import math
import re

import numpy as np
import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import identity
from svfl_data.errors import DatasetError, FormatError
from svfl_models.centering.pretrained import digest
from svfl_models.cli import main
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.evaluation.episodes import material, some, whole
from svfl_models.latent.evaluation.evaluate import evaluate
from svfl_models.latent.evaluation.frames import encode, encoded, follow, frames_of
from svfl_models.latent.evaluation.pages.report import plain
from svfl_models.latent.evaluation.probing.poses import object_poses, repeats_per_turn
from svfl_models.latent.recordings import load_recordings
from tests.helpers.latent_evaluated import dataset, trained
from tests.helpers.latent_small import lifting, written

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return dataset(tmp_path_factory.mktemp("data") / "picking")


@pytest.fixture(scope="module")
def checkpoint(data, tmp_path_factory):
    return trained(data, tmp_path_factory.mktemp("poe") / "run")


def test_only_held_out_episodes_are_evaluated(checkpoint):
    module = load_latent(checkpoint)
    given = material(module, None, 40, 0)
    evaluated, learned = ({one.index for one in part.recordings} for part in (given.evaluated, given.learned))
    assert evaluated == set(module.hparams["split"]["valid"])
    assert learned == set(module.hparams["split"]["train"])
    assert not evaluated & learned


def test_another_dataset_is_evaluated_whole_and_a_moved_one_is_not(checkpoint, data, tmp_path):
    module = load_latent(checkpoint)
    other = written(tmp_path / "other", [lifting(index) for index in range(3)], task="block_pushing")
    given = material(module, other, 40, 0)
    assert [one.index for one in given.evaluated.recordings] == [0, 1, 2]
    assert given.learned.dataset.path == data
    assert "another dataset" in given.of
    moved = dataset(tmp_path / "moved")
    assert {one.index for one in material(module, moved, 40, 0).evaluated.recordings} == {
        *module.hparams["split"]["valid"]
    }
    module.hparams["training"]["data"] = str(tmp_path / "gone")
    assert {one.index for one in material(module, moved, 40, 0).evaluated.recordings} == {
        *module.hparams["split"]["valid"]
    }
    with pytest.raises(FormatError, match=re.escape(str(tmp_path / "gone"))):
        material(module, None, 40, 0)
    few = written(tmp_path / "few", [lifting(0)])
    with pytest.raises(DatasetError, match=r"split .*\b4 episodes .*first is 1\b.* has 1\b"):
        material(module, few, 40, 0)


def test_episodes_are_drawn_by_seed():
    every = list(range(20))
    assert some(every, 5, 0) == some(every, 5, 0) != some(every, 5, 1)
    assert some(every, 40, 3) == every


def test_frames_are_those_of_the_episodes_and_encoded_as_followed(checkpoint):
    module = load_latent(checkpoint)
    recordings = material(module, None, 40, 0).learned.recordings
    batches = [whole(one) for one in recordings]
    frames = frames_of(batches)
    assert len(frames) == sum(len(one) + 1 for one in recordings)
    assert torch.equal(frames.contact, torch.from_numpy(np.concatenate([one.pressed for one in recordings])))
    seen, alone = encoded(follow(module.network, recordings)), encode(module.network, frames.observations)
    assert torch.allclose(seen.feature, alone.feature, atol=1e-4)
    few = frames_of(batches, 7)
    assert len(few) == 7
    assert torch.equal(few.observations["wrench"], frames.spread(7).observations["wrench"])
    assert torch.equal(few.episode, frames.spread(7).episode)


def test_object_poses_are_in_image_axes_about_the_centre(data):
    opened = Dataset.open(data)
    frames = frames_of([whole(one) for one in load_recordings(opened, 0.5)[:2]])
    poses = object_poses(opened, frames, "front")
    episode = opened.read(int(frames.episode[0]))
    place = episode.object_pose[0, :2] - episode.centre
    assert poses[0, :2] == pytest.approx(episode.cameras["front"].image_axes @ place)
    assert poses[0, 2] == pytest.approx(episode.object_pose[0, 2])
    axis = episode.cameras["front"].image_axes @ [1.0, 0.0]  # the written object is not turned
    assert [math.cos(poses[0, 3]), math.sin(poses[0, 3])] == pytest.approx(axis)


@pytest.mark.parametrize(("task", "half", "repeats"), [
    ("block_picking", None, 4), ("mug_picking", None, 1), ("mug_picking", (0.02, 0.02, 0.05), 4),
    ("block_picking", (0.02, 0.03, 0.02), 2),
])  # fmt: skip
def test_the_yaw_of_a_cube_repeats_at_every_quarter_turn(task, half, repeats, tmp_path):
    episode = lifting(0, task=task)
    arrays = {path: values for path, values in episode.arrays.items() if not path.endswith("half_extents")}
    if half is not None:
        arrays["streams/object/half_extents"] = np.array(half)
    folder = written(tmp_path / "data", [dataclasses.replace(episode, arrays=arrays)], task=task)
    assert repeats_per_turn(Dataset.open(folder)) == repeats


@pytest.mark.parametrize("model", ["poe", "vtt"])
def test_the_command(model, data, tmp_path, capsys):
    checkpoint = trained(data, tmp_path / "run", model)
    as_json = ["--json"] if model == "vtt" else []
    assert main(["latent-eval", str(checkpoint), "--episodes", "1", *as_json]) == 0
    printed = capsys.readouterr().out
    out = tmp_path / "run" / "latent_eval"
    found = json.loads((out / "evaluation.json").read_text())
    if as_json:
        told = json.loads(printed)
        assert told.pop("files")[0] == str(out / "report.md")
        assert told == found
    else:
        assert f"{model} after 2 steps, on 1 episodes" in printed
        assert "probe: object yaw" in printed
    assert found["episodes"] == 1
    assert len(found["missing"]) == 7
    assert found["provenance"]["data"]["checkpoint"]["sha256"] == digest(checkpoint)
    assert found["provenance"]["data"]["data"]["sha256"] == identity(Dataset.open(data)).sha256
    assert (found["attention"] is not None) == (model == "vtt")
    assert (found["experts"] is not None) == (model == "poe")
    page = (out / "report.md").read_text()
    for name in (
        "Reconstruction",
        "Contact",
        "Alignment",
        "Next gripper",
        "Probes",
        "Missing modalities",
        "Symmetry",
        "Provenance",
    ):
        assert f"## {name}" in page
    pictures = {path.name for path in out.glob("*.png")}
    assert {"reconstructions.png", "curves.png", "probes.png", "missing_modalities.png"} <= pictures
    assert ("attention_over_image.png" in pictures) == (model == "vtt")
    assert all(f"({name})" in page for name in pictures)


def test_what_was_not_trained_and_not_recorded_is_left_out_and_said(tmp_path):
    def annotated(index):
        episode = lifting(index)
        arrays = {path: values for path, values in episode.arrays.items() if not path.startswith("streams/object")}
        touch = {"name": "contact", "start_ns": int(episode.t_ns[8]), "end_ns": int(episode.t_ns[10]), "by": "test"}
        return dataclasses.replace(episode, arrays=arrays, meta=dataclasses.replace(episode.meta, annotations=[touch]))

    folder = written(tmp_path / "data", [annotated(index) for index in range(5)])
    found, _ = evaluate(trained(folder, tmp_path / "run", "concat", preset="lee_2020"), None, 40, 0)
    assert found.contact is None
    assert found.next_contact is not None
    assert not [one for one in found.probes if one.name.startswith("object")]
    assert found.left_out == [
        "contact of the frame: the model was trained without it",
        "object pose: it was not recorded with every episode",
    ]


def test_mistakes_are_one_line(checkpoint, tmp_path, capsys):
    torch.save({"svfl": {"format": "svfl-centering", "format_version": "1.0"}}, tmp_path / "other.ckpt")
    cases = {
        (str(tmp_path / "no.ckpt"),): f"{tmp_path}/no.ckpt",
        (str(tmp_path / "other.ckpt"),): f"{tmp_path}/other.ckpt.* svfl-centering.* svfl-latent",
        (str(checkpoint), "--data", str(tmp_path / "no")): f"{tmp_path}/no: ",
    }
    for arguments, facts in cases.items():
        assert main(["latent-eval", *arguments]) == 1
        printed = capsys.readouterr().err
        assert re.search(facts, printed)
        assert printed.count("\n") == 1
    blocked = tmp_path / "file"
    blocked.write_text("")
    assert main(["latent-eval", str(checkpoint), "--episodes", "1", "--out", str(blocked)]) == 1
    assert "file: File exists" in capsys.readouterr().err


def test_numbers_that_json_has_not_become_null():
    assert plain({1: [math.inf, 2.0, (None, math.nan)]}) == {"1": [None, 2.0, [None, None]]}
