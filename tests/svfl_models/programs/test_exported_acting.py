"""An exported policy sees of a robot what a training sees of its episodes, however few readings an observation has."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from svfl_data.errors import DatasetError, FieldError, FormatError, TrainingError
from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import WRENCH, paper_inputs
from svfl_data.schema.observation import Frame, Observation
from svfl_models.programs import exported_policy
from svfl_models.programs.exported_policy import ExportedPolicy
from tests.helpers.builders import make_episode

SIZE = 10
STEP_NS = 50_000_000


class Told(torch.nn.Module):
    """Its action tells the oldest and the newest reading, the sum of all, proprioception and the picture."""

    def __init__(self) -> None:
        super().__init__()
        self.scale = torch.nn.Parameter(torch.ones(1))

    def forward(self, image, wrench, proprio):
        weights = torch.arange(1.0, 65.0)[:, None]
        parts = [
            wrench[:, 0, 0],
            wrench[:, -1, 0],
            (wrench * weights).mean((1, 2)),
            proprio[:, 1],
            image.mean((1, 2, 3)),
        ]
        return self.scale * torch.stack(parts, dim=1)


def opened(**facts) -> ExportedPolicy:
    return exported_policy.opened(exported_policy.exported(Told(), (SIZE, SIZE), **facts), "told.pt2")


def observations(episode: Episode, since_ns: int = -1, later_ns: int = 0) -> list[Observation]:
    """What a robot observes that tells only the readings since the observation before.

    Args:
        episode: What there is to observe.
        since_ns: Time after which the readings of the first observation come.
        later_ns: Time that the clock of the robot is ahead of that of the episode.
    """
    found, before = [], since_ns
    wrench = episode.tared_wrench
    camera = episode.cameras["front"]
    for step, now in enumerate(episode.t_ns.tolist()):
        t_ns = episode.wrench_t_ns
        new = (t_ns > before) & (t_ns <= now)
        values = {"streams/wrench/t_ns": t_ns[new] + later_ns, WRENCH: wrench[new]}
        frame = Frame(camera.color[step], camera.depth[step])
        found.append(Observation(now + later_ns, {"front": frame}, proprio=episode.proprio[step], values=values))
        before = now
    return found


def stream(rate_hz: float, seconds: float = 2.0) -> list[Observation]:
    """Observations at 20 Hz of a wrench at a rate, each with the readings since the one before."""
    t_ns = (np.arange(1, int(rate_hz * seconds)) / rate_hz * 1e9).astype(np.int64)
    found, before = [], -1
    for now in range(50_000_000, int(seconds * 1e9), 50_000_000):
        new = t_ns[(t_ns > before) & (t_ns <= now)]
        values = {"streams/wrench/t_ns": new, WRENCH: np.zeros((len(new), 6), np.float32)}
        found.append(Observation(now, proprio=np.zeros(5, np.float32), values=values))
        before = now
    return found


@pytest.fixture(scope="module")
def episode() -> Episode:
    return make_episode(steps=8, size=SIZE)


def expected(policy: ExportedPolicy, episode: Episode, step: int) -> np.ndarray:
    return policy.act(cut_steps(episode, paper_inputs("front"), [step]), "front")


def test_every_action_is_that_of_the_recorded_step(episode):
    """Each observation has 25 readings, a window 64."""
    policy, seen = opened(camera="front", wrench_hz=500.0), observations(episode)
    assert {len(one.at(WRENCH)) for one in seen[1:]} == {25}
    for step, one in enumerate(seen):
        np.testing.assert_array_equal(policy(one), expected(policy, episode, step), err_msg=str(step))
    window = episode.tared_wrench[episode.wrench_t_ns <= episode.t_ns[-1]][-64:]
    np.testing.assert_array_equal(expected(policy, episode, -1)[:2], window[[0, -1], 0])


def test_a_window_is_whole_after_enough_steps(episode):
    """The first observation has 25 readings, too, so that of the first windows the beginning is missing."""
    policy, seen = opened(camera="front"), observations(episode, since_ns=episode.t_ns[0] - STEP_NS)
    assert [len(one.at(WRENCH)) for one in seen] == [25] * len(seen)
    same = [np.array_equal(policy(one), expected(policy, episode, step)) for step, one in enumerate(seen)]
    assert same == [False, False] + [True] * (len(seen) - 2)


def test_another_episode_begins_by_an_earlier_time_or_by_forgetting(episode):
    """Where a person took long, the first observation of an episode may be later than the last one of that before."""
    since_ns = episode.t_ns[0] - STEP_NS
    early, late = (observations(episode, since_ns, later_ns) for later_ns in (0, 10 * 10**9))
    policy = opened(camera="front")
    actions = [policy(one) for one in early]
    np.testing.assert_array_equal([policy(one) for one in early], actions)
    assert not np.array_equal([policy(one) for one in late], actions)
    policy.forget()
    np.testing.assert_array_equal([policy(one) for one in late], actions)


@pytest.mark.parametrize("rate_hz", [100, 1200])
def test_another_rate_than_in_training_is_refused(rate_hz):
    policy = opened(camera="", wrench_hz=500.0)
    with pytest.raises(DatasetError, match=rf"wrench has {rate_hz} Hz, but .* 64 readings at 500 Hz .*learned from"):
        [policy(one) for one in stream(rate_hz)]


def test_a_rate_that_is_not_known_is_not_asked_for():
    policy = opened(camera="")
    assert {policy(one).shape for one in stream(100)} == {(5,)}


def test_a_robot_without_an_input_is_one_line(episode):
    policy, (seen, *_) = opened(camera="front"), observations(episode)
    blind = replace(seen, frames={"front": replace(seen.frames["front"], depth=None)})
    lacking = [
        (replace(seen, frames={}), TrainingError, "takes images of front; the cameras of this robot are: none"),
        (blind, TrainingError, "images with depth; camera front of this robot gives none"),
        (replace(seen, proprio=None), FieldError, "has no observations/proprio"),
        (replace(seen, values={}), FieldError, "has no streams/wrench/t_ns"),
    ]
    for one, error, facts in lacking:
        with pytest.raises(error, match=facts) as caught:
            policy(one)
        assert "\n" not in str(caught.value)


def test_the_only_camera_is_taken_by_a_policy_that_names_none(episode):
    policy, (seen, *_) = opened(), observations(episode)
    other = replace(seen, frames={"other": seen.frames["front"]})
    np.testing.assert_array_equal(policy(seen), policy(other))
    with pytest.raises(TrainingError, match=r"one camera; .*: front, other"):
        policy(replace(seen, frames={**seen.frames, **other.frames}))


def test_a_rate_that_is_none_is_refused():
    with pytest.raises(FormatError, match="wrench_hz"):
        opened(wrench_hz=-1.0)
