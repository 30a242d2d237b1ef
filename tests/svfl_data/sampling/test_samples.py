"""Samples are cut causally, whole batches are single samples stacked, and workers change nothing."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, FieldError, UsageError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.samples import WRENCH, Samples
from svfl_data.sampling.windows import wrench_window
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.storage.store import write_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.own_robot import own_dataset

MS = 1_000_000


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    for index, steps in ((0, 4), (1, 6), (4, 3)):
        write_episode(make_episode(index, steps=steps), dataset.episode_path(index))
    return dataset


def irregular(rng: np.random.Generator, index: int, sizes: dict[str, tuple[int, int]], depth: bool) -> Episode:
    """An episode whose streams have any number of readings (also none) at any times (also equal ones)."""
    arrays = episode_arrays(rng, steps=int(rng.integers(0, 6)))
    for path in [path for path in arrays if path.startswith("cameras/")]:
        del arrays[path]
    times = lambda rows, span: np.sort(rng.integers(0, span, rows)) * MS  # noqa: E731
    arrays["observations/t_ns"] = times(len(arrays["observations/t_ns"]), 300)
    rows = int(rng.choice([0, 1, 3, 40, 1500]))
    arrays["streams/wrench/t_ns"] = times(rows, 400)
    arrays["streams/wrench/wrench"] = rng.normal(size=(rows, 6)).astype(np.float32)
    template = episode_arrays(rng)
    for camera, (height, width) in sizes.items():
        rows = int(rng.choice([0, 1, 2, 7]))
        arrays[f"cameras/{camera}/t_ns"] = times(rows, 400)
        arrays[f"cameras/{camera}/color"] = rng.integers(0, 256, (rows, height, width, 3), dtype=np.uint8)
        if depth:
            arrays[f"cameras/{camera}/depth"] = rng.integers(1, 2**16, (rows, height, width), dtype=np.uint16)
            arrays[f"cameras/{camera}/depth_scale"] = np.array(1e-3 * (index + 1))
        for name in ("intrinsics", "T_base_camera", "image_axes"):
            arrays[f"cameras/{camera}/{name}"] = template[f"cameras/front/{name}"]
    if rng.random() < 0.5:
        del arrays["streams/joints/t_ns"], arrays["streams/joints/position"]
    return Episode(Meta("centering", index, 0, "expert", True), arrays)


def last(t_ns: np.ndarray, values: np.ndarray, now: int, length: int) -> tuple[np.ndarray, np.ndarray, float]:
    """The law, written as slowly as possible: values, padding, age of the newest."""
    times, seen = [time for time in t_ns if time <= now], [values[row] for row, time in enumerate(t_ns) if time <= now]
    longest = 10 * (t_ns[-1] - t_ns[0]) / (len(t_ns) - 1) if len(t_ns) >= 5 and t_ns[-1] > t_ns[0] else np.inf
    after = [*times[1:], now][: len(times)]
    broken = [row for row, (time, later) in enumerate(zip(times, after, strict=True)) if later - time > longest]
    first = broken[-1] + 1 if broken else 0
    padding = [row < first for row in range(len(seen))][-length:]
    seen, filler = seen[-length:], seen[-length] if len(seen) >= length else seen[0] if seen else values[:0].sum(axis=0)
    missing = length - len(seen)
    age = (now - times[-1]) / 1e9 if times else np.inf
    return np.stack([filler.astype(values.dtype)] * missing + seen), np.array([True] * missing + padding), age


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    sizes=st.dictionaries(st.sampled_from(["front", "wrist"]), st.tuples(st.integers(3, 6), st.integers(3, 6))),
    depth=st.booleans(),
    frames=st.integers(1, 3),
    window=st.sampled_from([1, 5, 64]),
    chunk=st.integers(1, 4),
    at=st.sampled_from(["each action", "the end"]),
    cache=st.booleans(),
    crop=st.sampled_from([None, 3]),
)
def test_the_law_of_samples(tmp_path_factory, seed, sizes, depth, frames, window, chunk, at, cache, crop):
    """Whatever the rates, shapes and gaps: the last at or before the step, never a later one, padding where none."""
    rng = np.random.default_rng(seed)
    varies = [f"cameras/{camera}/depth_scale" for camera in sizes]
    dataset = Dataset.create_or_resume(tmp_path_factory.mktemp("law") / "d", "centering", 0, {}, varies)
    episodes = {index: irregular(rng, index, sizes, depth) for index in (0, 3, 7)}
    for index, episode in episodes.items():
        write_episode(episode, dataset.episode_path(index))
    expected = [
        (index, step)
        for index, episode in episodes.items()
        for step in (range(len(episode)) if at == "each action" else [len(episode)])
    ]
    options = {"frames": frames, "windows": {WRENCH: window} if window else {}, "action_chunk": chunk, "at": at}
    options |= {"cache": cache, "crop": crop}
    options["validated"] = False  # times repeat, which svfl-data validate calls an error
    if not expected:
        with pytest.raises(DatasetError, match="no steps"):
            Samples(dataset, **options)
        return
    samples = Samples(dataset, labels=["labels/offset"], **options)
    batch = samples.batch(range(len(samples)))
    assert list(zip(batch["episode"].tolist(), batch["step"].tolist(), strict=True)) == expected
    for row, (index, step) in enumerate(expected):
        episode = episodes[index]
        now = episode.t_ns[step]
        np.testing.assert_array_equal(batch["observations/proprio"][row], episode.proprio[step])
        np.testing.assert_array_equal(batch["labels/offset"][row], episode.label_offset)
        wrench, padding, age = last(episode.wrench_t_ns, episode.tared_wrench, now, window)
        np.testing.assert_allclose(batch["streams/wrench/age"][row], age, rtol=1e-6)
        np.testing.assert_array_equal(batch["streams/wrench/wrench"][row], wrench)
        np.testing.assert_array_equal(batch["streams/wrench/padding"][row], padding)
        np.testing.assert_array_equal(wrench_window(episode, step, window)[0], wrench)
        np.testing.assert_array_equal(wrench_window(episode, step, window)[1], padding)
        for ahead in range(chunk):
            over = step + ahead >= len(episode)
            assert batch["actions/padding"][row, ahead] == over
            action = (
                episode.action[-1] if over and len(episode) else np.zeros(5) if over else episode.action[step + ahead]
            )
            np.testing.assert_array_equal(batch["actions/action"][row, ahead], action)
        for name, camera in episode.cameras.items():
            for kind in ("color", "depth") if depth else ("color",):
                images, padding, age = last(camera.t_ns, getattr(camera, kind), now, frames)
                np.testing.assert_allclose(batch[f"cameras/{name}/age"][row], age, rtol=1e-6)
                if crop:
                    top, left = (images.shape[1] - crop) // 2, (images.shape[2] - crop) // 2
                    images = images[:, top : top + crop, left : left + crop]
                np.testing.assert_array_equal(batch[f"cameras/{name}/{kind}"][row], images)
                np.testing.assert_array_equal(batch[f"cameras/{name}/padding"][row], padding)
            if depth:
                assert batch[f"cameras/{name}/depth_scale"][row] == camera.depth_scale


def test_types_stay_as_recorded(dataset):
    batch = Samples(dataset, cache=True, crop=8).batch([0, 5])
    assert (batch["cameras/front/color"].dtype, batch["cameras/front/color"].shape) == (np.uint8, (2, 1, 8, 8, 3))
    assert (batch["cameras/front/depth"].dtype, batch["cameras/front/depth"].shape) == (np.uint16, (2, 1, 8, 8))
    assert batch["streams/wrench/wrench"].dtype == batch["actions/action"].dtype == np.float32


@pytest.mark.parametrize("cache", [False, True])
@pytest.mark.parametrize("crop_at", ["centre", "random"])
def test_a_batch_is_its_samples_stacked_in_any_order(dataset, cache, crop_at):
    samples = Samples(dataset, frames=2, crop=11, crop_at=crop_at, cache=cache, seed=3)
    order = np.random.default_rng(0).permutation(len(samples))
    batch = samples.batch(order.tolist())
    for row, index in enumerate(order):
        for key, value in samples[int(index)].items():
            np.testing.assert_array_equal(batch[key][row], value, err_msg=key)


def test_random_crops_are_crops_and_depend_on_seed_epoch_and_sample_only(dataset):
    whole = Samples(dataset).batch(range(13))["cameras/front/color"]
    wanted = {"crop": 13, "crop_at": "random"}
    samples, cached = Samples(dataset, seed=1, **wanted), Samples(dataset, seed=1, cache=True, **wanted)
    drawn = samples.batch(range(13), epoch=2)["cameras/front/color"]
    np.testing.assert_array_equal(drawn, cached.batch(range(13), epoch=2)["cameras/front/color"])
    assert not np.array_equal(drawn, samples.batch(range(13), epoch=3)["cameras/front/color"])
    assert not np.array_equal(
        drawn, Samples(dataset, seed=2, **wanted).batch(range(13), epoch=2)["cameras/front/color"]
    )
    places = set()
    for epoch in range(12):
        for image, crop in zip(whole, samples.batch(range(13), epoch)["cameras/front/color"], strict=True):
            found = [
                (top, left)
                for top in range(4)
                for left in range(4)
                if np.array_equal(image[0, top : top + 13, left : left + 13], crop[0])
            ]
            assert len(found) == 1
            places.add(found[0])
    assert len(places) == 16  # every place is reached


def test_changing_a_batch_changes_no_sample(dataset):
    samples = Samples(dataset, cache=True)
    first = samples.batch([0, 1])
    kept = {key: values.copy() for key, values in first.items()}
    for values in first.values():
        values[...] = 0
    for key, values in samples.batch([0, 1]).items():
        np.testing.assert_array_equal(values, kept[key])


def test_chosen_episodes_and_cameras(dataset):
    samples = Samples(dataset, [4, 0], cameras=[])
    assert set(samples.batch(range(len(samples)))["episode"]) == {0, 4}
    assert not [key for key in samples[0] if key.startswith("cameras/")]
    assert [sample["step"].item() for sample in samples] == [0, 1, 2, 0, 1, 2, 3]
    assert samples[-1]["step"] == 3


def test_a_pickled_copy_gives_the_same_samples_and_is_small(dataset):
    samples = Samples(dataset, cache=True, crop=10, crop_at="random", seed=5)
    pickled = pickle.dumps(samples)
    assert len(pickled) < 4000
    for (key, value), other in zip(
        samples.batch([3, 9]).items(), pickle.loads(pickled).batch([3, 9]).values(), strict=True
    ):
        np.testing.assert_array_equal(value, other, err_msg=key)


def test_what_cannot_be_sampled_is_named(dataset, tmp_path):
    with pytest.raises(UsageError, match=r"crop.*17 px.*cameras/front/color.*16 x 16 px"):
        Samples(dataset, crop=17)
    with pytest.raises(UsageError, match=r"frames.*\b0\b.*at least 1\b"):
        Samples(dataset, frames=0)
    with pytest.raises(DatasetError, match=r"episode_000000\.hdf5.*camera wrist.*front"):
        Samples(dataset, cameras=["wrist"])
    with pytest.raises(DatasetError, match=r"episode 2\b.*\b3 episodes.*\b0 to 4\b"):
        Samples(dataset, [2])
    with pytest.raises(DatasetError, match=r"empty.*no episodes"):
        Samples(Dataset.create_or_resume(tmp_path / "empty", "centering", 0, {}))
    write_episode(make_episode(9, size=20), dataset.episode_path(9))
    with pytest.raises(DatasetError, match=r"cameras/front/color.*\(20, 20, 3\).*episode_000009\.hdf5.*\(16, 16, 3\)"):
        Samples(dataset)


def test_time_that_runs_backwards_is_refused(dataset):
    arrays = episode_arrays(np.random.default_rng(0))
    arrays["streams/wrench/t_ns"] = arrays["streams/wrench/t_ns"].copy()
    arrays["streams/wrench/t_ns"][50] = 0
    episode = make_episode(5)
    object.__setattr__(episode, "arrays", arrays)
    write_episode(episode, dataset.episode_path(5))
    with pytest.raises(DatasetError, match=r"\b1 of 4 .*episode_000005\.hdf5.*streams/wrench/t_ns\[50\].*backward"):
        Samples(dataset)
    with pytest.raises(DatasetError, match=r"episode_000005\.hdf5.*streams/wrench/t_ns.*decreases.*\brow 50\b"):
        Samples(dataset, validated=False)


def test_the_budget_is_checked_before_images_are_read(dataset, monkeypatch):
    Samples(dataset, budget=60_000)
    with pytest.raises(DatasetError, match=r"images.*budget.*0\.0[36] MB.*cache=False"):
        Samples(dataset, budget=30_000, cache=True)
    with pytest.raises(DatasetError, match=r"budget.*0\.001 MB(?!.*cache=False)"):
        Samples(dataset, budget=1_000)


@pytest.mark.slow
def test_workers_and_lightning_change_neither_samples_nor_order(dataset):
    """No workers, forked ones and fresh ones; the epoch of crops and order advances in all of them."""
    import lightning
    import torch

    from svfl_data.sampling.torch_samples import TorchSamples

    torch_samples = TorchSamples(Samples(dataset, crop=12, crop_at="random", seed=1))

    def epochs(**options):
        loader = torch_samples.loader(5, shuffle=True, seed=7, **options)
        return [batch for _ in range(2) for batch in loader]

    alone = epochs()
    assert [len(batch["step"]) for batch in alone] == [5, 5, 3, 5, 5, 3]
    steps = torch.cat([batch["step"] for batch in alone[:3]]).tolist()
    assert sorted(steps) == sorted([*range(4), *range(6), *range(3)])
    assert not torch.equal(alone[0]["cameras/front/color"], alone[3]["cameras/front/color"])
    for context, workers in (("fork", 2), ("spawn", 1)):
        pooled = epochs(num_workers=workers, multiprocessing_context=context, persistent_workers=True)
        for batch, other in zip(alone, pooled, strict=True):
            assert batch.keys() == other.keys()
            for key in batch:
                assert torch.equal(batch[key], other[key]), (context, key)

    class Data(lightning.LightningDataModule):
        def train_dataloader(self):
            return torch_samples.loader(5, shuffle=True, seed=7)

    class Net(lightning.LightningModule):
        def __init__(self):
            super().__init__()
            self.layer, self.seen = torch.nn.Linear(6, 5), []

        def training_step(self, batch, _):
            self.seen.append(batch)
            known = ~batch["actions/padding"][:, 0]
            error = self.layer(batch["streams/wrench/wrench"].mean(1)) - batch["actions/action"][:, 0]
            return (error[known] ** 2).mean()

        def configure_optimizers(self):
            return torch.optim.SGD(self.parameters(), 1e-3)

    net = Net()
    lightning.Trainer(
        max_epochs=2, accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False,
    ).fit(net, datamodule=Data())  # fmt: skip
    for batch, other in zip(alone, net.seen, strict=True):
        assert torch.equal(batch["cameras/front/color"], other["cameras/front/color"])


OWN = {
    "streams/wrench/wrench": Window(7, rate_hz=500),
    "streams/tactile/pressure": Window(3, rate_hz=50, resample=True),
    "streams/left_finger/wrench": Window(2),
}


def test_one_observation_is_cut_as_a_batch_of_many(tmp_path):
    """Of a robot whose fields nobody knows; what is cut from an episode is what samples give, at every step."""
    dataset = own_dataset(tmp_path / "d", 3)
    samples = Samples(dataset, windows=OWN, frames=2)
    whole = samples.batch(range(len(samples)))
    for index in dataset.indices:
        chosen = np.flatnonzero(whole["episode"] == index)
        seen = cut_steps(dataset.read(index), samples.inputs, whole["step"][chosen])
        assert {"streams/tactile/pressure", "observations/tcp_velocity", "cameras/wrist/color"} <= seen.keys()
        for path, values in seen.items():
            np.testing.assert_array_equal(values, whole[path][chosen], err_msg=path)


def test_a_resampled_window_has_the_latest_reading_at_every_moment(tmp_path):
    dataset = own_dataset(tmp_path / "d", 1)
    episode = dataset.read(0)
    batch = Samples(dataset, windows=OWN).batch(range(len(episode)))
    t_ns = episode["streams/tactile/t_ns"]
    for step in range(len(episode)):
        moments = episode.t_ns[step] - np.array([40_000_000, 20_000_000, 0])
        rows = np.searchsorted(t_ns, moments, side="right") - 1
        expected = episode["streams/tactile/pressure"][rows]
        np.testing.assert_array_equal(batch["streams/tactile/pressure"][step], expected)


@pytest.mark.parametrize(("changes", "error", "facts"), [
    ({"windows": {"streams/wrench/wrench": Window(4, rate_hz=100)}}, DatasetError, "500 Hz.*4 readings at 100 Hz"),
    ({"windows": {"streams/nothing/x": 4}}, FieldError, "streams/nothing/x"),
    ({"windows": {"streams/wrench/wrench": 0}}, UsageError, "0 readings"),
    ({"vectors": ["observations/proprio"]}, FieldError, "observations/proprio"),
    ({"actions": ["actions/left"]}, FieldError, "actions/left"),
])  # fmt: skip
def test_windows_that_the_recording_does_not_have_are_refused(tmp_path, changes, error, facts):
    dataset = own_dataset(tmp_path / "d", 1)
    with pytest.raises(error, match=facts):
        Samples(dataset, **changes)


def test_two_arrays_of_one_clock_have_one_window():
    with pytest.raises(UsageError, match=r"streams/joints/velocity.*streams/joints"):
        InputSpec(windows={"streams/joints/position": Window(2), "streams/joints/velocity": Window(3)})
    with pytest.raises(UsageError, match="resampled needs a rate"):
        Window(3, resample=True)
