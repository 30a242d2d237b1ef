"""What cannot be an input is said in one line, and never cut from the rows of another clock."""

import numpy as np
import pytest

from svfl_data.errors import FieldError, UsageError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.sampling.samples import Samples
from svfl_data.sampling.torch_samples import TorchSamples
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.observation import Observation
from tests.helpers.open_episode import dataset_of, open_episode


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return dataset_of(tmp_path_factory.mktemp("unfit") / "d", open_episode, 2)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"vectors": ["streams/tcp/pose"]}, "no vector of a step"),
        ({"vectors": ["actions/action"]}, "no vector of a step"),
        ({"windows": {"cameras/front/color": 3}}, "has no window"),
        ({"windows": {"actions/action": 3}}, "has no window"),
        ({"windows": {"streams/wrench/wrench": 3.5}}, "3.5 readings; it must be a whole number"),
        ({"windows": {"streams/wrench/wrench": (64, 500)}}, "whole number"),
        ({"windows": {"streams/wrench/wrench": None}}, "whole number"),
    ],
)
def test_what_is_elsewhere_is_no_input(dataset, wrong, words):
    """A stream has a clock of its own: its rows are not those of the observations."""
    with pytest.raises(UsageError, match=words):
        Samples(dataset, **wrong)


@pytest.mark.parametrize("rate", ["fast", 0, float("nan")])
def test_a_rate_is_a_number(rate):
    with pytest.raises(UsageError, match="a number above 0"):
        Window(3, rate)


def test_what_an_episode_has_once_has_no_window(dataset):
    windows = {"streams/wrench/tare": Window(3)}
    with pytest.raises(FieldError, match="streams/wrench/tare is one value per episode"):
        Samples(dataset, windows=windows)
    with pytest.raises(FieldError, match=r"streams/wrench/tare has 6 rows, and streams/wrench/t_ns has \d+ times"):
        cut_steps(dataset.read(0), InputSpec(windows=windows))


def test_readings_with_too_few_times_are_not_cut():
    """A robot that tells 64 readings and the times of the 25 new ones: nobody knows which belong together."""
    seen = Observation(10**9, wrench=np.ones((64, 6)), values={"streams/wrench/t_ns": np.arange(25) * 2_000_000})
    with pytest.raises(FieldError, match="streams/wrench/wrench has 64 rows, and streams/wrench/t_ns has 25 times"):
        LiveCut(InputSpec(windows={"streams/wrench/wrench": Window(8)}))(seen)


def test_texts_are_samples_but_no_tensors(dataset):
    samples = Samples(dataset, windows={"streams/notes/words": 1})
    assert samples[len(samples) - 1]["streams/notes/words"].tolist() in ([b"contact"], [b"reaching"])
    with pytest.raises(UsageError, match="streams/notes/words holds texts"):
        TorchSamples(samples)[0]
