"""Validate, reading and training say the same of every kind of finding, in one line."""

import re
from dataclasses import replace

import numpy as np
import pytest
from torch.utils.data import DataLoader

from svfl_data.checks import check_dataset, check_usable
from svfl_data.checks.findings_cache import FindingsCache
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, SvflError
from svfl_data.replay import ReplayBuffer, ReplayConfig
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.sampling.samples import Samples
from svfl_data.sampling.statistics import compute_statistics
from svfl_data.sampling.torch_samples import TorchSamples
from svfl_data.schema.episode import Episode, Meta
from svfl_data.storage.store import write_episode
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.latent.recordings import load_recordings
from tests.helpers.sealed import dataset_of
from tests.helpers.spoiled import INVALID, SPOILERS, black_image, drop_outs, fresh, saturation

pytestmark = pytest.mark.slow

WRENCH, CAMERA, LABELS = "streams/wrench/", "cameras/front/", "labels/"
SATURATED = r"episode_000001\.hdf5: streams/wrench/wrench\[\d+\]: fx"


def clone(path):
    CloningData(CloningConfig(str(path), episodes=2, valid=0.5, image_size=8))


def sample(path):
    next(iter(DataLoader(TorchSamples(Samples(Dataset.open(path))), batch_size=4)))


def replay(path):
    ReplayBuffer.from_demos(Dataset.open(path), 2, config=ReplayConfig(crop=12)).sample(4)


USES = {
    "centering": (lambda path: load_centering(path), (WRENCH, CAMERA, LABELS)),
    "bc": (clone, (WRENCH, CAMERA)),
    "samples": (sample, (WRENCH, CAMERA)),
    "replay": (replay, (WRENCH, CAMERA)),
    "latent": (lambda path: load_recordings(Dataset.open(path), 5.0), (WRENCH, CAMERA, "streams/object/")),
    "statistics": (lambda path: compute_statistics(Dataset.open(path), [0, 1]), ("",)),
}
"""Trainings, and what each reads beside observations and actions."""


def written(folder, *spoilers, size=16):
    """A dataset of two episodes whose second one is spoiled."""
    dataset = Dataset.create_or_resume(folder, "centering", 0, {})
    for index in (0, 1):
        arrays = fresh(size=size)
        for spoil in spoilers if index else ():
            spoil(arrays)
        write_episode(Episode(Meta("centering", index, 0, "expert", True), arrays), dataset.episode_path(index))
    return dataset


def outcome(use, path):
    """What a user is told; a traceback is an error of the test."""
    try:
        use(path)
    except SvflError as error:
        return str(error)
    return ""


@pytest.mark.parametrize("spoil", SPOILERS, ids=lambda spoil: spoil.__name__)
def test_validate_reading_and_training_say_the_same(spoil, tmp_path, capsys):
    field, _, severity, _ = spoil(fresh())
    dataset = written(tmp_path / "d", spoil)
    found = {one.severity for of_episode in check_dataset(dataset) for one in of_episode if one.field == field}
    assert severity in found
    assert severity == "error" or "error" not in found
    assert len(dataset.read(1)) == 20  # what is no more than an error can be looked at
    for name, (use, reads) in USES.items():
        concerned = severity == "error" and (field.startswith(reads) or field.startswith(("observations", "actions")))
        said = outcome(use, dataset.path)
        assert ("1 of 2 episodes are unfit for training" in said) == concerned, (name, said)
        assert len(said.splitlines()) <= 1
    if severity == "warning" and field.startswith((WRENCH, CAMERA)):
        assert "1 of 2 episodes have warnings" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["depth scale 0", "wrench 3e38", "direction 7", "no pixels", "pose mirrored"])
@pytest.mark.parametrize("training", USES)
def test_nobody_learns_from_what_is_invalid(name, training, tmp_path):
    spoil, field, words = INVALID[name]
    arrays = fresh()
    spoil(arrays)
    path = dataset_of(tmp_path / "d", arrays)
    with pytest.raises(FieldError) as refused:
        USES[training][0](path)
    assert f"field {field} " in str(refused.value)
    assert words in str(refused.value)


def test_only_what_is_used_counts(tmp_path):
    dataset = written(tmp_path / "d", saturation)
    check_usable(dataset, [0, 1], ["cameras/front"])
    check_usable(dataset, [0])
    with pytest.raises(DatasetError, match=SATURATED):
        check_usable(dataset, [0, 1], ["streams/wrench"])
    dark = written(tmp_path / "dark", black_image)
    check_usable(dark, [0, 1], ["streams/wrench"])
    with pytest.raises(DatasetError, match=r"cameras/front/.* all black"):
        check_usable(dark, [0, 1])


def test_findings_are_kept_by_content_and_no_image_is_checked_again(tmp_path, monkeypatch):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    dataset = written(tmp_path / "d", saturation)
    outcomes = []
    for episodes in ([0], [0, 1], [0, 1]):
        try:
            outcomes.append(check_usable(dataset, episodes))
        except DatasetError as error:
            outcomes.append(str(error))
        monkeypatch.setattr("svfl_data.checks.episode_checks.IMAGE_CHECKS", (None,) * (len(outcomes) > 1))
    assert outcomes[0] is None
    assert outcomes[1] == outcomes[2]
    assert re.search(SATURATED, outcomes[1])
    assert not list(dataset.path.glob(".*")), "nothing in the dataset's folder"
    (kept,) = (tmp_path / "cache" / "findings").iterdir()
    for damage in (b"", b"SQLite format 3\0" + bytes(200), b"x" * 5000):
        kept.write_bytes(damage)
        monkeypatch.undo()
        monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
        with pytest.raises(DatasetError, match=SATURATED):
            check_usable(dataset, [0, 1])


def test_other_rules_check_again(tmp_path, monkeypatch):
    monkeypatch.setenv("SVFL_CACHE_DIR", str(tmp_path / "cache"))
    with FindingsCache() as cache:
        cache.keep("a seal", "streams", [])
    with FindingsCache() as cache:
        assert cache.known("a seal", "streams", "e") == []
        assert cache.known("a seal", "front", "e") is None
        monkeypatch.setattr("svfl_data.checks.findings_cache.source_hash", lambda *names: "others")
        assert cache.known("a seal", "streams", "e") is None


def test_filter_keeps_the_sound_ones(tmp_path, monkeypatch, capsys):
    import sys

    from svfl_data.cli import main

    dataset = written(tmp_path / "d", drop_outs)
    for index, spoil in ((2, saturation), (3, black_image)):
        arrays = fresh()
        spoil(arrays)
        write_episode(Episode(Meta("centering", index, 0, "expert", True), arrays), dataset.episode_path(index))
    dataset.episode_path(4).write_bytes(b"no episode")
    monkeypatch.setattr(sys, "argv", ["svfl-data", "filter", str(dataset.path), str(tmp_path / "sound"), "--valid"])
    assert main() == 0
    sound = Dataset.open(tmp_path / "sound")
    assert len(sound) == 2
    load_centering(sound.path)
    assert sound.info["config"]["conditions"] == ["valid"]


@pytest.mark.parametrize("encoder", ["f", "v"])
def test_inputs_that_are_not_used_do_not_matter(encoder, tmp_path):
    """One more camera, spoiled: what a network without it learns from is the same, to the bit."""
    inputs = {"f": ("wrench",), "v": ("image",)}[encoder]
    folders = {name: Dataset.create_or_resume(tmp_path / name, "centering", 0, {}) for name in ("plain", "more")}
    rng = np.random.default_rng(0)
    for index in range(4):
        arrays = fresh(steps=6, size=10)
        arrays["actions/action"][:, 0] = 1
        meta = Meta("centering", index, 0, "expert", True)
        write_episode(Episode(meta, arrays), folders["plain"].episode_path(index))
        more = dict(arrays)
        if encoder == "f":
            more |= {path.replace("front", "wrist"): array for path, array in arrays.items() if "front" in path}
            more["cameras/wrist/color"] = rng.integers(0, 9, (7, 3, 50, 3), dtype=np.uint8)  # not square, half as many
            more["cameras/wrist/depth"] = np.zeros((7, 3, 50), np.uint16)
            more["cameras/front/color"] = np.zeros_like(arrays["cameras/front/color"])
            del more["cameras/front/depth"]
        else:
            more["streams/wrench/wrench"] = np.ones_like(arrays["streams/wrench/wrench"])
            more["streams/wrench/t_ns"] = more["streams/wrench/t_ns"][::-1].copy()
        write_episode(Episode(meta, more), folders["more"].episode_path(index))
    samples = [load_centering(one.path, inputs=inputs) for one in folders.values()]
    for name in (*inputs, "direction", "offset"):
        np.testing.assert_array_equal(getattr(samples[0], name), getattr(samples[1], name))
    config = CloningConfig("", episodes=4, encoder=encoder, valid=0.25, image_size=8, augment=False, view="camera")
    data = [CloningData(replace(config, data=str(one.path))) for one in folders.values()]
    batches = [one.valid_set.batch(range(len(one.valid_set))) for one in data]
    for name in (*inputs, "action"):
        np.testing.assert_array_equal(batches[0][name].numpy(), batches[1][name].numpy())


def test_no_image_is_read_where_none_is_used(tmp_path, monkeypatch):
    dataset = written(tmp_path / "d")
    monkeypatch.setattr("svfl_data.sampling.frames.Frames.of", None)
    monkeypatch.setattr("svfl_data.checks.episode_checks.IMAGE_CHECKS", None)
    assert load_centering(dataset.path, inputs=("wrench",)).image.size == 0
    Samples(dataset, cameras=[])
