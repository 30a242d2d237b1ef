import dataclasses

import numpy as np
import pytest
import torch

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.maintenance.relabel import relabel, with_annotation
from svfl_data.sampling.split import split_episodes
from svfl_data.sampling.windows import wrench_window
from svfl_data.schema.action_fields import expert, planar_action
from svfl_data.schema.declarations import Declarations
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.data import Leg, Sequences, fit, sequences_of
from svfl_models.latent.inputs import Inputs
from svfl_models.latent.labels import pressed, rewards, touched
from svfl_models.latent.recordings import load_recordings
from tests.helpers.latent_small import LIFT_FROM, lifting, written


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return written(tmp_path_factory.mktemp("data") / "picking", [lifting(index) for index in range(6)])


def wider(index):
    action = planar_action(0.05, 0.2)
    return dataclasses.replace(lifting(index), declarations=Declarations([action, expert(action)]))


def config(folder, **changed):
    return LatentConfig(str(folder), "poe", sequence=4, **changed)


def test_a_sequence_is_what_the_episode_holds(folder):
    episode, (one, *_) = Dataset.open(folder).read(0), load_recordings(Dataset.open(folder), 0.5)
    sequences = Sequences([one], 4, random=False)
    assert len(sequences) == len(episode) - 3
    batch, camera = sequences[[2, 6]], episode.cameras["front"]
    for row, start in enumerate((2, 6)):
        assert batch["step"][row].tolist() == list(range(start, start + 5))
        for frame in range(5):
            window, _ = wrench_window(episode, start + frame)
            expected = act(camera.image_axes, window, WRENCH_PARTS)
            torch.testing.assert_close(batch["wrench"][row, frame], torch.from_numpy(expected))
        gripper = episode.proprio[start : start + 5].copy()
        gripper[:, 1:3] -= episode.centre
        np.testing.assert_allclose(batch["proprio"][row], act(camera.image_axes, gripper, PROPRIO_PARTS), rtol=1e-6)
        action = act(camera.image_axes, episode.action[start : start + 4], ACTION_PARTS)
        np.testing.assert_allclose(batch["action"][row], action, rtol=1e-6)
        color = camera.color[start : start + 5, 6:70, 6:70]
        np.testing.assert_allclose(batch["image"][row, :, :3], color.transpose(0, 3, 1, 2) / 255, rtol=1e-6)
        np.testing.assert_array_equal(batch["image"][row, :, 3], camera.depth_m[start : start + 5, 6:70, 6:70])
    assert batch["reward"].tolist() == [[0, 0, 0, 0], [0, 0, 0, 1]]
    assert batch["terminated"].tolist() == [[False] * 4, [False] * 3 + [True]]
    assert batch["next_contact"].tolist() == [[0, 0, 0, 0], [0, 1, 1, 1]]  # it moves from step 7 on
    assert batch["touching"][1].tolist() == [False, False, True, True, True]


@pytest.mark.parametrize("late_ms", [190, 230])
def test_a_window_at_the_start_has_what_was_felt_so_far(tmp_path, late_ms):
    episode = lifting(0)
    clock = episode.arrays["streams/wrench/t_ns"] + late_ms * 1_000_000
    late = dataclasses.replace(episode, arrays=episode.arrays | {"streams/wrench/t_ns": clock})
    (one,) = load_recordings(Dataset.open(written(tmp_path / "data", [late])), 0.5)
    axes = episode.cameras["front"].image_axes
    for step in range(3):
        window, padding = wrench_window(late, step)
        np.testing.assert_array_equal(one.wrench[step], act(axes, window, WRENCH_PARTS))
        assert padding.any() == (clock[0] + 63 * 2_000_000 > late.t_ns[step])


def test_all_frames_of_a_sequence_share_their_crop_and_passes_differ(folder):
    (one, *_) = load_recordings(Dataset.open(folder), 0.5)
    marked = np.zeros((11, 76, 76, 3), np.uint8)
    marked[..., 0], marked[..., 1] = np.arange(76)[:, None], np.arange(76)
    sequences = Sequences([dataclasses.replace(one, color=marked)], 4, random=True)
    corner = sequences[[*range(7), *range(7, 14)]]["image"][:, :, :2, 0, 0]
    assert (corner == corner[:, :1]).all()
    assert not torch.equal(corner[:7], corner[7:])
    assert torch.equal(corner, sequences[list(range(14))]["image"][:, :, :2, 0, 0])  # a key decides
    assert float(corner.max()) * 255 < 12.5


def test_training_and_validation_share_no_episode(folder):
    train, valid, split = sequences_of(config(folder))
    trained, held_out = (set(one[list(range(len(one)))]["episode"].tolist()) for one in (train, valid))
    assert trained == set(split["train"])
    assert held_out == set(split["valid"])
    assert not trained & held_out
    assert len(trained | held_out) == 6
    assert sequences_of(config(folder, seed=5))[2] == split  # whatever the seed of the training


def test_a_stored_split_is_used(tmp_path):
    folder = written(tmp_path / "data", [lifting(index) for index in range(4)])
    stored = split_episodes(range(4), {"train": 0.5, "test": 0.5}, 3, "mine")
    stored.save(Dataset.open(folder))
    train, valid, _ = sequences_of(config(folder, split="mine"))
    assert [one.index for one in train.recordings] == stored["train"]
    assert [one.index for one in valid.recordings] == stored["test"]


def test_legs_laid_end_to_end_are_one_training():
    whole = list(Leg(10, 4, 0, range(9)))
    assert whole == [*Leg(10, 4, 0, range(4)), *Leg(10, 4, 0, range(4, 9))]
    keys = [key for batch in whole for key in batch]
    assert sorted(key % 10 for key in keys[:30]) == sorted(3 * list(range(10)))  # every sequence once per pass
    assert [key // 10 for key in keys] == [position // 10 for position in range(36)]
    assert whole != list(Leg(10, 4, 1, range(9)))


def test_labels():
    episode = lifting(0)
    force = np.linalg.norm(episode.tared_wrench[:, :3], axis=1)
    assert force[-25:].min() > 15 > 0.5 > force[:-25].max()
    assert pressed(episode, 15.0).tolist() == [False] * 10 + [True]
    assert not pressed(episode, 25.0).any()
    assert touched(episode, annotated=False).tolist() == [False] * LIFT_FROM + [True] * 3
    assert rewards(episode).tolist() == [0.0] * 9 + [1.0]
    assert not rewards(lifting(0, success=False)).any()


def test_annotated_contacts_come_before_the_object(tmp_path):
    folder = written(tmp_path / "data", [lifting(index) for index in range(2)])
    first = Dataset.open(folder).read(0).t_ns
    relabel(Dataset.open(folder), 0, with_annotation("contact", first[3] / 1e9 + 0.01, first[4] / 1e9 + 0.01))
    one, other = load_recordings(Dataset.open(folder), 0.5)
    assert np.flatnonzero(one.touched).tolist() == [3, 4]
    assert not other.touched.any()


def moved_camera(index):
    episode = lifting(index)
    pose = episode.arrays["cameras/front/T_base_camera"].copy()
    pose[0, 3] += 0.01
    return dataclasses.replace(episode, arrays=episode.arrays | {"cameras/front/T_base_camera": pose})


@pytest.mark.parametrize(
    ("episodes", "changed", "facts"),
    [
        ([], {}, "no episodes"),
        ([lifting(0)], {}, r"\b1 episodes .*split"),
        ([lifting(index, steps=LIFT_FROM + 1) for index in range(3)], {"sequence": 9},
         "9 actions.* 2 episodes .*8.* --sequence"),
        ([lifting(index, success=False) for index in range(3)], {},
         "reward .*0 .*2 training episodes"),
        ([lifting(index) for index in range(3)], {"contact_n": 99.0},
         r"contact .*0 .*99 N.* 0\.\d+ to 2\d N"),
        ([lifting(0), lifting(1, task="block_pushing")], {},
         "block_picking, block_pushing.* --mixed"),
        ([lifting(0), wider(1)], {}, "actions/action"),
        ([lifting(0), moved_camera(1)], {}, "cameras/front/T_base_camera"),
    ],
)  # fmt: skip
def test_what_cannot_serve_is_refused_before_training(tmp_path, episodes, changed, facts):
    folder = written(tmp_path / "data", episodes)
    with pytest.raises(DatasetError, match=facts):
        sequences_of(dataclasses.replace(config(folder), **changed))


def test_mixed_episodes_are_learned_from_if_asked_to(tmp_path):
    folder = written(tmp_path / "data", [lifting(0), lifting(1, task="block_pushing"), lifting(2)])
    train, valid, _ = sequences_of(config(folder, mixed=True))
    assert len(train.recordings) + len(valid.recordings) == 3


def test_without_annotations_and_object_nothing_says_when_there_is_contact(tmp_path):
    episode = lifting(0)
    arrays = {path: array for path, array in episode.arrays.items() if not path.startswith("streams/object")}
    folder = written(tmp_path / "data", [dataclasses.replace(episode, arrays=arrays)])
    with pytest.raises(DatasetError, match=r"contact.* svfl-data relabel .* --contact"):
        load_recordings(Dataset.open(folder), 0.5)


def test_short_episodes_are_left_out_and_counted(folder):
    recordings = load_recordings(Dataset.open(folder), 0.5)
    short = dataclasses.replace(recordings[0], action=recordings[0].action[:3])
    assert Sequences([short, *recordings[1:]], 4, random=False).left_out == 1


def test_pixels_without_depth_have_no_part_in_the_statistics(folder):
    recordings = load_recordings(Dataset.open(folder), 0.5)
    whole, holed = Inputs(), Inputs()
    fit(whole, recordings)
    holes = np.random.default_rng(0).random(recordings[0].depth.shape) < 0.3
    fit(holed, [dataclasses.replace(one, depth=np.where(holes, 0, one.depth)) for one in recordings])
    mean, without = whole.normalization.mean("image")[3], holed.normalization.mean("image")[3]
    torch.testing.assert_close(without, mean, rtol=0.01, atol=0)  # 30 % lower if a hole were a distance of 0
    assert (holed.image(torch.zeros(1, 4, 64, 64))[:, 3] == 0).all()  # and it is read as a pixel of mean depth
