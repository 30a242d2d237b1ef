"""A tactile array at 100 Hz and a second wrench, of names that no code knows, are found by path in whatever reads data.

Each consumer must find the values that stand in the episodes, as an independent path computes them. All numbers of the
episodes are different, so that values of another array are noticed.
"""

import contextlib
import io
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch.utils.data import DataLoader

from svfl_data.cli import main
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import UsageError
from svfl_data.maintenance.merge import merge
from svfl_data.replay import ReplayBuffer, ReplayConfig
from svfl_data.reports.plot import overview
from svfl_data.sampling.samples import Samples
from svfl_data.sampling.statistics import FieldStatistics, compute_statistics
from svfl_data.sampling.torch_samples import TorchSamples
from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import act, dihedral
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import CloningData
from svfl_models.cloning.train import network_of
from svfl_models.networks.policy import Policy
from tests.helpers.rerun_files import entities

SKIN, PALM = "streams/skin/pressure", "streams/palm/wrench"
FIELDS = {
    SKIN: Field(path=SKIN, dtype="float32", shape=("T", 2, 3, 4), unit="kPa", doc="Pressure on both pads."),
    PALM: wrench_stream("palm", axes="base", doc="Load on the palm.")[0],
}
DECLARED = Declarations([pose_action(0.02, 0.1), FIELDS[SKIN], *wrench_stream("palm", axes="base")])
UNITS = {SKIN: "kPa", PALM: "N m"}
INPUTS = InputSpec(windows={SKIN: Window(3, rate_hz=100), PALM: Window(8, rate_hz=500)})
STEPS, EPISODES, WORKSPACE = 6, 6, np.array([[0.3, 0.7], [-0.1, 0.3], [0.0, 0.3]])


def episode(index: int) -> Episode:
    rng, t_ns = np.random.default_rng([3, index]), np.arange(STEPS + 1) * 50_000_000 + 200_000_000
    fast, slow = np.arange(0, t_ns[-1] + 1, 2_000_000), np.arange(0, t_ns[-1] + 1, 10_000_000)
    arrays = {
        "observations/t_ns": t_ns,
        "actions/action": rng.uniform(0, 0.02, (STEPS, 7)).astype(np.float32),
        "streams/skin/t_ns": slow,
        SKIN: rng.uniform(1, 5, (len(slow), 2, 3, 4)).astype(np.float32),
        "streams/palm/t_ns": fast,
        PALM: rng.normal(0, 2, (len(fast), 6)).astype(np.float32),
        "streams/palm/tare": rng.normal(0, 1, 6),
        "workspace": WORKSPACE,
    }
    rates = {"rates_hz": {"streams/skin": 100, "streams/palm": 500}}
    return Episode(Meta("wiping", index, 0, "robot", True, config=rates), arrays, declarations=DECLARED)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory) -> Dataset:
    made = Dataset.create_or_resume(tmp_path_factory.mktemp("unknown") / "mine", "wiping", 0, {})
    for index in range(EPISODES):
        write_episode(episode(index), made.episode_path(index))
    return made


def tared(path: str, index: int) -> NDArray[np.float32]:
    """All readings of an array in an episode, as programs use them."""
    arrays = episode(index).arrays
    return (arrays[PALM] - arrays["streams/palm/tare"]).astype(np.float32) if path == PALM else arrays[path]


def window(path: str, index: int, step: int, length: int | None = None) -> NDArray[np.float32]:
    """The last readings at or before a step."""
    arrays = episode(index).arrays
    end = np.searchsorted(arrays[f"{path.rpartition('/')[0]}/t_ns"], arrays["observations/t_ns"][step], side="right")
    return tared(path, index)[end - (length or INPUTS.windows[path].length) : end]


def said(*words: str | Path) -> str:
    """What a command prints."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), patch("sys.argv", ["svfl-data", *map(str, words)]):
        assert main() == 0
    return out.getvalue()


def samples(dataset: Dataset, path: str, folder: Path) -> None:
    taken = Samples(dataset, windows=INPUTS.windows)
    batch = taken.batch(range(len(taken)))
    for row, (index, step) in enumerate(zip(batch["episode"], batch["step"], strict=True)):
        np.testing.assert_array_equal(batch[path][row], window(path, index, step))
    assert Samples(dataset)[0][path].shape[1:] == FIELDS[path].shape[1:]  # also where nobody asks for it


def torch_samples(dataset: Dataset, path: str, folder: Path) -> None:
    taken = TorchSamples(Samples(dataset, windows=INPUTS.windows))
    for batch in DataLoader(taken, batch_size=10):
        for row, (index, step) in enumerate(zip(batch["episode"].tolist(), batch["step"].tolist(), strict=True)):
            np.testing.assert_array_equal(batch[path][row], window(path, index, step))


def statistics(dataset: Dataset, path: str, folder: Path) -> None:
    check_moments(compute_statistics(dataset, [1, 4])[path], path, [1, 4])


def split(dataset: Dataset, path: str, folder: Path) -> None:
    """The statistics of a split are those of its training episodes."""
    half = ("--ratios", "train=0.5", "test=0.5", "--split", "half")
    drawn = json.loads(said("split", dataset.path, *half, "--json"))["parts"]["train"]
    found = json.loads(said("stats", dataset.path, "--split", "half", "--json"))["fields"][path]
    check_moments(FieldStatistics(**found), path, drawn)


def merged(dataset: Dataset, path: str, folder: Path) -> None:
    merge([dataset], folder / "new")
    check_copies(folder / "new", path, range(EPISODES))


def filtered(dataset: Dataset, path: str, folder: Path) -> None:
    said("filter", dataset.path, folder / "new", "--where", "index>=4")
    check_copies(folder / "new", path, range(4, EPISODES))


def plotted(dataset: Dataset, path: str, folder: Path) -> None:
    said("plot", dataset.path, "--out", folder / "p.png")
    figure = overview(dataset.read(0))
    if path == SKIN:
        words = [text.get_text() for axis in figure.axes for text in axis.texts]
        assert any(word.startswith("skin/pressure, kPa") for word in words)
        return
    (force,) = (axis for axis in figure.axes if axis.get_ylabel().startswith("palm\nforce, N"))
    (line,) = (line for line in force.lines if line.get_label() == "fy, N")
    np.testing.assert_allclose(line.get_ydata(), tared(path, 0)[:, 1], rtol=1e-6)


def viewed(dataset: Dataset, path: str, folder: Path) -> None:
    said("view", dataset.path, "--out", folder / "v.rrd")
    assert any(path.rpartition("/")[0] in entity for entity in entities(folder / "v.rrd"))


def info(dataset: Dataset, path: str, folder: Path) -> None:
    whole, one = said("info", dataset.path), said("info", dataset.path, "--episode", "0")
    assert any(path in line and UNITS[path] in line for line in whole.splitlines())
    assert any(path in line and str(episode(0).arrays[path].shape) in line for line in one.splitlines())


def card(dataset: Dataset, path: str, folder: Path) -> None:
    said("card", dataset.path, "--out", folder / "card.md")
    (row,) = (line for line in (folder / "card.md").read_text().splitlines() if f"| {path.split('/')[1]} |" in line)
    assert path.split("/")[2] in row
    assert UNITS[path] in row


def replayed(dataset: Dataset, path: str, folder: Path) -> None:
    buffer = ReplayBuffer.from_demos(dataset, EPISODES, inputs=INPUTS)
    possible = {
        window(path, index, step).tobytes(): window(path, index, step + 1) for index in range(EPISODES)
        for step in range(STEPS)
    }  # fmt: skip
    batch = buffer.sample(32)
    for now, after in zip(batch[path], batch[f"next_{path}"], strict=True):
        np.testing.assert_array_equal(after, possible[now.tobytes()])


def augmented(dataset: Dataset, path: str, folder: Path) -> None:
    """The wrench turns with the world, and the pressure does not, which has to be said."""
    with pytest.raises(UsageError, match=SKIN):
        ReplayBuffer.from_demos(dataset, EPISODES, inputs=INPUTS, config=ReplayConfig(rotate=True))
    plain, turned = (
        ReplayBuffer.from_demos(dataset, EPISODES, inputs=INPUTS, config=config, invariant=[SKIN]).sample(64)
        for config in (ReplayConfig(), ReplayConfig(rotate=True))
    )
    elements = dihedral(4)
    occurred = set()
    for before, after in zip(plain[path], turned[path], strict=True):
        if path == SKIN:
            np.testing.assert_array_equal(before, after)
            continue
        close = [np.allclose(act(one, before, FIELDS[path].parts), after, atol=1e-5) for one in elements]
        assert sum(close) == 1
        occurred.add(close.index(True))
    assert path == SKIN or occurred == set(range(len(elements)))


def normalised(dataset: Dataset, path: str, folder: Path) -> None:
    """A network scales by the statistics of the steps that it is trained with, and a vector by one scale."""
    data, network = learner(dataset)
    network.trunk.normalization.fit(**{name: values.numpy() for name, values in data.train_set.typical().items()})
    rows = np.concatenate([window(path, index, step) for index in data.train_set.samples.episodes
                           for step in range(STEPS)]).reshape(-1, *FIELDS[path].shape[1:])  # fmt: skip
    scale = network.trunk.normalization.scale(path).numpy()
    if path == SKIN:
        mean = network.trunk.normalization.mean(path).numpy()
        np.testing.assert_allclose(mean, rows.mean(axis=0).ravel(), rtol=1e-3)
        np.testing.assert_allclose(scale, np.sqrt(rows.var(axis=0).mean()), rtol=1e-3)
    else:
        np.testing.assert_allclose(scale[:2], np.sqrt((rows[:, :2] ** 2).mean()), rtol=1e-3)
        np.testing.assert_allclose(scale[2], rows[:, 2].std(), rtol=1e-3)


def networks(dataset: Dataset, path: str, folder: Path) -> None:
    """A policy has it as an input of its own, of which every number changes the action."""
    data, network = learner(dataset)
    batch = {name: values.requires_grad_() for name, values in data.train_set.batch(range(4)).items()}
    network.eval()(batch).mode.square().sum().backward()
    assert batch[path].shape == (4, INPUTS.windows[path].length, int(np.prod(FIELDS[path].shape[1:])))
    assert (batch[path].grad != 0).any(dim=0).all()


def learner(dataset: Dataset) -> tuple[CloningData, Policy]:
    inputs = [f"{SKIN}=3@100:invariant", f"{PALM}=8@500"]
    config = CloningConfig(str(dataset.path), EPISODES, preset="tiny", valid=1 / 3, inputs=inputs)
    data = CloningData(config)
    torch.manual_seed(0)
    return data, Policy(**network_of(config, data.deployment))


def check_moments(found: FieldStatistics, path: str, episodes: Sequence[int]) -> None:
    rows = np.concatenate([tared(path, index) for index in episodes]).astype(np.float64)
    rows = rows if path == PALM else rows.reshape(-1, 1)
    assert found.unit == (FIELDS[path].unit)
    np.testing.assert_allclose(found.min, rows.min(axis=0), rtol=1e-6)
    np.testing.assert_allclose(found.max, rows.max(axis=0), rtol=1e-6)
    mean = rows.mean(axis=0) * ([0, 0, 1, 0, 0, 0] if path == PALM else 1)  # only of what no rotation changes
    np.testing.assert_allclose(found.mean, mean, rtol=1e-6, atol=1e-9)


def check_copies(folder: Path, path: str, episodes: Sequence[int]) -> None:
    new = Dataset.open(folder)
    assert len(new) == len(episodes)
    for index, of in enumerate(episodes):
        np.testing.assert_array_equal(new.read(index)[path], episode(of).arrays[path])
        assert new.read(index).declarations.at(path) == DECLARED.at(path)


CONSUMERS: list[Callable[[Dataset, str, Path], None]] = [
    samples, torch_samples, statistics, split, merged, filtered, plotted, viewed, info, card, replayed, augmented,
    normalised, networks,
]  # fmt: skip
SLOW = (plotted, viewed, card, normalised, networks)


@pytest.mark.parametrize("path", [SKIN, PALM])
@pytest.mark.parametrize(
    "find", [pytest.param(one, marks=pytest.mark.slow if one in SLOW else (), id=one.__name__) for one in CONSUMERS]
)
def test_it_is_found(find, path, dataset, tmp_path):
    find(dataset, path, tmp_path)
