"""``svfl-collect policy``: a file that acts, honestly counted, and clear errors for files that do not."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from collectors.sources.expert import ExpertCollector
from collectors.sources.policy import PolicyCollector
from collectors.sources.replay import replay
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError, TrainingError
from svfl_data.reports.success_rate import wilson
from svfl_data.schema.robot import Frame, Observation
from svfl_data.storage.store import episode_bytes
from svfl_models.programs.exported_policy import load, save
from tests.helpers.collecting import collect, contents
from tests.helpers.collectors import SMALL

pytestmark = pytest.mark.slow

RAISED = torch.tensor([[1.0, 0.0, 0.0, 0.004, 0.0]])


class Lift(torch.nn.Module):
    """Lifts the gripper by 4 mm and as many more as it is yawed, and looks at everything."""

    def __init__(self, action: torch.Tensor = RAISED):
        super().__init__()
        self.action = torch.nn.Parameter(action)

    def forward(self, image, wrench, proprio):
        seen = image[:, 3].mean() + wrench.square().mean() + proprio[:, 3]
        return self.action + 0.01 * torch.nn.functional.pad(seen.reshape(1, 1), (3, 1))


@pytest.fixture(scope="module")
def lift(tmp_path_factory):
    file = tmp_path_factory.mktemp("policy") / "lift.pt2"
    save(Lift(), file, (16, 16))
    return file


def seen(size: int = 16, depth: int = 5000) -> Observation:
    frame = Frame(np.zeros((size, size, 3), np.uint8), np.full((size, size), depth, np.uint16))
    window, proprio = np.zeros((64, 6), np.float32), np.array([1, 0.5, 0, 0.2, 0], np.float32)
    times = {"streams/wrench/t_ns": np.arange(-63, 1) * 2_000_000}
    return Observation(0, {"front": frame}, window, proprio, np.zeros(9, np.float32), values=times)


def test_a_saved_policy_sees_in_si_units(lift):
    np.testing.assert_allclose(load(lift)(seen(depth=5000)), [1, 0, 0, 0.004 + 0.01 * (0.5 + 0.2), 0], rtol=1e-5)


def test_a_policy_is_recorded_and_counted(lift, tmp_path):
    arguments = ("policy", "--task", "block_picking", "--checkpoint", lift, "--image-size", 16)
    done = collect(*arguments, "--episodes", 2, "--workers", 2, "--out", tmp_path / "two")
    assert done.returncode == 0, done.stderr
    assert "0 of 2 episodes succeeded, 0.0% (95 % interval 0.0% to 65.8%)" in done.stdout
    dataset = Dataset.open(tmp_path / "two")
    collector = PolicyCollector(0, "block_picking", lift, SMALL)
    assert episode_bytes(collector(1)) == dataset.episode_path(1).read_bytes()
    collector.opened.close()
    for episode in dataset:
        assert (episode.meta.source, episode.meta.success, len(episode)) == ("policy", False, 50)
        assert episode.proprio[-1, 3] > episode.proprio[0, 3] + 0.03
        assert check_episode(episode) == []
    assert replay(dataset.read(0)).exact

    other = tmp_path / "other.pt2"
    save(Lift(2 * RAISED), other, (16, 16))
    before = contents(tmp_path / "two")
    done = collect(
        "policy", "--task", "block_picking", "--checkpoint", other, "--image-size", 16, "--out", dataset.path
    )
    assert done.returncode == 1
    assert "config.checkpoint." in done.stderr
    assert contents(tmp_path / "two") == before


def test_policies_are_not_tested_on_what_they_learned_from(lift):
    collector, expert = (
        PolicyCollector(0, "block_picking", lift, SMALL),
        ExpertCollector(0, "block_picking", world=SMALL),
    )
    assert collector(0).meta.config["drawn"] != expert(0).meta.config["drawn"]
    collector.opened.close()
    expert.opened.close()


def test_actions_are_recorded_within_their_bounds(tmp_path):
    save(Lift(torch.tensor([[-3.0, 1.0, -1.0, 0.0, 2.0]])), tmp_path / "wild.pt2", (16, 16))
    collector = PolicyCollector(0, "block_picking", tmp_path / "wild.pt2", SMALL)
    first = collector(0).action[0]
    collector.opened.close()
    np.testing.assert_allclose(first[[0, 1, 2, 4]], [0, 0.025, -0.025, np.pi / 16], rtol=1e-6)


class Other(torch.nn.Module):
    def forward(self, image, proprio):
        return image.mean() + proprio


class Force(torch.nn.Module):
    def forward(self, image, wrench, proprio):
        return image.mean() + wrench[:, 0]


def test_networks_of_another_shape_are_not_saved(tmp_path):
    with pytest.raises(TrainingError, match="image, wrench and proprio"):
        save(Other(), tmp_path / "x.pt2", (16, 16))
    with pytest.raises(TrainingError, match=r"\(1, 6\).* \(1, 5\)"):
        save(Force(), tmp_path / "x.pt2", (16, 16))
    assert not (tmp_path / "x.pt2").exists()


def test_files_that_are_no_policies_are_one_clear_line(lift, tmp_path):
    file = tmp_path / "x.pt2"
    with pytest.raises(FormatError, match=r"x\.pt2"):
        load(file)
    for length in (200, 2000):
        file.write_bytes(lift.read_bytes()[:-length])
        with pytest.raises(FormatError, match=r"x\.pt2"):
            load(file)
    file.write_text("hello")
    with pytest.raises(FormatError, match=r"x\.pt2"):
        load(file)
    torch.save({"weights": torch.zeros(3)}, file)
    with pytest.raises(FormatError, match=r"x\.pt2"):
        load(file)
    inputs = (torch.zeros(1, 4, 16, 16), torch.zeros(1, 5))
    program = torch.export.export(Other(), inputs)
    torch.export.save(program, file)
    with pytest.raises(FormatError, match=r"x\.pt2: .*svfl_policy\.json"):
        load(file)
    torch.export.save(program, file, extra_files={"svfl_policy.json": '{"depth_scale": 1e-4}'})
    with pytest.raises(FormatError, match=r"\(1, 4, 16, 16\), \(1, 5\) .*\(1, 5\).* wrench \(1, T, 6\)"):
        load(file)


class Root(Lift):
    """Has no action where it feels nothing."""

    def forward(self, image, wrench, proprio):
        return super().forward(image, wrench, proprio) + (wrench.square().sum() - 1).sqrt()


def test_actions_that_are_no_numbers_and_other_cameras_are_errors(lift, tmp_path):
    save(Root(), tmp_path / "nan.pt2", (16, 16))
    with pytest.raises(TrainingError, match=r"action .*not finite.*\bnan\b"):
        load(tmp_path / "nan.pt2")(seen())
    with pytest.raises(TrainingError, match=r"action .*not finite"):
        save(Lift(RAISED * np.nan), tmp_path / "weights.pt2", (16, 16))
    assert not (tmp_path / "weights.pt2").exists()
    with pytest.raises(TrainingError, match=r"16 x 16 px.* 24 x 24"):
        load(lift)(seen(size=24))


@pytest.mark.parametrize(
    ("checkpoint", "code", "facts"),
    [
        ("none.pt2", 1, "none.pt2: "),
        ("policy.onnx", 2, ".ckpt, .pt2"),
        ("cut.pt2", 1, "cut.pt2: "),
    ],
)
def test_a_checkpoint_that_cannot_be_loaded_is_one_line(checkpoint, code, facts, tmp_path, lift):
    (tmp_path / "cut.pt2").write_bytes(lift.read_bytes()[:-200])
    done = collect("policy", "--task", "block_picking", "--checkpoint", tmp_path / checkpoint, "--out", tmp_path / "x")
    assert done.returncode == code
    assert facts in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"), [(0, 10, 0.0, 0.2775), (8, 10, 0.4902, 0.9433), (10, 10, 0.7225, 1.0)]
)
def test_the_interval_is_wilsons(successes, trials, low, high):
    """R. G. Newcombe, Statistics in Medicine 17, 1998: the score interval without continuity correction."""
    np.testing.assert_allclose(wilson(successes, trials), (low, high), atol=1e-4)


def test_collectors_travel_without_their_world(lift):
    collector = PolicyCollector(0, "block_picking", lift, SMALL)
    assert collector.opened
    assert collector.policy
    assert collector.__getstate__().keys() == {"seed", "task", "checkpoint", "world"}
    collector.opened.close()
    assert replace(collector, seed=1).seed == 1
