"""Splits are by episode and stored; statistics come from the training part only and scale with the group."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FormatError, UsageError
from svfl_data.sampling.moments import Moments, statistics
from svfl_data.sampling.split import Split, load_split, split_episodes
from svfl_data.sampling.statistics import compute_statistics, load_statistics, save_statistics, statistics_file
from svfl_data.schema.declarations import STANDARD
from svfl_data.schema.episode import Episode
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import ACTION_PARTS, WRENCH_PARTS, Part, act, dihedral
from tests.helpers.builders import make_episode
from tests.helpers.own_robot import own_episode

SHARES = {"train": 0.6, "valid": 0.2, "test": 0.2}


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    for index in range(5):
        write_episode(make_episode(index, steps=2 + index), dataset.episode_path(index))
    return dataset


@given(
    st.lists(st.integers(0, 500), min_size=10, max_size=60, unique=True),
    st.lists(st.sampled_from([0.1, 0.2, 0.25, 1 / 3]), min_size=1, max_size=3),
    st.integers(0, 99),
)
def test_a_split_is_disjoint_of_the_shares_and_repeatable(indices, shares, seed):
    named = {f"part{number}": share for number, share in enumerate(shares)}
    split = split_episodes(indices, named, seed)
    together = [index for part in named for index in split[part]]
    assert len(set(together)) == len(together)
    assert set(together) <= set(indices)
    for part, share in named.items():
        assert abs(len(split[part]) - share * len(indices)) < 1
        assert split[part] == sorted(split[part])
    assert split_episodes(indices[::-1], named, seed) == split


def test_the_whole_is_split_wholly_and_seeds_differ():
    splits = [split_episodes(range(37), {"train": 0.8, "valid": 0.1, "test": 0.1}, seed) for seed in range(5)]
    for split in splits:
        assert sorted(index for part in split.parts.values() for index in part) == list(range(37))
    assert len({split.sha256 for split in splits}) == 5


def test_a_stored_split_comes_back_and_is_never_overwritten(dataset):
    split = split_episodes(dataset.indices, SHARES, seed=0)
    file = split.save(dataset)
    assert load_split(dataset, "default") == split
    split.save(dataset)
    with pytest.raises(DatasetError, match=r"splits/default\.json.*another split.*--replace"):
        split_episodes(dataset.indices, SHARES, seed=1).save(dataset)
    assert json.loads(file.read_text())["seed"] == 0
    with pytest.raises(DatasetError, match=r"'default'.*'dev'.*train, valid, test"):
        split["dev"]


def test_what_is_no_split_is_refused(dataset):
    split = split_episodes(dataset.indices, SHARES, seed=0)
    file = split.save(dataset)
    with pytest.raises(DatasetError, match=r"'other'.*\bdefault\b"):
        load_split(dataset, "other")
    with pytest.raises(UsageError, match=r"'\.\./dataset'"):
        load_split(dataset, "../dataset")
    content = json.loads(file.read_text())
    moved = {part: list(indices) for part, indices in split.parts.items()}
    moved["train"].append(moved["test"].pop())
    for broken, facts in (
        ("{", "JSON"),
        ("[]", "'svfl-split'"),
        (json.dumps(content | {"format_version": "2.0"}), r"\b2\.0\b.*\b1\.x"),
        (json.dumps(content | {"parts": moved}), "parts.*hash"),
        (json.dumps({key: value for key, value in content.items() if key != "rule"}), "rule"),
    ):
        file.write_text(broken)
        with pytest.raises(FormatError, match=rf"splits/default\.json: .*{facts}"):
            load_split(dataset, "default")
    file.write_text(json.dumps(content))
    gone = split["test"][0]
    dataset.episode_path(gone).unlink()
    with pytest.raises(DatasetError, match=rf"\b1 of its 5 episodes \({gone}\).*--split default --replace"):
        load_split(dataset, "default")


@pytest.mark.parametrize("shares", [{}, {"train": 0.0}, {"train": -0.1, "test": 0.5}, {"train": 0.7, "test": 0.4}])
def test_shares_must_be_shares(shares):
    with pytest.raises(UsageError, match=re.escape(str(shares))):
        split_episodes(range(10), shares, 0)


def test_too_few_episodes_are_refused():
    """In words of the command, with a number of episodes that is enough."""
    with pytest.raises(DatasetError, match=r"\b2 episodes.*train=0.6 valid=0.2 test=0.2.* 5 episodes are enough"):
        split_episodes(range(2), SHARES, 0)
    assert all(split_episodes(range(5), SHARES, 0)[part] for part in SHARES)


def plain(values: np.ndarray, parts: tuple[Part, ...]) -> tuple[np.ndarray, np.ndarray]:
    """The definition, in two passes."""
    mean, scale = np.zeros(values.shape[1]), np.ones(values.shape[1])
    for part in parts:
        index = list(part.index)
        if part.kind == "invariant":
            mean[index] = values[:, index].mean(axis=0)
        scale[index] = np.sqrt(np.mean((values[:, index] - mean[index]) ** 2))
    return mean, scale


@given(st.integers(0, 1000), st.lists(st.integers(0, 30), min_size=1, max_size=6))
def test_pieces_give_what_the_whole_gives(seed, lengths):
    """Also far from zero, where sums of squares would lose every digit."""
    rng = np.random.default_rng(seed)
    pieces = [rng.normal(1e6 * rng.normal(size=6), 1.0, (length, 6)) for length in lengths]
    whole = np.concatenate(pieces)
    moments = Moments.none(6)
    for piece in pieces:
        moments = moments.and_also(piece)
    assert moments.count == len(whole)
    if len(whole) < 2:
        return
    for found, expected in zip(moments.scaling(WRENCH_PARTS), plain(whole, WRENCH_PARTS), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
    np.testing.assert_array_equal(moments.low, whole.min(axis=0))
    np.testing.assert_array_equal(moments.high, whole.max(axis=0))


@pytest.mark.parametrize("parts", [WRENCH_PARTS, ACTION_PARTS])
def test_scaling_commutes_with_the_group(parts):
    """Turned data have the same statistics, and scaling before or after turning is the same."""
    components = 6 if parts is WRENCH_PARTS else 5
    values = np.random.default_rng(0).normal([3, -2, 5, 1, 0, 4][:components], 2.0, (50, components))
    mean, scale = statistics(values, parts)
    for matrix in dihedral(12):
        turned = act(matrix, values, parts)
        for found, expected in zip(statistics(turned, parts), (mean, scale), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-12)
        np.testing.assert_allclose((turned - mean) / scale, act(matrix, (values - mean) / scale, parts), atol=1e-12)


def test_what_hardly_varies_is_not_scaled_up():
    mean, scale = statistics(np.full((10, 1), 0.7), (Part("invariant", (0,)),))
    np.testing.assert_allclose([mean[0], scale[0]], [0.7, 1.0])


def test_statistics_are_those_of_the_training_episodes(dataset):
    found = compute_statistics(dataset, [0, 2, 3])
    episodes = [dataset.read(index) for index in (0, 2, 3)]
    proprio = np.concatenate([episode.proprio.astype(float) - [0, *episode.centre, 0, 0] for episode in episodes])
    wrench = np.concatenate([episode.wrench.astype(float) - episode.tare for episode in episodes])
    color = np.concatenate([episode.cameras["front"].color.reshape(-1, 3) for episode in episodes]) / 255
    depth = np.concatenate([episode.cameras["front"].depth.reshape(-1, 1) for episode in episodes]) * 1e-4
    channels = tuple(Part("invariant", (channel,)) for channel in range(3))
    for path, values, parts in (
        ("observations/proprio", proprio, STANDARD.at("observations/proprio").parts),
        ("streams/wrench/wrench", wrench, WRENCH_PARTS),
        ("cameras/front/color", color, channels),
        ("cameras/front/depth", depth, channels[:1]),
    ):
        mean, scale = statistics(values, parts)
        np.testing.assert_allclose(found[path].mean, mean, rtol=1e-5, atol=1e-9)
        np.testing.assert_allclose(found[path].scale, scale, rtol=1e-5)
        np.testing.assert_allclose(found[path].min, values.min(axis=0), rtol=1e-5)
        assert found[path].count == len(values)
    assert found["cameras/front/depth"].unit == "m"


def test_pixels_without_depth_do_not_count(dataset):
    arrays = {path: array.copy() for path, array in dataset.read(0).arrays.items()}
    arrays["cameras/front/depth"][:, :4] = 0
    write_episode(Episode(make_episode(0).meta, arrays), dataset.episode_path(0))
    found = compute_statistics(dataset, [0])["cameras/front/depth"]
    assert found.count == (arrays["cameras/front/depth"] > 0).sum()
    assert found.min[0] > 0.3


def test_poses_of_a_camera_that_moves_have_no_mean(tmp_path):
    """Numbers of a rotation and metres are not one quantity."""
    episode = own_episode(0)
    poses = np.repeat(np.eye(4)[None], len(episode.t_ns), axis=0)
    arrays = {path: array for path, array in episode.arrays.items() if path != "cameras/wrist/T_tcp_camera"}
    arrays["cameras/wrist/T_base_camera_per_frame"] = poses
    dataset = Dataset.create_or_resume(tmp_path / "d", "wiping", 0, {})
    write_episode(replace(episode, arrays=arrays), dataset.episode_path(0))
    found = compute_statistics(dataset, [0])
    assert "cameras/wrist/color" in found
    assert "cameras/wrist/T_base_camera_per_frame" not in found


def test_statistics_belong_to_one_split_of_the_same_episodes(dataset):
    split = split_episodes(dataset.indices, SHARES, seed=0)
    split.save(dataset)
    with pytest.raises(DatasetError, match=r"no statistics.*'default'"):
        load_statistics(dataset, split)
    found = compute_statistics(dataset, split["train"])
    save_statistics(dataset, split, found)
    assert load_statistics(dataset, split) == found
    other = Split("default", 1, split.rule, split_episodes(dataset.indices, SHARES, seed=1).parts)
    with pytest.raises(DatasetError, match=r"default\.statistics\.json.*another split"):
        load_statistics(dataset, other)
    write_episode(make_episode(split["test"][0], steps=9), dataset.episode_path(split["test"][0]))
    assert load_statistics(dataset, split) == found  # a test episode changes nothing
    write_episode(make_episode(split["train"][0], steps=9), dataset.episode_path(split["train"][0]))
    with pytest.raises(DatasetError, match=r"default\.statistics\.json.*training episodes"):
        load_statistics(dataset, split)
    statistics_file(dataset, "default").write_text('{"fields": 3}')
    with pytest.raises(FormatError, match=r"default\.statistics\.json.*'svfl-statistics'"):
        load_statistics(dataset, split)
    with pytest.raises(DatasetError, match="no episodes"):
        compute_statistics(dataset, [])
