"""What a policy learns from: everything that was known before an action, in image-aligned axes, nothing else."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, TrainingError
from svfl_data.sampling.windows import wrench_window
from svfl_data.schema.action_fields import expert, planar_action
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_models.cloning.acting import ActingPolicy
from svfl_models.cloning.config import VIEWS, CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.deployment_spec import deployment_of
from svfl_models.cloning.gripper_view import JITTER
from svfl_models.networks.policy import Policy
from tests.helpers.builders import IMAGE_AXES
from tests.helpers.demonstrations import demonstration, demonstrations, write

pytestmark = pytest.mark.slow

CONFIG = CloningConfig(data="", episodes=6, preset="tiny", view="camera", image_size=8, valid=1 / 3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return demonstrations(tmp_path_factory.mktemp("data") / "picking")


def data_of(folder, **choices):
    return CloningData(replace(CONFIG, data=str(folder), **choices))


def test_a_batch_is_what_was_known_and_what_was_done_then(folder):
    part = data_of(folder).valid_set
    batch, row = part.batch(list(range(len(part)))), 0
    for index in part.samples.episodes:
        episode = Dataset.open(folder).read(index)
        for step in range(len(episode)):
            window, _ = wrench_window(episode, step)
            proprio = episode.proprio[step] - [0, 0.55, 0, 0, 0]
            expected = {
                "wrench": act(IMAGE_AXES, window, WRENCH_PARTS),
                "proprio": act(IMAGE_AXES, proprio, PROPRIO_PARTS),
                "action": act(IMAGE_AXES, episode.action[step], ACTION_PARTS),
                "image": np.concatenate(
                    [episode.arrays["cameras/front/color"][step].transpose(2, 0, 1) / 255,
                     episode.arrays["cameras/front/depth"][step][None] * 1e-4]
                )[:, 1:9, 1:9],
            }  # fmt: skip
            for name, values in expected.items():
                np.testing.assert_allclose(batch[name][row], values, atol=1e-6, err_msg=name)
            row += 1
    assert row == len(part)
    assert {name: values.dtype for name, values in batch.items()} == dict.fromkeys(batch, torch.float32)


@pytest.mark.parametrize("view", VIEWS)
def test_acting_sees_what_was_learned_from(folder, view):
    """What collectors give, in base axes, becomes what the network learned from, and its actions come back."""
    data = data_of(folder, view=view)
    part, policy = data.valid_set, Policy("vfp", "none", "wide", 8).eval()
    batch, row = part.batch(list(range(len(part)))), 0
    free = ActingPolicy(policy, replace(data.deployment, switch=False), view).eval()
    with torch.no_grad():
        expected = act(IMAGE_AXES.T, policy(batch).mode.numpy(), ACTION_PARTS)
        for index in part.samples.episodes:
            episode = Dataset.open(folder).read(index)
            for step in range(len(episode)):
                color, depth = (episode.arrays[f"cameras/front/{name}"][step] for name in ("color", "depth"))
                image = np.concatenate([color.transpose(2, 0, 1) / np.float32(255), depth[None] * np.float32(1e-4)])
                seen = (image, wrench_window(episode, step)[0], episode.proprio[step])
                (action,) = free(*(torch.from_numpy(values[None].astype(np.float32)) for values in seen))
                np.testing.assert_allclose(action, expected[row], atol=1e-6)
                row += 1
    assert np.ptp(expected, axis=0).min() > 0


def test_the_gripper_is_in_the_middle(tmp_path):
    """A mark on the table below the TCP, wherever that is, is seen at the middle of the crop, whatever its height."""
    episode = demonstration(size=32)
    matrix = np.array([[60.0, 0, 0, -17.5], [0, -60.0, 0, 15.5], [0, 0, 0, 1]])  # straight from above, far away
    camera = {"intrinsics": np.diag([60.0, 60.0, 1.0]), "T_base_camera": np.diag([1.0, -1.0, -1.0, 1.0])}
    camera["intrinsics"][:2, 2], camera["T_base_camera"][:3, 3] = 15.5, (0.55, 0, 0.99)  # one metre above the table
    proprio, color = episode.proprio.copy(), np.zeros_like(episode.arrays["cameras/front/color"])
    proprio[:, 1:3] = np.array([0.55, 0.0]) + np.linspace([-0.2, 0.1], [0.2, -0.1], len(proprio))
    for step, (x, y) in enumerate(proprio[:, 1:3]):
        column, row = matrix[:2] @ [x, y, -0.01, 1]
        color[step, round(row), round(column)] = 255
    folder = write(tmp_path / "marked", [changed(episode, proprio=proprio, color=color, **camera)] * 4)
    data = data_of(folder, view="gripper", episodes=4)
    for part, off in ((data.valid_set, 0), (data.train_set, JITTER)):
        image = part.batch(list(range(len(part))))["image"][:, :3].mean(dim=1).flatten(1)
        places = image.argmax(dim=1)
        assert (image.amax(dim=1) > image.median(dim=1).values).all()
        assert (torch.stack([places // 8, places % 8]) - 3.5).abs().max() <= 0.5 + off


def test_images_wait_as_they_were_recorded(folder):
    images = data_of(folder).train_set.samples._images
    assert {frames.memory.dtype for frames in images.values()} == {np.dtype("uint8"), np.dtype("uint16")}


def test_only_successes_are_learned_from_and_whole_episodes_held_out(tmp_path):
    folder = write(tmp_path / "mixed", [demonstration(index, success=index % 2 == 1) for index in range(14)])
    data = data_of(folder)
    learned, held_out = set(data.train_set.samples.episodes), set(data.valid_set.samples.episodes)
    assert learned | held_out == {1, 3, 5, 7, 9, 11}
    assert not learned & held_out
    assert len(held_out) == 2
    assert set(data_of(folder, seed=1).valid_set.samples.episodes) != held_out


def test_what_is_random_depends_on_seed_epoch_and_step_only(folder):
    first, again = (data_of(folder).train_set for _ in range(2))
    keys, count = [3, 4, 5], len(first)
    torch.rand(1)
    state = torch.get_rng_state()
    image = first.batch(keys)["image"]
    assert torch.equal(torch.get_rng_state(), state)
    assert torch.equal(image, again.batch(keys)["image"])
    assert not torch.equal(image, first.batch([key + count for key in keys])["image"])
    assert not torch.equal(image, data_of(folder, seed=1).train_set.batch(keys)["image"])
    epochs = [[batch["action"] for batch in loader] for loader in (again.loader(4), first.loader(4)) for _ in range(2)]
    assert all(torch.equal(a, b) for a, b in zip(epochs[0], epochs[2], strict=True))
    assert not torch.equal(torch.cat(epochs[0]), torch.cat(epochs[1]))


def test_the_switch_leaves_the_papers_crops(folder):
    """Without augmentation every image is a part of the recorded one."""
    part, keys = data_of(folder, augment=False).train_set, list(range(8))
    recorded = part.samples.batch(keys)["cameras/front/color"][:, 0] / np.float32(255)
    image = part.batch(keys)["image"].numpy()
    places = []
    for one, whole in zip(image, recorded.transpose(0, 3, 1, 2), strict=True):
        fits = [(r, c) for r in range(3) for c in range(3) if np.allclose(one[:3], whole[:, r : r + 8, c : c + 8])]
        assert len(fits) == 1
        places += fits
    assert len(set(places)) > 1
    assert not np.allclose(data_of(folder).train_set.batch(keys)["image"], image)


def test_a_policy_without_eyes_reads_no_images(folder):
    data = data_of(folder, encoder="f")
    assert "image" not in next(iter(data.train_dataloader()))
    assert not data.train_set.samples._images


def changed(episode, **arrays):
    """An episode with other arrays, by the last part of their path; None takes one away."""
    declarations = arrays.pop("declarations", episode.declarations)
    found = dict(episode.arrays)
    for path in episode.arrays:
        name = path.rpartition("/")[2]
        if name in arrays:
            found[path] = arrays[name]
            if arrays[name] is None:
                del found[path]
    return Episode(episode.meta, found, declarations=declarations)


def far(episode):
    action = episode.action.copy()
    action[2, 3] = 0.05
    return changed(episode, action=action)


def slow(episode):
    found = dict(episode.arrays)
    found |= {path: 2 * values for path, values in found.items() if path.endswith("t_ns")}
    return Episode(episode.meta, found)


def sparse(episode):
    """The same with every fifth reading of the wrench."""
    rows = {path: episode.arrays[path][::5] for path in ("streams/wrench/t_ns", "streams/wrench/wrench")}
    return Episode(episode.meta, episode.arrays | rows)


@pytest.mark.parametrize(
    ("odd", "facts"),
    [
        (
            lambda one: Episode(replace(one.meta, task="mug_picking"), one.arrays),
            "task mug_picking.* episode 0 .*block_picking",
        ),
        (lambda one: changed(one, image_axes=np.eye(2)), r"episode 3 .*image_axes \[\[1\.0, 0\.0\], \[0\.0, 1\.0\]\]"),
        (lambda one: changed(one, workspace=one.workspace + 0.1), r"episode 3 .*centre \[0\.65, 0\.1\]"),
        (slow, r"episode 3 .*step_ms 100\.0.* episode 0 .*50\.0"),
        (sparse, r"episode 0 has wrench readings at 500 Hz, episode 3 at 100 Hz"),
        (
            far,
            r"1 of 6 episodes.* actions/action\[2\]: dz .*0\.05 m.* -0\.025 to 0\.025 m",
        ),
        (lambda _: demonstration(3, size=12), "episode 3 .*image_side 12.* episode 0 .*10"),
    ],
)
def test_demonstrations_of_different_things_are_refused(odd, facts, tmp_path):
    episodes = [demonstration(index) for index in range(6)]
    folder = write(tmp_path / "odd", [*episodes[:3], odd(episodes[3]), *episodes[4:]])
    with pytest.raises(DatasetError, match=facts):
        data_of(folder)


def at_rate(episode, factor):
    """The same with a clock that runs slower."""
    found = dict(episode.arrays)
    found |= {path: (factor * values).astype(np.int64) for path, values in found.items() if path.endswith("t_ns")}
    return Episode(episode.meta, found)


def test_a_policy_knows_the_rate_of_the_wrench_that_it_takes(folder, tmp_path):
    """The declared one, or else the one that was recorded."""
    for encoder, expected in (("vfp", 500.0), ("f", 500.0), ("vp", 0.0)):
        assert data_of(folder, encoder=encoder).deployment.wrench_hz == pytest.approx(expected)
    rare = write(tmp_path / "rare", [sparse(demonstration(index)) for index in range(6)])
    assert data_of(rare).deployment.wrench_hz == pytest.approx(100)
    declared = [demonstration(index) for index in range(6)]
    for one in declared:
        one.meta.config["rates_hz"] = {"streams/wrench": 505.0}
    assert data_of(write(tmp_path / "declared", declared)).deployment.wrench_hz == 505


def test_uneven_control_periods_are_said_and_change_nothing(tmp_path, capsys):
    """A loaded machine: steps of 50 to 65 ms. A policy is told no times, so it learns the same."""
    even = [demonstration(index) for index in range(6)]
    uneven = [at_rate(one, 1 + 0.06 * index) for index, one in enumerate(even)]
    data = [data_of(write(tmp_path / name, some)) for name, some in (("even", even), ("uneven", uneven))]
    assert "50.0 to 65.0 ms" in capsys.readouterr().err
    batches = [one.train_set.batch(range(len(one.train_set))) for one in data]
    assert all(torch.equal(values, batches[1][name]) for name, values in batches[0].items())
    assert data[1].deployment.step_ms == pytest.approx(57.5)


def test_the_bounds_of_actions_are_those_of_the_declaration(tmp_path):
    """An own robot that moves 100 mm a step: the network's bounds, the paper's, stand for its own."""
    own = planar_action(max_move=0.1, max_turn=0.5)
    factor = np.array([1, 4, 4, 4, 0.5 / (np.pi / 16)], np.float32)
    episodes = [demonstration(index) for index in range(6)]
    declared = Declarations([own, expert(own)])
    wide = [
        changed(one, declarations=declared, action=one.action * factor, expert_action=one.action * factor)
        for one in episodes
    ]
    data = [data_of(write(tmp_path / name, some)) for name, some in (("paper", episodes), ("own", wide))]
    batches = [one.valid_set.batch(range(len(one.valid_set))) for one in data]
    torch.testing.assert_close(batches[0]["action"], batches[1]["action"])
    policy = Policy("vfp", "none", "wide", 8).eval()
    inputs = torch.rand(3, 4, 10, 10), torch.randn(3, 64, 6), torch.rand(3, 5)
    with torch.no_grad():
        said = [ActingPolicy(policy, replace(one.deployment, switch=False), "camera").eval()(*inputs) for one in data]
    torch.testing.assert_close(said[0] * torch.from_numpy(factor), said[1])
    with pytest.raises(DatasetError, match=r"episode 5 .*max_move 0\.1\b.* episode 0 .*0\.025"):
        data_of(write(tmp_path / "mixed", [*episodes[:5], wide[5]]))


def test_missing_fields_are_named(tmp_path):
    folder = write(tmp_path / "flat", [changed(demonstration(index), depth=None) for index in range(6)])
    with pytest.raises(FieldError, match=r"cameras/front/depth\b"):
        data_of(folder)
    with pytest.raises(DatasetError, match=r"no camera top.*front"):
        data_of(demonstrations(tmp_path / "front"), camera="top")


def test_too_few_episodes_and_too_small_images(folder, tmp_path):
    with pytest.raises(DatasetError, match=r" 50 successful episodes.* 6 among 6"):
        data_of(folder, episodes=50)
    with pytest.raises(DatasetError, match=r" 1 episode\b"):
        data_of(folder, episodes=1)
    with pytest.raises(DatasetError, match=r"\b2 episodes .*split"):
        data_of(folder, episodes=2, valid=0.1)
    with pytest.raises(TrainingError, match=r"10 x 10 .*64 x 64"):
        data_of(folder, image_size=64)


def test_a_gripper_that_is_half_open_is_no_switch(folder, tmp_path):
    dataset = Dataset.open(folder)
    assert deployment_of(dataset, dataset.indices).switch
    half = demonstration(1)
    action = half.action * np.array([0.5, 1, 1, 1, 1], np.float32)
    episodes = [demonstration(0), changed(half, action=action), demonstration(2)]
    other = Dataset.open(write(tmp_path / "half", episodes))
    assert not deployment_of(other, other.indices).switch
