"""Stacks of images, and turns by any angle: no frame of another episode, and everything of a transition moves alike."""

import numpy as np
import pytest

from svfl_data.replay import ReplayBuffer
from svfl_data.replay.specs.replay_spec import PARTS
from svfl_data.replay.symmetry_augmentation import Between, SymmetryAugmentation, seen
from svfl_data.sampling.samples import Samples
from svfl_data.symmetry import act, act_on_image, dihedral, element
from tests.helpers.lengths import LENGTHS
from tests.helpers.replay_episodes import agent_buffer, live_through, make_demo, small, store

K = 3
NAMES = ("wrench", "proprio", "next_wrench", "next_proprio", "action")


@pytest.fixture
def demos(tmp_path):
    return store(tmp_path / "d", *(make_demo(index, steps) for index, steps in enumerate(LENGTHS)))


@pytest.mark.parametrize("n_step", [1, 2])
def test_a_stack_is_the_latest_frames_of_its_own_episode(demos, n_step):
    """Oldest first, the first repeated before the start; frame by frame what a buffer of single images gives."""
    single = ReplayBuffer.from_demos(demos, 4, config=small(crop=16, n_step=n_step)).sample(100)
    stacked = ReplayBuffer.from_demos(demos, 4, config=small(crop=16, n_step=n_step, frames=K)).sample(100)
    episodes, begin = [demos.read(index) for index in range(4)], np.concatenate([[0], np.cumsum(LENGTHS)])
    for row, number in enumerate(stacked["index"]):
        index = int(np.searchsorted(begin, number, side="right")) - 1
        step, episode = int(number - begin[index]), episodes[index]
        camera = episode.cameras["front"]
        for name, at in (("image", step), ("next_image", min(step + n_step, len(episode)))):
            rows = np.maximum(np.arange(at - K + 1, at + 1), 0)
            color = camera.color[rows].transpose(0, 3, 1, 2) / np.float32(255)
            np.testing.assert_array_equal(
                stacked[name][row], np.concatenate([color, camera.depth_m[rows][:, None]], axis=1)
            )
    for name, values in single.items():
        np.testing.assert_array_equal(stacked[name][:, -1] if "image" in name else stacked[name], values, err_msg=name)


def test_stacks_are_those_of_samples(demos):
    """The same frames in the same order as the datasets for learning from demonstrations have them."""
    batch = ReplayBuffer.from_demos(demos, 4, config=small(crop=16, frames=K)).sample(50)
    others = Samples(demos, frames=K).batch(batch["index"])
    color = others["cameras/front/color"].transpose(0, 1, 4, 2, 3) / np.float32(255)
    np.testing.assert_array_equal(batch["image"][:, :, :3], color)


@pytest.mark.parametrize("augmentation", [4, 8])
def test_all_images_of_a_transition_have_one_crop_and_one_turn(augmentation):
    """In an episode that always shows the same picture, the stacks of s and s' are one picture over and over."""
    arrays = make_demo(0, 5).arrays
    still = {path: np.repeat(arrays[path][:1], 6, axis=0) for path in ("cameras/front/color", "cameras/front/depth")}
    buffer = agent_buffer(config=small(rotate=True, frames=K, group_order=augmentation))
    live_through(buffer, make_demo(0, 5, arrays=still))
    batch = buffer.sample(40)
    both = np.concatenate([batch["image"], batch["next_image"]], axis=1)
    assert both.shape == (40, 2 * K, 4, 12, 12)
    np.testing.assert_array_equal(both, np.broadcast_to(both[:, :1], both.shape))
    assert len({picture.tobytes() for picture in both[:, 0]}) > 20


def test_stacks_take_no_memory():
    assert agent_buffer(5, 9, config=small(frames=K)).nbytes == agent_buffer(5, 9).nbytes


@pytest.mark.parametrize("order", [4, 8, 12])
def test_vectors_are_turned_exactly_whatever_the_angle(demos, order):
    """One element of D_N explains all numbers of s, a and s'; and all elements occur."""
    plain = ReplayBuffer.from_demos(demos, 4, config=small()).sample(300)
    turned = ReplayBuffer.from_demos(demos, 4, config=small(rotate=True, group_order=order)).sample(300)
    fits = {}  # by name, which element explains which sample, (300, 2 * order)
    for name in NAMES:
        wanted = [act(R, plain[name], PARTS[name.removeprefix("next_")]) for R in dihedral(order)]
        close = [np.isclose(values, turned[name], atol=1e-6).reshape(300, -1).all(axis=1) for values in wanted]
        fits[name] = np.stack(close, axis=1)
    assert (fits["wrench"].sum(axis=1) == 1).all()
    assert fits["wrench"].any(axis=0).all()
    for name in NAMES:
        np.testing.assert_array_equal(fits[name], fits["wrench"], err_msg=name)
    for name in ("reward", "discount", "weight", "index", "expert"):
        np.testing.assert_array_equal(plain[name], turned[name])


@pytest.mark.parametrize("size", [5, 6])
def test_quarter_turns_only_reorder_pixels(size):
    """As views that copy nothing; and interpolation at these angles would give the same."""
    image = np.random.default_rng(0).integers(0, 256, (4, size + 3, size + 3)).astype(np.uint16)
    augmentation, crop = SymmetryAugmentation(4), np.s_[:, 1 : 1 + size, 2 : 2 + size]
    for number, (matrix, view) in enumerate(zip(dihedral(4), augmentation._views, strict=True)):
        exact = act_on_image(matrix, image[crop])
        assert np.shares_memory(seen(image, view), image)
        np.testing.assert_array_equal(augmentation.cutter([1, 2], number, (size, size))(image, True), exact)
        between = Between(1, 2, size, matrix)
        np.testing.assert_allclose(between(image[:3], True), exact[:3], atol=1e-4)
        np.testing.assert_array_equal(between(image[3], False), exact[3])


def smooth(size: int) -> np.ndarray:
    """A picture without symmetry that changes little from pixel to pixel, shape (3, size, size), 0..255."""
    y, x = np.mgrid[:size, :size] / size
    waves = [np.sin(3 * x + 2 * y), np.cos(4 * x - y), np.sin(5 * y - x * x)]
    return (127.5 * (1 + np.stack(waves))).astype(np.float32)


@pytest.mark.parametrize("degrees", [30, 45, 101.5])
@pytest.mark.parametrize("flip", [False, True])
def test_a_turn_and_its_inverse_give_the_picture_back(degrees, flip):
    """In the middle, where nothing comes from beyond the border. A turn the other way round does not."""
    size, middle = 48, np.s_[..., 16:32, 16:32]
    picture, matrix = smooth(size), element(degrees, flip)
    there = Between(0, 0, size, matrix)(picture, True)
    back = Between(0, 0, size, matrix.T)(there, True)
    assert np.abs(back[middle] - picture[middle]).max() < 0.5
    assert np.abs(there[middle] - picture[middle]).max() > 20
    liar = Between(0, 0, size, matrix if not flip else element(degrees + 40, flip))(there, True)
    assert np.abs(liar[middle] - picture[middle]).max() > 20


def test_a_spot_goes_where_the_vector_to_it_goes():
    """Counter-clockwise for x right, y up: images and vectors agree on what a turn is."""
    size, right, up = 41, 10, 4
    picture = np.zeros((3, size, size), np.float32)
    picture[:, 20 - up - 1 : 20 - up + 2, 20 + right - 1 : 20 + right + 2] = 255
    for matrix in dihedral(12):
        between = Between(0, 0, size, matrix)
        color, depth = between(picture, True), between(picture[0], False)
        rows, columns = np.nonzero(depth)
        x, y = matrix @ (right, up)
        np.testing.assert_allclose((columns.mean() - 20, 20 - rows.mean()), (x, y), atol=0.5)
        assert color[0, round(20 - y), round(20 + x)] > 200


def test_no_depth_is_invented():
    """Every depth of a turned batch was measured somewhere in the episode."""
    demo = make_demo(0, 5)
    buffer = agent_buffer(config=small(rotate=True, group_order=12))
    live_through(buffer, demo)
    scale = float(demo.cameras["front"].depth_scale)
    units = np.rint(buffer.sample(60)["image"][:, 3] / scale)
    assert np.isin(units, demo.cameras["front"].depth).all()
