"""The identity of a dataset: equal for equal episodes wherever they lie, and another one after any change of one."""

import json
import os
import sys
from dataclasses import replace
from unittest import mock

import pytest

from svfl_data.cli import main
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.fingerprint import fingerprint, identity
from svfl_data.maintenance.pack import pack, unpack
from svfl_data.maintenance.relabel import relabel
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import read_episode, write_episode
from tests.helpers.builders import make_episode


def made(folder, indices=(0, 1, 2)):
    dataset = Dataset.create_or_resume(folder, "centering", 0, {})
    for index in indices:
        write_episode(make_episode(index), dataset.episode_path(index))
    return dataset


@pytest.fixture
def dataset(tmp_path):
    return made(tmp_path / "data")


def test_equal_episodes_have_one_identity(dataset, tmp_path):
    assert identity(made(tmp_path / "again", (2, 0, 1))) == identity(dataset)
    assert identity(dataset).episodes == 3
    assert identity(dataset).sha256 == fingerprint(dataset, dataset.indices)


def test_packing_changes_nothing(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed", shard_bytes=1)
    assert identity(packed) == identity(dataset)
    assert identity(unpack(packed, tmp_path / "unpacked")) == identity(dataset)


def test_files_beside_the_episodes_do_not_count(dataset):
    before = identity(dataset)
    for command, *words in (["split", "--ratios", "train=0.6", "test=0.4"], ["stats"], ["info"]):
        with mock.patch.object(sys, "argv", ["svfl-data", command, str(dataset.path), *words]):
            assert main() == 0
    assert identity(dataset) == before


def _relabelled(dataset):
    relabel(dataset, 1, lambda episode: replace(episode.meta, success=not episode.meta.success))


def _one_number(dataset):
    episode = read_episode(dataset.episode_path(1))
    proprio = episode.proprio.copy()
    proprio[0, 3] += 1e-3
    write_episode(replace(episode, arrays=episode.arrays | {"observations/proprio": proprio}), dataset.episode_path(1))


def _one_text(dataset):
    episode = read_episode(dataset.episode_path(1))
    write_episode(Episode(replace(episode.meta, operator="x"), episode.arrays), dataset.episode_path(1))


CHANGES = {
    "relabelled": _relabelled,
    "one number": _one_number,
    "one text": _one_text,
    "one more": lambda dataset: write_episode(make_episode(3), dataset.episode_path(3)),
    "one less": lambda dataset: dataset.episode_path(1).unlink(),
    "another number": lambda dataset: dataset.episode_path(2).rename(dataset.episode_path(7)),
    "exchanged": lambda dataset: [
        dataset.episode_path(one).rename(dataset.episode_path(other)) for one, other in ((0, 9), (1, 0), (9, 1))
    ],
}


@pytest.mark.parametrize("change", CHANGES)
def test_any_change_of_one_episode_changes_it(dataset, change):
    before = identity(dataset)
    CHANGES[change](dataset)
    assert identity(dataset).sha256 != before.sha256


@pytest.mark.parametrize("spoil", ["cut", "empty", "link", "folder", "pipe"])
def test_what_has_no_seal_is_counted_apart(dataset, spoil):
    file, whole = dataset.episode_path(1), dataset.episode_path(1).read_bytes()
    file.unlink()
    {
        "cut": lambda: file.write_bytes(whole[:-1]), "empty": lambda: file.write_bytes(b""),
        "link": lambda: file.symlink_to(dataset.episode_path(0)), "folder": file.mkdir, "pipe": lambda: os.mkfifo(file),
    }[spoil]()  # fmt: skip
    found = identity(dataset)
    assert (found.episodes, found.unsealed) == (3, 1)
    assert "1 of them without a seal" in str(found)


def test_an_empty_dataset_has_one(tmp_path):
    assert identity(Dataset.create_or_resume(tmp_path / "data", "centering", 0, {})).episodes == 0


def test_info_tells_it_and_what_collected_the_episodes(tmp_path, capsys):
    dataset = Dataset.create_or_resume(tmp_path / "data", "centering", 0, {})
    for index, (operator, version) in enumerate((("Ada", "1"), ("Ada", "1"), ("Grace", "2"))):
        episode = make_episode(index)
        meta = replace(episode.meta, operator=operator, robot="arm", software={"svfl": version, "driver": "7"})
        write_episode(Episode(meta, episode.arrays), dataset.episode_path(index))
    with mock.patch.object(sys, "argv", ["svfl-data", "info", str(dataset.path)]):
        assert main() == 0
    text = capsys.readouterr().out
    assert f"  identity  {identity(dataset)}\n" in text
    assert "  operators Ada (2), Grace (1)\n" in text
    assert "  software  driver 7, svfl 1 (2); driver 7, svfl 2 (1)\n" in text
    with mock.patch.object(sys, "argv", ["svfl-data", "info", str(dataset.path), "--json"]):
        assert main() == 0
    found = json.loads(capsys.readouterr().out)
    assert found["identity"] == {"sha256": identity(dataset).sha256, "episodes": 3, "unsealed": 0}
    assert found["operators"] == {"Ada": 2, "Grace": 1}
    assert found["recorded_with"] == {"driver 7, svfl 1": 2, "driver 7, svfl 2": 1}
