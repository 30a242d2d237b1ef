"""Perturbed demonstrations: what was meant is kept beside what was done, and the way back is shown."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from collectors.sources.expert import ExpertCollector
from collectors.sources.perturbations import LONGEST, Perturbed
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.sampling.samples import ACTION, Samples
from svfl_data.storage.store import episode_bytes, write_episode
from tests.helpers.collecting import collect
from tests.helpers.collectors import SMALL

pytestmark = pytest.mark.slow

BOUND = np.array([0.025, 0.025, 0.025, np.pi / 16])


def perturbed(moves, rate, seed=0):
    policy = Perturbed(iter(moves), BOUND, rate, np.random.default_rng(seed))
    done = []
    while (action := policy(None)) is not None:
        done.append(action)
    return np.array(done), np.array(policy.expert_action)


def drift(count):
    """Moves along x with an open gripper."""
    return [np.array([1, 0.01, 0, 0, 0], np.float32) for _ in range(count)]


@given(rate=st.floats(0, 1), seed=st.integers(0, 99))
def test_intentions_are_kept_and_perturbations_stay_within_the_bounds(rate, seed):
    done, meant = perturbed(drift(40), rate, seed)
    np.testing.assert_array_equal(meant, drift(40))
    assert done.dtype == meant.dtype == np.float32
    assert (np.abs(done[:, 1:]) <= BOUND + 1e-7).all()
    np.testing.assert_array_equal(done[:, 0], meant[:, 0])


def test_perturbations_begin_as_often_as_asked_and_last_as_long():
    done, meant = perturbed(drift(20_000), 0.1)
    pushed = (done != meant).any(axis=1)
    begins = pushed & np.r_[True, (done[1:] != done[:-1]).any(axis=1)]
    length = (1 + LONGEST) / 2
    assert pushed.mean() == pytest.approx(begins.mean() * length, rel=0.03)
    assert begins.mean() == pytest.approx(1 / (1 / 0.1 + length - 1), rel=0.05)  # none begins during another
    assert np.abs(done[pushed, 1:].mean(axis=0) / BOUND).max() < 0.05


def test_without_perturbations_nothing_is_drawn_or_changed():
    done, meant = perturbed(drift(30), 0.0)
    np.testing.assert_array_equal(done, meant)


def test_a_resting_gripper_is_left_alone():
    rest = [np.array([0, 0, 0, 0, 0], np.float32) for _ in range(50)]
    done, meant = perturbed(rest, 1.0)
    np.testing.assert_array_equal(done, meant)


@pytest.fixture(scope="module")
def demonstration():
    collector = ExpertCollector(0, "block_picking", perturbations=0.2, world=SMALL)
    yield collector(0)
    collector.opened.close()


def test_the_expert_still_succeeds_and_says_what_it_meant(demonstration):
    assert demonstration.meta.success
    assert demonstration.meta.config["perturbations"] == 0.2
    assert check_episode(demonstration) == []
    pushed = (demonstration.action != demonstration.expert_action).any(axis=1)
    assert 0 < pushed.sum() < len(pushed) / 2
    np.testing.assert_array_equal(demonstration.action[:, 0], demonstration.expert_action[:, 0])


def test_the_command_gives_the_same_bytes(demonstration, tmp_path):
    arguments = ("expert", "--task", "block_picking", "--episodes", 1, "--image-size", 16, "--perturb", 0.2)
    done = collect(*arguments, "--out", tmp_path / "data")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "data" / "episode_000000.hdf5").read_bytes() == episode_bytes(demonstration)


def test_samples_give_what_was_meant_if_asked(demonstration, tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "data", "block_picking", 0, {})
    write_episode(demonstration, dataset.episode_path(0))
    for expert_action, expected in ((False, demonstration.action), (True, demonstration.expert_action)):
        found = Samples(dataset, expert_action=expert_action).batch(range(len(demonstration)))[ACTION][:, 0]
        np.testing.assert_array_equal(found, expected)


def test_demonstrations_without_intentions_mean_what_they_did(tmp_path, demonstration):
    plain = type(demonstration)(
        demonstration.meta,
        {name: values for name, values in demonstration.arrays.items() if "expert_action" not in name},
    )
    dataset = Dataset.create_or_resume(tmp_path / "data", "block_picking", 0, {})
    write_episode(plain, dataset.episode_path(0))
    found = Samples(dataset, expert_action=True).batch(range(len(plain)))[ACTION][:, 0]
    np.testing.assert_array_equal(found, plain.action)


def test_a_probability_is_a_probability():
    done = collect("expert", "--task", "block_picking", "--perturb", "2", "--out", "x")
    assert done.returncode == 2
    assert re.search("--perturb.* '2' .*0 and 1", done.stderr)
