"""Episodes that come from files or from an agent: kept once and the same, and refused if they do not fit."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, UsageError
from svfl_data.replay import ReplayBuffer, ReplayConfig
from svfl_data.replay.episode_builder import unseen
from svfl_data.schema.action_fields import planar_action
from tests.helpers.replay_episodes import live_through, make_demo, observation, small, spec_of, store


def moved(up: float) -> np.ndarray:
    """A pose of the camera that is higher than that of the demonstrations, [m]."""
    pose = make_demo(0).cameras["front"].T_base_camera.copy()
    pose[2, 3] += up
    return pose


def test_a_file_and_an_agent_that_lived_through_it_give_the_same(tmp_path):
    demo = make_demo(0, 6)
    from_file = ReplayBuffer.from_demos(store(tmp_path / "d", demo), 1, config=small(expert_bonus=0.0))
    rewards = np.zeros(6)
    rewards[-1] = 1
    lived = ReplayBuffer(50_000, spec_of(demo), small(expert_bonus=0.0))
    live_through(lived, demo, rewards=rewards)
    batch, other = from_file.sample(40), lived.sample(40)
    for name in batch.keys() - {"expert"}:
        np.testing.assert_array_equal(batch[name], other[name], err_msg=name)
    assert batch["expert"].all()
    assert not other["expert"].any()


def test_nothing_is_kept_twice(tmp_path):
    """Images once per observation as integers, readings once: within a tenth of what was recorded."""
    demos = [make_demo(index, 20, size=40) for index in range(5)]
    buffer = ReplayBuffer.from_demos(store(tmp_path / "d", *demos), 5, capacity=1000, config=small())
    paths = ["cameras/front/color", "cameras/front/depth", "observations/proprio", "actions/action"]
    raw = sum(demo.arrays[path].nbytes for demo in demos for path in [*paths, "streams/wrench/wrench"])
    assert raw <= buffer.nbytes < 1.1 * raw
    lived = ReplayBuffer(1000, spec_of(demos[0]), small())
    for demo in demos:
        live_through(lived, demo)
    assert lived.nbytes < 1.1 * raw


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(0, 9), min_size=1, max_size=12), st.integers(1, 8), st.integers(0, 10_000))
def test_readings_are_appended_so_that_every_window_is_whole(news, window, seed):
    """Also with readings that repeat, none that are new, and more than a window of them."""
    rng = np.random.default_rng(seed)
    stream = rng.integers(0, 3, (window, 2)).astype(float)
    before, kept = stream, stream
    for new in news:
        stream = np.concatenate([stream, rng.integers(0, 3, (new, 2))])
        now = stream[-window:]
        count = unseen(before, now)
        assert count <= min(new, window)
        kept = np.concatenate([kept, now[window - count :]])
        np.testing.assert_array_equal(kept[-window:], now)
        before = now


def test_only_successful_demonstrations_unless_asked(tmp_path):
    dataset = store(tmp_path / "d", *(make_demo(index, 4, success=index != 1) for index in range(4)))
    assert len(ReplayBuffer.from_demos(dataset, 2, config=small())) == 8
    chosen = ReplayBuffer.from_demos(dataset, [1, 3], config=small())
    assert len(chosen) == 4
    both = ReplayBuffer.from_demos(dataset, [1, 3], config=small(), failures=True)
    batch = both.sample(60)
    last = batch["index"] == 3  # of the failure: no reward, and cut off
    assert (batch["reward"][last] == 0).all()
    assert (batch["discount"][last] == np.float32(0.99)).all()
    assert (batch["reward"][batch["index"] == 7] == 1).all()
    with pytest.raises(DatasetError, match=r"\b4 successful.* of 4 .*\b3\b"):
        ReplayBuffer.from_demos(dataset, 4, config=small())
    with pytest.raises(DatasetError, match=r"\b1 successful.* of 1 .*\b0\b"):
        ReplayBuffer.from_demos(dataset, [1], config=small())


def test_what_cannot_be_preloaded_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"none.*no episodes"):
        ReplayBuffer.from_demos(Dataset.create_or_resume(tmp_path / "none", "picking", 0, {}))
    dataset = store(tmp_path / "d", make_demo(0), make_demo(1))
    with pytest.raises(UsageError, match=r"\b0 episodes.*\b1\b"):
        ReplayBuffer.from_demos(dataset, 0)
    with pytest.raises(UsageError, match=r"\b2 demonstrations.*\b8 steps.*capacity.*\b7\b"):
        ReplayBuffer.from_demos(dataset, 2, capacity=7)
    with pytest.raises(UsageError, match=r"crop.*64 px.*16 x 16 px"):
        ReplayBuffer.from_demos(dataset, 2)
    with pytest.raises(DatasetError, match=r"episode_000000\.hdf5.*no camera wrist.*front"):
        ReplayBuffer.from_demos(dataset, 2, config=small(), camera="wrist")
    with pytest.raises(DatasetError, match=r"episode 7\b.*\b2 episodes.*\b0 to 1\b"):
        ReplayBuffer.from_demos(dataset, [0, 7], config=small())


@pytest.mark.parametrize(
    ("other", "facts"),
    [
        ({"task": "pushing"}, r"episode_000001\.hdf5.*task.*pushing.*picking.*episode 0\b"),
        ({"size": 20}, r"cameras/front/(color|depth).*\(20, 20.*\(16, 16"),
        ({"action": planar_action(0.05, 0.2)}, r"actions/action.*bounds.*0\.05.*0\.025"),
        ({"arrays": {"cameras/front/image_axes": np.eye(2)}}, r"cameras/front/image_axes.*\b1\.0 .*\b0\.0 "),
        (
            {"arrays": {"cameras/front/depth_scale": np.array(1e-3)}},
            r"cameras/front/depth_scale.*\b0\.001 .*\b0\.0001 ",
        ),
        (
            {"arrays": {"cameras/front/T_base_camera": moved(0.01)}},
            r"cameras/front/T_base_camera.*\b0\.21.*\b0\.2 ",
        ),
        (
            {"arrays": {"cameras/front/intrinsics": np.diag([2.0, 2.0, 1.0])}},
            r"cameras/front/intrinsics.*\b2\.0 .*\b20\.0 ",
        ),
    ],
)
def test_episodes_of_different_kinds_are_not_mixed(tmp_path, other, facts):
    with pytest.raises(DatasetError, match=facts):
        ReplayBuffer.from_demos(store(tmp_path / "d", make_demo(0), make_demo(1, **other)), 2, config=small())


def test_what_shows_another_view_is_refused_before_anything_is_kept(tmp_path):
    demo = make_demo(0)
    buffer = ReplayBuffer.from_demos(store(tmp_path / "d", demo), 1, config=small())
    buffer.begin_episode(observation(demo, 0), spec=spec_of(demo))
    above = replace(spec_of(demo), view="top, seen from 0.5 m")
    with pytest.raises(DatasetError, match=r"environment.*view.*top, seen from 0\.5 m.*camera"):
        buffer.begin_episode(observation(demo, 0), spec=above)


def test_a_number_may_be_numpys_and_no_episode_counts_twice(tmp_path):
    dataset = store(tmp_path / "d", make_demo(0), make_demo(1))
    config = small(crop=np.int64(10))
    buffer = ReplayBuffer.from_demos(dataset, np.int64(2), capacity=np.int64(20), config=config)
    assert len(buffer) == len(ReplayBuffer.from_demos(dataset, np.array([1, 0]), config=config)) == 8
    buffer.save(tmp_path / "b.replay")
    assert ReplayBuffer.load(tmp_path / "b.replay").config == config
    with pytest.raises(UsageError, match=r"episode 1\b.*expert_bonus"):
        ReplayBuffer.from_demos(dataset, [0, 1, np.int64(1)], config=config)


def test_missing_depth_is_named(tmp_path):
    demo = make_demo(0, arrays={"cameras/front/depth": None})
    with pytest.raises(FieldError, match=r"episode_000000\.hdf5.*front.*\bdepth$"):
        ReplayBuffer.from_demos(store(tmp_path / "d", demo), 1, config=small())


def test_an_action_beyond_the_bounds_is_refused_and_nothing_kept(tmp_path):
    demo = make_demo(0)
    buffer = ReplayBuffer(10, spec_of(demo), small())
    buffer.begin_episode(observation(demo, 0))
    for column, value, facts in (
        (0, -1.0, r"opening.*-1\b.*\b0 to 1\b"),
        (2, 0.03, r"dy.*\b0\.03 m.*-0\.025 to 0\.025 m"),
        (4, -0.3, r"dtheta.*-0\.3 rad.*-0\.2 to 0\.2 rad"),
    ):
        action = demo.action[0].copy()
        action[column] = value
        with pytest.raises(FieldError, match=f"action.*{facts}"):
            buffer.add(action, observation(demo, 1), 0.0, False, False)
    buffer.add(demo.action[0], observation(demo, 1), 0.0, True, False)
    assert len(buffer) == 1


def test_clocks_that_cannot_be_trusted_are_named(tmp_path):
    times = make_demo(0).wrench_t_ns.copy()
    times[7] = 0
    dataset = store(tmp_path / "back", make_demo(0, arrays={"streams/wrench/t_ns": times}))
    with pytest.raises(DatasetError, match=r"\b1 of 1 .*episode_000000\.hdf5.*streams/wrench/t_ns\[7\].*backward"):
        ReplayBuffer.from_demos(dataset, 1, config=small())
    late = make_demo(0).cameras["front"].t_ns + 1
    dataset = store(tmp_path / "late", make_demo(0, arrays={"cameras/front/t_ns": late}))
    with pytest.raises(DatasetError, match=r"episode_000000\.hdf5.*front.*no frame"):
        ReplayBuffer.from_demos(dataset, 1, config=small())


def test_what_an_agent_cannot_add_is_named_and_not_kept():
    demo = make_demo(0)
    seen = observation(demo, 0)
    buffer = ReplayBuffer(3, spec_of(demo), small())
    with pytest.raises(UsageError, match="begin_episode"):
        buffer.add(demo.action[0], seen, 0.0, False, False)
    with pytest.raises(FieldError, match=r"wrench.*image, proprio"):
        buffer.begin_episode({name: value for name, value in seen.items() if name != "wrench"})
    with pytest.raises(FieldError, match=r"image.*\(4, 8, 8\).*\(4, 16, 16\)"):
        buffer.begin_episode(seen | {"image": seen["image"][:, :8, :8]})
    with pytest.raises(FieldError, match=r"image.*\b510\b.*\b0 to 255\b"):
        buffer.begin_episode(seen | {"image": np.full((4, 16, 16), 2.0)})
    buffer.begin_episode(seen)
    buffer.begin_episode(seen)  # nothing has happened since the reset
    with pytest.raises(FieldError, match=r"action.*\(4,\).*\(5,\)"):
        buffer.add(demo.action[0][:4], seen, 0.0, False, True)
    with pytest.raises(FieldError, match=r"proprio.*float32.*finite"):
        buffer.add(demo.action[0], seen | {"proprio": np.full(5, np.nan, np.float32)}, 0.0, False, True)
    with pytest.raises(FieldError, match=r"reward.*finite"):
        buffer.add(demo.action[0], seen, np.inf, False, True)
    assert len(buffer) == 0
    for _ in range(3):
        buffer.add(demo.action[0], seen, 0.0, False, False)
    with pytest.raises(UsageError, match=r"\b3 steps.*terminated or truncated"):
        buffer.begin_episode(seen)
    with pytest.raises(UsageError, match=r"\b3 steps.*capacity"):
        buffer.add(demo.action[0], seen, 0.0, False, False)


@pytest.mark.parametrize(
    ("setting", "facts"),
    [
        ({"n_step": 0}, r"n_step.*\b0\b.*at least 1\b"),
        ({"frames": 0}, r"frames.*\b0\b.*at least 1\b"),
        ({"group_order": 2.5}, r"group_order.*\b2\.5\b.*at least 1\b.*whole"),
        ({"seed": -1}, r"seed.*-1\b.*at least 0\b"),
        ({"gamma": 1.5}, r"gamma.*\b1\.5\b.*\b0 to 1\b"),
        ({"alpha": -0.1}, r"alpha.*-0\.1\b.*\b0 to 1\b"),
        ({"expert_bonus": float("nan")}, r"expert_bonus.*\bnan\b.*\b0\b"),
    ],
)
def test_settings_out_of_range_are_named(setting, facts):
    with pytest.raises(UsageError, match=facts):
        ReplayConfig(**setting)


def test_it_says_what_it_is(tmp_path):
    buffer = ReplayBuffer.from_demos(store(tmp_path / "d", make_demo(0)), 1, capacity=100, config=small())
    live_through(buffer, make_demo(1))
    assert repr(buffer) == (
        "ReplayBuffer(picking: 8 of 100 transitions in 2 episodes, 4 of experts, 0.0 MB, beta 0.400)"
    )
