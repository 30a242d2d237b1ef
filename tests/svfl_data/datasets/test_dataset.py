"""A dataset folder: resumed only as itself, found damage is named, samples are cut causally."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError, UsageError
from svfl_data.sampling.centering_samples import load_centering
from svfl_data.sampling.split import train_test_split
from svfl_data.sampling.windows import wrench_window
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays, make_episode


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "centering", "centering", 0, {"camera": {"size": 16}})
    for index in range(5):
        write_episode(make_episode(index), dataset.episode_path(index))
    return dataset


def test_a_dataset_is_found_again(dataset):
    assert len(Dataset.open(dataset.path)) == 5
    assert [episode.meta.index for episode in dataset] == [0, 1, 2, 3, 4]
    assert "5 episodes" in repr(dataset)
    again = Dataset.create_or_resume(dataset.path, "centering", 0, {"camera": {"size": 16}})
    assert again.info == dataset.info


@pytest.mark.parametrize(
    ("task", "seed", "size", "facts"),
    [
        ("picking", 0, 16, "task.*'centering'.*'picking'"),
        ("centering", 1, 16, r"seed.*\b0\b.*\b1\b"),
        ("centering", 0, 32, r"config\.camera\.size.*\b16\b.*\b32\b"),
    ],
)
def test_another_dataset_is_never_mixed_in(dataset, task, seed, size, facts):
    with pytest.raises(DatasetError, match=facts):
        Dataset.create_or_resume(dataset.path, task, seed, {"camera": {"size": size}})


@pytest.mark.parametrize(
    ("config", "facts"),
    [
        ({}, r"config\.camera\.size.*\b16\b.*None"),
        ({"camera": {}}, r"config\.camera\.size.*\b16\b.*None"),
        ({"camera": {"size": 16}, "tags": True}, r"config\.tags.*None.*True"),
    ],
)
def test_what_only_one_of_two_configurations_has_makes_them_different(dataset, config, facts):
    with pytest.raises(DatasetError, match=facts):
        Dataset.create_or_resume(dataset.path, "centering", 0, config)


def test_a_folder_with_other_files_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("do not touch")
    for place, found in ((tmp_path, r"dataset\.json"), (tmp_path / "thesis.tex", "not a folder")):
        with pytest.raises(DatasetError, match=rf"{place} .*{found}"):
            Dataset.create_or_resume(place, "centering", 0, {})
    assert [file.name for file in tmp_path.iterdir()] == ["thesis.tex"]


def test_what_is_not_a_dataset_is_named(dataset, tmp_path):
    with pytest.raises(FormatError, match="/absent: "):
        Dataset.open(tmp_path / "absent")
    with pytest.raises(FormatError, match=rf"{tmp_path}: .*dataset\.json"):
        Dataset.open(tmp_path)
    with pytest.raises(FormatError, match=r"episode_000000\.hdf5.*\bfile\b"):
        Dataset.open(dataset.episode_path(0))
    (dataset.path / "dataset.json").write_text("{")
    with pytest.raises(FormatError, match=r"dataset\.json.*JSON"):
        Dataset.open(dataset.path)
    (dataset.path / "dataset.json").write_text('{"format": "svfl-dataset", "format_version": "3.1"}')
    with pytest.raises(FormatError, match=r"dataset\.json.*\b3\.1.*\b1\.x"):
        Dataset.open(dataset.path)


def test_an_absent_episode_is_named(dataset):
    with pytest.raises(DatasetError, match=r"episode 17\b.*\b5 episodes.*\b0 to 4\b"):
        dataset.read(17)


def test_only_one_collector_writes_and_remains_are_cleared(dataset):
    remains = dataset.path / ".episode_000005.hdf5.abc.part"
    remains.write_bytes(b"half")
    code = (
        "import sys; from svfl_data.datasets.dataset import Dataset\n"
        "with Dataset.open(sys.argv[1]).writing(): print('held')"
    )
    root = Path(__file__).parents[3]
    with dataset.writing():
        assert not remains.exists()
        second = subprocess.run([sys.executable, "-c", code, dataset.path], cwd=root, capture_output=True, text=True)
        assert "another process" in second.stderr
    third = subprocess.run([sys.executable, "-c", code, dataset.path], cwd=root, capture_output=True, text=True)
    assert third.stdout.strip() == "held"


def test_a_window_is_causal_and_tared():
    episode = make_episode()
    for step in range(len(episode) + 1):
        window, padded = wrench_window(episode, step)
        before = episode.wrench_t_ns <= episode.t_ns[step]
        np.testing.assert_array_equal(window, episode.tared_wrench[before][-64:])
        assert not padded.any()


def test_a_window_before_the_first_readings_is_padded_with_the_first():
    window, padded = wrench_window(make_episode(), step=0, length=130)
    assert padded.sum() == 30
    np.testing.assert_array_equal(window[:30], np.repeat(window[30:31], 30, axis=0))


def test_samples_are_in_image_axes(dataset):
    """The torque arm points to the finger that touches, the label points the same way: in one and the same axes."""
    samples = load_centering(dataset.path)
    assert samples.image.shape == (5, 4, 16, 16)
    assert samples.wrench.shape == (5, 64, 6)
    fz, mx, my = samples.wrench[:, -20:, [2, 3, 4]].mean(axis=1).T
    lever = np.stack([-my / fz, mx / fz], axis=-1)
    np.testing.assert_allclose(lever, samples.offset, atol=2e-3)
    base = np.stack([episode.label_offset for episode in dataset])
    np.testing.assert_allclose(samples.offset, np.stack([base[:, 1], -base[:, 0]], axis=-1), atol=1e-6)


def test_a_dataset_without_labels_is_refused(dataset):
    arrays = episode_arrays(np.random.default_rng(0))
    del arrays["labels/offset"], arrays["labels/direction"]
    write_episode(Episode(make_episode(5).meta, arrays), dataset.episode_path(5))
    with pytest.raises(DatasetError, match=r"episode_000005\.hdf5.*labels/offset.*labels/direction"):
        load_centering(dataset.path)


def test_an_empty_dataset_is_refused(tmp_path):
    Dataset.create_or_resume(tmp_path / "empty", "centering", 0, {})
    with pytest.raises(DatasetError, match=r"empty.*no episodes"):
        load_centering(tmp_path / "empty")


def test_the_split_is_balanced_disjoint_and_has_one_test_set():
    labels = np.random.default_rng(0).integers(0, 4, 200)
    tests = set()
    for seed in range(3):
        train, test = train_test_split(labels, 20, 100, seed)
        assert not set(train) & set(test)
        assert np.bincount(labels[train]).tolist() == [5, 5, 5, 5]
        tests.add(tuple(test))
        larger, _ = train_test_split(labels, 40, 100, seed)
        assert set(train) < set(larger)
    assert len(tests) == 1
    assert set(train_test_split(labels, 20, 100, 0)[0]) != set(train_test_split(labels, 20, 100, 1)[0])


def test_impossible_splits_are_refused():
    labels = np.arange(200) % 4
    with pytest.raises(UsageError, match=r"\b0 training.*at least 1\b"):
        train_test_split(labels, 0, 100, 0)
    with pytest.raises(DatasetError, match=r"\b101 training.*\b100 test.*\b200\b.*at most 100\b"):
        train_test_split(labels, 101, 100, 0)
