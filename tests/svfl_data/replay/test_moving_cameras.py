"""Cameras that move: when a transition is turned, their pictures stay, and the axes of each frame turn with it."""

from dataclasses import replace

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError
from svfl_data.replay import RecordedSpec, ReplayBuffer, ReplayConfig
from svfl_data.sampling.samples import Samples
from svfl_data.schema.input_spec import InputSpec
from svfl_data.symmetry import dihedral
from tests.helpers.own_robot import IMAGE_AXES, moving_episode, own_dataset, own_episode
from tests.helpers.replay_inputs import INPUTS, MOVING, OWN, moving_demo, own_demo, row_of

AXES = [f"{prefix}cameras/{camera}/image_axes" for prefix in ("", "next_") for camera in ("side", "wrist")]
VELOCITY = "observations/tcp_velocity"
WRIST = InputSpec(cameras=("wrist",), frames=2, vectors=(VELOCITY,))


@pytest.fixture(scope="module")
def demos(tmp_path_factory) -> Dataset:
    return MOVING.dataset(tmp_path_factory.mktemp("data") / "d")


def explaining(plain: dict, turned: dict, row: int, base: np.ndarray, order: int) -> set[int]:
    """Elements of D_N, in given axes, that explain how the axes of all frames and a vector of a sample were turned."""
    found = set()
    for number, element in enumerate(dihedral(order)):
        world = base.T @ element @ base
        same = [np.allclose(plain[key][row] @ world.T, turned[key][row], atol=1e-6) for key in AXES if key in plain]
        for key in (VELOCITY, f"next_{VELOCITY}"):
            planar = plain[key][row, :2] @ world.T
            same.append(np.allclose(planar, turned[key][row, :2], atol=1e-6))
        found |= {number} if all(same) else set()
    return found


@pytest.mark.parametrize("order", [4, 8])
def test_one_element_explains_axes_and_vectors_and_the_pictures_stay(demos, order):
    settings = {"crop": 10, "n_step": 2, "group_order": order}
    plain, turned = (MOVING.preload(demos, MOVING.config(rotate=on, **settings)).sample(80) for on in (False, True))
    occurred = set()
    for row in range(80):
        (element,) = explaining(plain, turned, row, IMAGE_AXES, order)
        occurred.add(element)
    assert occurred == set(range(2 * order))
    for key in ("cameras/side/color", "cameras/wrist/color"):
        np.testing.assert_array_equal(plain[key], turned[key])
        np.testing.assert_array_equal(plain[f"next_{key}"], turned[f"next_{key}"])
    signs = {int(np.sign(np.linalg.det(plain["cameras/side/image_axes"][row, 0].astype(float)))) for row in range(80)}
    assert signs == {-1, 1}, "some frames are mirrored before they are turned"


def test_axes_that_stay_explain_nothing(demos):
    """What the law above refuses: a batch whose vectors turn alone."""
    settings = {"crop": 10, "n_step": 2}
    plain, turned = (MOVING.preload(demos, MOVING.config(rotate=on, **settings)).sample(80) for on in (False, True))
    liar = turned | {key: plain[key] for key in AXES}
    explained = sum(bool(explaining(plain, liar, row, IMAGE_AXES, 4)) for row in range(80))
    unturned = sum(np.array_equal(plain[VELOCITY][row], turned[VELOCITY][row]) for row in range(80))
    assert explained == unturned < 40


def test_quarter_turns_are_exact(demos):
    """They only change the places and signs of numbers."""
    plain, turned = (MOVING.preload(demos, MOVING.config(rotate=on, crop=10)).sample(40) for on in (False, True))
    for key in AXES:
        before, after = (np.sort(np.abs(batch[key]), axis=-1) for batch in (plain, turned))
        np.testing.assert_array_equal(before, after)


def test_where_there_is_no_frame_or_pose_the_axes_are_the_identity(demos):
    batch = MOVING.preload(demos, None).sample(60)
    nothing = batch["cameras/side/padding"].all(axis=1)
    assert nothing.any()
    assert (batch["cameras/side/image_axes"][nothing] == np.eye(2)).all()
    assert not batch["cameras/side/color"][nothing].any()
    first = row_of(moving_demo(0), INPUTS, 0)["cameras/wrist/image_axes"]
    assert (first == np.eye(2)).all()


def test_a_camera_that_moves_may_be_alone_and_needs_no_word(tmp_path):
    """Without a camera that stands still, transitions turn in the axes of the base; `invariant` changes nothing."""
    dataset, config = own_dataset(tmp_path / "d", 1, moving_episode), ReplayConfig(crop=None, rotate=True)
    turned = ReplayBuffer.from_demos(dataset, 1, inputs=WRIST, config=config).sample(40)
    named = ReplayBuffer.from_demos(dataset, 1, inputs=WRIST, config=config, invariant=["cameras/wrist"]).sample(40)
    plain = ReplayBuffer.from_demos(dataset, 1, inputs=WRIST, config=replace(config, rotate=False)).sample(40)
    for key in plain:
        np.testing.assert_array_equal(turned[key], named[key], err_msg=key)
    elements = [explaining(plain, turned, row, np.eye(2), 4) for row in range(40)]
    assert set.union(*elements) == set(range(8))
    assert {len(found) for found in elements} == {1}


def test_episodes_with_and_without_poses_are_not_mixed(tmp_path):
    dataset = own_dataset(tmp_path / "d", 2, lambda index: moving_episode(0) if index == 0 else own_episode(1))
    with pytest.raises(DatasetError, match=r"episode_000001\.hdf5[^\n]*$"):
        ReplayBuffer.from_demos(dataset, 2, inputs=WRIST)
    spec, other = (RecordedSpec.of_episode(make(0), WRIST) for make in (moving_episode, own_episode))
    with pytest.raises(DatasetError, match=r"list of cameras that move is \(\), but \('wrist',\) in the buffer"):
        spec.require_equal(other, "the buffer", "the environment")


def test_the_stream_that_poses_follow_from_is_checked_as_what_is_used(tmp_path):
    """By samples too: with times that run backwards, the latest pose before a frame would be any."""
    episode = moving_episode(0)
    backwards = episode.arrays["streams/tcp/t_ns"].copy()
    backwards[3] -= 25_000_000
    arrays = {**episode.arrays, "streams/tcp/t_ns": backwards}
    dataset = own_dataset(tmp_path / "d", 1, lambda index: replace(episode, arrays=arrays))
    for use in (
        lambda inputs: ReplayBuffer.from_demos(dataset, 1, inputs=inputs),
        lambda inputs: Samples(dataset, cameras=inputs.cameras, windows={}, vectors=inputs.vectors),
    ):
        with pytest.raises(DatasetError, match=r"unfit for training[^\n]*streams/tcp/t_ns[^\n]*$"):
            use(WRIST)
        use(replace(WRIST, cameras=("front",)))


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        (lambda axes: axes[0], r"\(2, 2\), expected \(2, 2, 2\)"),
        (lambda axes: axes * np.nan, "not a finite number"),
        (lambda axes: axes * 2, "not orthogonal"),
        (lambda axes: axes[..., :1], r"\(2, 2, 1\), expected \(2, 2, 2\)"),
    ],
)
def test_axes_that_are_none_are_named_and_not_kept(change, facts):
    spec, key = MOVING.spec(moving_demo(0)), "cameras/wrist/image_axes"
    buffer, seen = ReplayBuffer(10, spec, MOVING.config()), row_of(moving_demo(0), INPUTS, 3)
    with pytest.raises(FieldError, match=f"^{key}[^\n]*{facts}[^\n]*$"):
        buffer.begin_episode(seen | {key: change(seen[key])})
    with pytest.raises(FieldError, match=f"^observation: {key} is missing; [^\n]*$"):
        buffer.begin_episode({path: values for path, values in seen.items() if path != key})


def test_which_cameras_move_is_found_in_the_episode():
    assert MOVING.spec(moving_demo(0)).moving == ("side", "wrist")
    assert OWN.spec(own_demo(0)).moving == ()
