"""What a batch holds: the recorded transitions, cut causally, in image-aligned axes, all of them moved together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.replay import ReplayBuffer
from svfl_data.replay.specs.replay_spec import PARTS
from svfl_data.replay.stored_episode import StoredEpisode
from svfl_data.sampling.windows import wrench_window
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act, act_on_image, dihedral
from tests.helpers.lengths import LENGTHS
from tests.helpers.replay_episodes import agent_buffer, live_through, make_demo, small, store

D4 = dihedral(4)


@pytest.fixture
def demos(tmp_path):
    return store(tmp_path / "d", *(make_demo(index, steps) for index, steps in enumerate(LENGTHS)))


def place_of(crop: np.ndarray, whole: np.ndarray) -> tuple[int, int]:
    """The only (row, column) at which a crop (4, h, h) lies in an image (4, H, H)."""
    size, room = crop.shape[-1], whole.shape[-1] - crop.shape[-1] + 1
    found = [
        (top, left)
        for top in range(room)
        for left in range(room)
        if np.array_equal(whole[:, top : top + size, left : left + size], crop)
    ]
    assert len(found) == 1
    return found[0]


def image_of(camera, row: int) -> np.ndarray:
    return np.concatenate([camera.color[row].transpose(2, 0, 1) / np.float32(255), camera.depth_m[row][None]])


@pytest.mark.parametrize("n_step", [1, 3])
def test_the_law_of_batches(demos, n_step):
    """Every entry of every sample, computed from the file as slowly as possible."""
    batch = ReplayBuffer.from_demos(demos, 4, config=small(n_step=n_step, gamma=0.9)).sample(60)
    begin = np.concatenate([[0], np.cumsum(LENGTHS)])
    places = set()
    for row, number in enumerate(batch["index"]):
        index = int(np.searchsorted(begin, number, side="right")) - 1
        episode, step = demos.read(index), int(number - begin[index])
        camera, later = episode.cameras["front"], min(step + n_step, len(episode))
        axes, middle = camera.image_axes, np.array([0, *episode.centre, 0, 0])
        for prefix, at in (("", step), ("next_", later)):
            window, _ = wrench_window(episode, at, 64)
            np.testing.assert_allclose(batch[prefix + "wrench"][row], act(axes, window, WRENCH_PARTS), atol=1e-6)
            proprio = act(axes, episode.proprio[at] - middle, PROPRIO_PARTS)
            np.testing.assert_allclose(batch[prefix + "proprio"][row], proprio, atol=1e-6)
        place = place_of(batch["image"][row], image_of(camera, step))
        assert place == place_of(batch["next_image"][row], image_of(camera, later))  # one crop for s and s'
        places.add(place)
        np.testing.assert_allclose(batch["action"][row], act(axes, episode.action[step], ACTION_PARTS), atol=1e-8)
        over = later == len(episode)  # and then the task was achieved, with the reward 1
        assert batch["discount"][row] == (0 if over else np.float32(0.9**n_step))
        assert batch["reward"][row] == pytest.approx(0.9 ** (len(episode) - 1 - step) if over else 0)
    assert len(places) > 10
    assert set(batch["index"]) == set(range(sum(LENGTHS)))


def test_shapes_and_types(demos):
    batch = ReplayBuffer.from_demos(demos, 4, config=small(window=10)).sample(3)
    shapes = {"image": (4, 12, 12), "wrench": (10, 6), "proprio": (5,)}
    shapes |= {f"next_{name}": shape for name, shape in shapes.items()} | {"action": (5,)}
    scalars = {"reward": "f4", "discount": "f4", "weight": "f4", "index": "i8", "expert": "?"}
    assert batch.keys() == shapes.keys() | scalars.keys()
    for name, shape in shapes.items():
        assert (batch[name].shape, batch[name].dtype) == ((3, *shape), np.float32)
    for name, dtype in scalars.items():
        assert (batch[name].shape, batch[name].dtype) == ((3,), np.dtype(dtype))
    assert batch["expert"].all()


def test_truncation_is_not_termination():
    """The same steps, cut off or at their end: bootstrapped with gamma^n from the last observation, or not at all."""
    for terminated in (False, True):
        buffer = agent_buffer(config=small(n_step=2, gamma=0.5))
        live_through(buffer, make_demo(0, 3), terminated, rewards=[1, 2, 4])
        batch = buffer.sample(40)
        by_step = dict(zip(batch["index"].tolist(), zip(batch["reward"], batch["discount"], strict=True), strict=True))
        last = (0.0, 0.0) if terminated else (0.25, 0.5)
        assert by_step == {0: (2.0, 0.25), 1: (4.0, last[0]), 2: (4.0, last[1])}


@settings(deadline=None, max_examples=100)
@given(
    rewards=st.lists(st.integers(-4, 4), min_size=1, max_size=8),
    n_step=st.integers(1, 10),
    gamma=st.sampled_from([0.0, 0.5, 1.0]),
    terminated=st.booleans(),
)
def test_returns_are_those_of_the_sum_written_out(rewards, n_step, gamma, terminated):
    recorded = StoredEpisode({"reward": np.array(rewards, np.float32)}, terminated, True)
    for step in range(len(rewards)):
        total, factor, at, alive = 0.0, 1.0, step, True
        for _ in range(n_step):
            if at == len(rewards):
                break
            total, factor, at = total + factor * rewards[at], factor * gamma, at + 1
            alive = not (terminated and at == len(rewards))
        assert recorded.outcome(step, gamma ** np.arange(n_step + 1)) == (at, total, factor if alive else 0.0)


def moved(matrix: np.ndarray, batch: dict, name: str, row: int) -> np.ndarray:
    values = batch[name][row]
    parts = PARTS.get(name.removeprefix("next_"))
    return act(matrix, values, parts) if parts else act_on_image(matrix, values)


def test_a_transition_is_turned_as_a_whole(demos):
    """Exactly one element of D4 explains s, a and s' of a sample; what has no direction stays; all elements occur."""
    plain = ReplayBuffer.from_demos(demos, 4, config=small()).sample(64)
    turned = ReplayBuffer.from_demos(demos, 4, config=small(rotate=True)).sample(64)
    names = [prefix + name for prefix in ("", "next_") for name in ("image", "wrench", "proprio")] + ["action"]
    seen = set()
    for row in range(64):
        explains = {
            name: {g for g, R in enumerate(D4) if np.allclose(moved(R, plain, name, row), turned[name][row], atol=1e-6)}
            for name in names
        }
        assert len(explains["image"]) == 1
        for name in names:
            assert explains[name] == explains["image"], name
        seen |= explains["image"]
    assert seen == set(range(8))
    for name in plain.keys() - set(names):
        np.testing.assert_array_equal(plain[name], turned[name])


def test_a_batch_is_nobodys_memory(demos):
    buffer, other = (ReplayBuffer.from_demos(demos, 4, config=small()) for _ in range(2))
    for values in buffer.sample(30).values():
        values[...] = 0
    other.sample(30)
    for (name, values), wanted in zip(buffer.sample(30).items(), other.sample(30).values(), strict=True):
        np.testing.assert_array_equal(values, wanted, err_msg=name)


def test_equal_seeds_are_equal_and_others_are_not(demos):
    def run(seed):
        buffer = ReplayBuffer.from_demos(demos, 4, config=small(rotate=True, seed=seed))
        batches = []
        for _ in range(3):
            batches.append(buffer.sample(8))
            buffer.update_priorities(batches[-1]["index"], batches[-1]["reward"] - 0.5)
        return {name: np.stack([batch[name] for batch in batches]) for name in batches[0]}

    one, same, other = run(1), run(1), run(2)
    for name, values in one.items():
        np.testing.assert_array_equal(values, same[name], err_msg=name)
    assert not np.array_equal(one["index"], other["index"])
    assert not np.array_equal(one["image"], other["image"])
