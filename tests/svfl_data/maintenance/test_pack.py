"""Shards are read as loose files are, and give them back to the byte."""

import os
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError, StorageError, UsageError
from svfl_data.maintenance.pack import pack, unpack
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.sampling.samples import Samples
from svfl_data.sampling.split import load_split, split_episodes
from svfl_data.sampling.statistics import compute_statistics, load_statistics, save_statistics
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode

INDICES = [0, 1, 2, 5, 6, 9, 1_000_000]


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "loose", "centering", 0, {"camera": {"size": 16}})
    for index in INDICES:
        write_episode(make_episode(index), dataset.episode_path(index))
    return dataset


def contents(dataset):
    return {file.name: file.read_bytes() for file in dataset.path.iterdir() if file.is_file()}


def test_a_packed_dataset_reads_the_same(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed", shard_bytes=60_000)
    assert packed.indices == dataset.indices == INDICES
    assert not list(packed.path.glob("*.hdf5"))
    assert len(list(packed.path.glob("*.zip"))) > 2
    for index in INDICES:
        one, other, lazy = dataset.read(index), packed.read(index), packed.episode(index)
        assert one.meta == other.meta == lazy.meta
        for path, array in one.arrays.items():
            np.testing.assert_array_equal(array, other.arrays[path])
            np.testing.assert_array_equal(array, lazy[path][()])
    np.testing.assert_array_equal(load_centering(packed.path).wrench, load_centering(dataset.path).wrench)
    one, other = (Samples(each, frames=2, crop=8).batch(range(20)) for each in (dataset, packed))
    for key, value in one.items():
        np.testing.assert_array_equal(value, other[key])
    with pytest.raises(DatasetError, match=r"episode 3\b.*\b7 episodes.*\b0 to 1000000\b"):
        packed.read(3)


def test_unpacking_restores_every_byte(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed", shard_bytes=60_000)
    assert contents(unpack(packed, tmp_path / "again")) == contents(dataset)


def test_any_zip_tool_restores_every_byte(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed")
    for shard in packed.path.glob("*.zip"):
        done = subprocess.run([sys.executable, "-m", "zipfile", "-e", shard, tmp_path / "again"], check=True)
        assert done.returncode == 0
    shutil.copy(packed.path / "dataset.json", tmp_path / "again")
    assert contents(Dataset.open(tmp_path / "again")) == contents(dataset)


def test_any_zip_tool_makes_a_shard(dataset, tmp_path):
    """Also with names and extra fields of its own, which move the content."""
    target = Dataset.create_or_resume(tmp_path / "own", "centering", 0, {})
    with zipfile.ZipFile(target.path / "shard_000000.zip", "w") as archive:
        archive.writestr("notes.txt", "hello")
        info = zipfile.ZipInfo("episode_000005.hdf5")
        info.extra = b"\xfe\xca\x04\x00abcd"
        archive.writestr(info, dataset.episode_path(5).read_bytes())
    assert target.indices == [5]
    assert target.read(5).meta.index == 5


def test_equal_datasets_give_equal_shards(dataset, tmp_path):
    assert contents(pack(dataset, tmp_path / "a", 60_000)) == contents(pack(dataset, tmp_path / "b", 60_000))


@pytest.mark.parametrize("shard_bytes", [1, 60_000, 2**40])
def test_shards_keep_their_size(dataset, tmp_path, shard_bytes):
    packed = pack(dataset, tmp_path / "packed", shard_bytes)
    for shard in packed.path.glob("*.zip"):
        with zipfile.ZipFile(shard) as archive:
            sizes = [info.file_size for info in archive.infolist()]
        assert len(sizes) == 1 or sum(sizes) <= shard_bytes


def test_an_interrupted_pack_is_taken_up_again(dataset, tmp_path):
    whole = contents(pack(dataset, tmp_path / "whole", 60_000))
    packed = pack(dataset, tmp_path / "packed", 60_000)
    (packed.path / max(name for name in whole if name.endswith(".zip"))).unlink()
    (packed.path / ".shard_000009.zip.abc.part").write_bytes(b"half")
    assert contents(pack(dataset, packed.path, 60_000)) == whole


def test_a_file_of_its_own_comes_before_a_packed_one(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed")
    write_episode(make_episode(5, steps=9), packed.episode_path(5))
    assert len(packed.read(5)) == len(packed.episode(5)) == 9
    assert packed.indices == INDICES


def test_splits_and_statistics_stay_valid(dataset, tmp_path):
    split = split_episodes(dataset.indices, {"train": 0.5, "test": 0.5}, seed=0)
    split.save(dataset)
    save_statistics(dataset, split, compute_statistics(dataset, split["train"]))
    packed = pack(dataset, tmp_path / "packed")
    assert load_statistics(packed, load_split(packed, "default")) == load_statistics(dataset, split)


@pytest.mark.slow
def test_damage_is_refused_and_named(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed")
    shard = packed.path / "shard_000000.zip"
    whole = shard.read_bytes()
    rng = np.random.default_rng(0)
    silent = 0
    for number in range(40):
        bad = bytearray(whole)
        if number % 2:
            bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
        else:
            del bad[rng.integers(len(bad)) :]
        shard.write_bytes(bad)
        try:
            for index in INDICES:
                assert packed.read(index).meta == dataset.read(index).meta
            silent += 1  # a bit of the container that no reader needs
        except (FormatError, DatasetError):
            pass
    assert silent <= 4
    shard.write_bytes(b"not a zip")
    with pytest.raises(FormatError, match=r"shard_000000\.zip"):
        packed.read(0)
    with zipfile.ZipFile(shard, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(dataset.episode_path(0), "episode_000000.hdf5")
    with pytest.raises(FormatError, match=r"shard_000000\.zip.*episode_000000\.hdf5.*compressed"):
        packed.read(0)


def test_a_damaged_episode_is_not_packed(dataset, tmp_path):
    dataset.episode_path(5).write_bytes(dataset.episode_path(5).read_bytes()[:-10])
    with pytest.raises(FormatError, match=r"episode_000005\.hdf5"):
        pack(dataset, tmp_path / "packed")
    assert not list((tmp_path / "packed").glob(".*"))


def test_what_cannot_be_packed_is_refused(dataset, tmp_path):
    with pytest.raises(UsageError, match=f"{dataset.path} .*itself"):
        pack(dataset, dataset.path)
    with pytest.raises(UsageError, match=r"shard_bytes.*\b0\b.*at least 1\b"):
        pack(dataset, tmp_path / "packed", 0)
    Dataset.create_or_resume(tmp_path / "other", "picking", 0, {})
    with pytest.raises(DatasetError, match=r"other .*task.*'picking'.*'centering'"):
        pack(dataset, tmp_path / "other")


def test_a_full_disk_leaves_what_was_finished(dataset, tmp_path, monkeypatch):
    target = Dataset.create_or_resume(tmp_path / "full", "centering", 0, {"camera": {"size": 16}})
    replace, finished = os.replace, []

    def full(aside, file):
        if finished:
            raise OSError(28, "No space left on device")
        finished.append(file)
        replace(aside, file)

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(StorageError, match=r"shard_000001\.zip.*\b\d+ bytes.*No space left"):
        pack(dataset, target.path, 60_000)
    assert sorted(file.name for file in target.path.iterdir()) == ["dataset.json", "shard_000000.zip"]
    assert target.read(0).meta.index == 0
