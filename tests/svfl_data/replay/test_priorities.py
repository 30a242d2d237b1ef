"""Transitions are drawn by their priorities, weights make up for it, and whole episodes make room for new ones."""

import numpy as np
import pytest

from svfl_data.errors import DatasetError, UsageError
from svfl_data.replay import ReplayBuffer
from tests.helpers.replay_episodes import agent_buffer, live_through, make_demo, small, spec_of, store


def counts(buffer: ReplayBuffer, draws: int) -> np.ndarray:
    """How often each transition is drawn."""
    return sum(np.bincount(buffer.sample(64)["index"], minlength=len(buffer)) for _ in range(draws))


def chi_square(found: np.ndarray, share: np.ndarray) -> float:
    """Distance of counts from shares, in standard deviations of its distribution above its mean."""
    expected = share * found.sum()
    freedom = len(found) - 1
    return float((((found - expected) ** 2 / expected).sum() - freedom) / np.sqrt(2 * freedom))


def test_transitions_are_drawn_in_proportion_to_their_priorities():
    buffer = agent_buffer(8, 8, config=small(alpha=0.6))
    errors = np.random.default_rng(0).exponential(1.0, 16) * np.where(np.arange(16) % 2, 1, -1)
    buffer.update_priorities(np.arange(16), errors)
    found = counts(buffer, 40)
    share = (np.abs(errors) + 1e-6) ** 0.6
    assert chi_square(found, share / share.sum()) < 3
    assert chi_square(found, np.full(16, 1 / 16)) > 30  # the liar: as if all were equal
    square = np.abs(errors) / np.abs(errors).sum()
    assert chi_square(found, square) > 30  # the liar: without the power


def test_what_is_new_counts_like_the_largest_error_so_far():
    buffer = agent_buffer(4, config=small(alpha=1.0))
    buffer.update_priorities(np.arange(4), np.array([0.5, -9.0, 0.0, 1.0]))
    live_through(buffer, make_demo(1, 3))
    share = np.array([0.5, 9.0, 1e-6, 1.0, 9.0, 9.0, 9.0]) + 1e-6
    found = counts(buffer, 40)
    assert found[2] == 0
    keep = np.arange(7) != 2
    assert chi_square(found[keep], share[keep] / share[keep].sum()) < 3


def test_experts_have_a_bonus(tmp_path):
    """Priority = (abs(error) + 1e-6 + 1 if expert)^alpha: with errors of zero only demonstrations are drawn."""
    demos = store(tmp_path / "d", make_demo(0, 5))
    buffer = ReplayBuffer.from_demos(demos, 1, config=small(alpha=1.0, expert_bonus=1.0))
    live_through(buffer, make_demo(1, 5))
    buffer.update_priorities(np.arange(10), np.array([0, 0, 0, 0, 0, 1, 1, 2, 2, 3.0]))
    share = np.array([1, 1, 1, 1, 1, 1, 1, 2, 2, 3]) / 14
    batch = buffer.sample(64)
    np.testing.assert_array_equal(batch["expert"], batch["index"] < 5)
    assert chi_square(counts(buffer, 40), share) < 3
    plain = ReplayBuffer.from_demos(demos, 1, config=small(alpha=1.0, expert_bonus=0.0))
    live_through(plain, make_demo(1, 5))
    plain.update_priorities(np.arange(10), np.repeat([0.0, 1.0], 5))
    assert not plain.sample(64)["expert"].any()


def test_weights_undo_the_bias_and_beta_grows_to_one():
    """weight = (size x probability)^-beta / largest of the batch; with beta 1 weighted means are those of all."""
    buffer = agent_buffer(6, 6, config=small(alpha=0.6, beta=0.4, beta_samples=640))
    errors = np.linspace(0.1, 4, 12)
    buffer.update_priorities(np.arange(12), errors)
    priority = (errors + 1e-6) ** 0.6
    for drawn in (0, 64, 128):
        assert buffer.beta == pytest.approx(0.4 + 0.6 * drawn / 640)
        beta = buffer.beta
        batch = buffer.sample(64)
        weight = (12 * priority[batch["index"]] / priority.sum()) ** -beta
        np.testing.assert_allclose(batch["weight"], weight / weight.max(), rtol=1e-6)
    for _ in range(20):
        batch = buffer.sample(64)
    assert buffer.beta == 1
    batches = [buffer.sample(64) for _ in range(60)]
    weight, index = (np.concatenate([batch[name] for batch in batches]) for name in ("weight", "index"))
    assert weight @ errors[index] / weight.sum() == pytest.approx(errors.mean(), abs=0.05)
    assert errors[index].mean() > errors.mean() + 0.3  # the liar: without weights


def test_old_episodes_are_forgotten_whole():
    buffer = agent_buffer(4, 5, capacity=12)
    assert len(buffer) == 9
    batch = buffer.sample(30)
    live_through(buffer, make_demo(2, 6))  # 4 + 5 + 6 > 12: the first goes; 5 + 6 fit
    assert len(buffer) == 11
    assert set(buffer.sample(200)["index"]) == set(range(4, 15))
    buffer.update_priorities(batch["index"], np.full(30, 50.0))  # those of the first episode are left out
    assert np.isin(buffer.sample(200)["index"], batch["index"]).mean() > 0.8
    live_through(buffer, make_demo(3, 12))  # fills it alone
    assert set(buffer.sample(300)["index"]) == set(range(15, 27))
    live_through(buffer, make_demo(4, 1))
    assert len(buffer) == 1
    assert set(buffer.sample(10)["index"]) == {27}


def test_what_is_drawn_after_many_rounds_is_what_was_added_last():
    buffer = ReplayBuffer(20, spec_of(make_demo(0)), small(seed=3))
    rng = np.random.default_rng(0)
    lengths = rng.integers(1, 8, 30).tolist()
    for number, steps in enumerate(lengths):
        live_through(buffer, make_demo(number, steps), rewards=np.full(steps, number))
        kept = [k for k in range(number + 1) if sum(lengths[k : number + 1]) <= 20]
        assert len(buffer) == sum(lengths[k] for k in kept)
        batch = buffer.sample(100)
        assert set(batch["reward"]) <= set(kept)
        begin = np.concatenate([[0], np.cumsum(lengths)])
        np.testing.assert_array_equal(np.searchsorted(begin, batch["index"], side="right") - 1, batch["reward"])
        buffer.update_priorities(batch["index"], rng.exponential(1.0, 100))


def test_wrong_updates_are_refused():
    buffer = agent_buffer(4)
    with pytest.raises(UsageError, match=r"\b3 to 4\b.*\b4\b"):
        buffer.update_priorities(np.array([3, 4]), np.zeros(2))
    with pytest.raises(UsageError, match=r"-1 to -1\b.*\b4\b"):
        buffer.update_priorities(np.array([-1]), np.zeros(1))
    with pytest.raises(UsageError, match=r"\b1 of 2 .*finite"):
        buffer.update_priorities(np.array([0, 1]), np.array([np.nan, 0]))
    with pytest.raises(UsageError, match=r"int64.*\(2,\).*\(3,\).*\(B,\)"):
        buffer.update_priorities(np.array([0, 1]), np.zeros(3))
    buffer.update_priorities(np.array([], np.int64), np.array([]))


def test_an_empty_buffer_says_so():
    buffer = agent_buffer()
    with pytest.raises(DatasetError, match="empty"):
        buffer.sample()
    with pytest.raises(UsageError, match=r"batch_size.*\b0\b.*at least 1\b"):
        buffer.sample(0)
