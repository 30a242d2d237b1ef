"""What is cut from a robot's observations is what is cut from the episode that they make."""

from dataclasses import replace

import numpy as np
import pytest

from svfl_data.errors import DatasetError, FieldError
from svfl_data.sampling.cut import cut_steps
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.observation import Frame, Observation
from svfl_data.signals.camera_poses import camera_poses
from tests.helpers.own_robot import moving_episode

INPUTS = InputSpec(
    cameras=("front", "wrist"),
    windows={
        "streams/left_finger/wrench": Window(64, rate_hz=500),
        "streams/tactile/pressure": Window(12, rate_hz=50, resample=True),
        "streams/tcp/pose": Window(3),
    },
    vectors=("observations/tcp_velocity",),
)


def observations(episode: Episode) -> list[Observation]:
    """What a robot would have observed: of each stream only the rows since the observation before."""
    found, before = [], -1
    poses = camera_poses(episode.arrays, "wrist", episode["cameras/wrist/t_ns"])
    for step, now in enumerate(episode.t_ns.tolist()):
        values = {"observations/tcp_velocity": episode["observations/tcp_velocity"][step]}
        for group in ("streams/left_finger", "streams/tactile", "streams/tcp"):
            t_ns = episode[f"{group}/t_ns"]
            new = (t_ns > before) & (t_ns <= now)
            values |= {path: rows[new] for path, rows in episode.arrays.items() if path.startswith(f"{group}/")}
        frames = {
            "front": Frame(episode["cameras/front/color"][step], episode["cameras/front/depth"][step]),
            "wrist": Frame(episode["cameras/wrist/color"][step], T_base_camera=poses[step]),
        }
        found.append(Observation(now, frames, values=values))
        before = now
    return found


def test_each_observation_is_cut_as_its_step():
    episode = moving_episode(0)
    live = LiveCut(INPUTS)
    for _ in range(2):  # the second time: another episode begins by itself
        for step, seen in enumerate(observations(episode)):
            now, expected = live(seen), cut_steps(episode, INPUTS, [step])
            assert now.keys() == expected.keys()
            for path, values in expected.items():
                np.testing.assert_allclose(now[path], values, atol=1e-6, err_msg=f"{step} {path}")


def test_the_past_is_needed():
    """A cut that forgets cannot tell the same: windows are longer than a step."""
    episode = moving_episode(0)
    live = LiveCut(INPUTS)
    for step, seen in enumerate(observations(episode)):
        live.forget()
        now = live(seen)
        if step > 2:
            expected = cut_steps(episode, INPUTS, [step])
            path = "streams/left_finger/wrench"
            assert not np.allclose(now[path], expected[path])
            assert now["streams/left_finger/padding"].any()


def test_no_more_is_kept_than_is_looked_back_on():
    live = LiveCut(InputSpec(windows={"streams/left_finger/wrench": Window(8)}))
    for number in range(200):
        t_ns = np.arange(25) * 2_000_000 + number * 50_000_000
        values = {"streams/left_finger/t_ns": t_ns, "streams/left_finger/wrench": np.zeros((25, 6), np.float32)}
        live(Observation(int(t_ns[-1]), values=values))
    assert sum(len(rows) for rows in live._past["streams/left_finger"].values()) == 2 * 8


def test_what_a_robot_does_not_observe_is_one_line():
    live = LiveCut(InputSpec(cameras=("side",), vectors=("observations/tcp_velocity",)))
    with pytest.raises(FieldError, match=r"observation: has no observations/tcp_velocity; it has .*proprio") as caught:
        live(Observation(0, proprio=np.zeros(5, np.float32)))
    assert "\n" not in str(caught.value)
    with pytest.raises(FieldError, match=r"no cameras/side/t_ns"):
        live(Observation(0, values={"observations/tcp_velocity": np.zeros(3)}))


@pytest.mark.parametrize("known", [lambda step: step > 2, lambda step: step < 2, lambda step: step == 3])
def test_a_pose_that_is_known_only_now_and_then_is_a_pose(known):
    """The first pose of the gripper may come late: the image of its camera is then as before, and its axes are told."""
    episode = moving_episode(0)
    live, told = LiveCut(InputSpec(cameras=("wrist",))), 0
    expected = cut_steps(episode, live.inputs)["cameras/wrist/image_axes"]
    for step, seen in enumerate(observations(episode)):
        frame = seen.frames["wrist"]
        if not known(step):
            seen = replace(seen, frames={"wrist": replace(frame, T_base_camera=None)})
        now = live(seen)
        np.testing.assert_array_equal(now["cameras/wrist/color"][0, 0], frame.color)
        if known(step):
            np.testing.assert_allclose(now["cameras/wrist/image_axes"][0], expected[step], atol=1e-6)
            told += 1
        elif told:
            np.testing.assert_array_equal(now["cameras/wrist/image_axes"][0, 0], np.eye(2))
    assert told


def stream(rate_hz: float, seconds: float, late: bool = False) -> list[Observation]:
    """Readings of a finger at a rate, observed at 20 Hz; with `late`, those of half a second come in its last 0.1 s."""
    t_ns = np.arange(1, int(rate_hz * seconds)) / rate_hz * 1e9
    if late:
        half = 5e8
        t_ns = t_ns // half * half + 4e8 + t_ns % half / 5
    t_ns = t_ns.astype(np.int64)
    found, before = [], -1
    for now in range(500_000_000, int(seconds * 1e9), 50_000_000):
        new = t_ns[(t_ns > before) & (t_ns <= now)]
        values = {"streams/left_finger/t_ns": new, "streams/left_finger/wrench": np.zeros((len(new), 6), np.float32)}
        found.append(Observation(now, values=values))
        before = now
    return found


@pytest.mark.parametrize("rate_hz", [350, 500, 700])
@pytest.mark.parametrize("late", [False, True])
def test_readings_that_a_busy_machine_delays_are_taken(rate_hz, late):
    live = LiveCut(InputSpec(windows={"streams/left_finger/wrench": Window(64, rate_hz=500)}))
    taken = [live(seen) for seen in stream(rate_hz, 4.0, late)]
    assert {one["streams/left_finger/wrench"].shape for one in taken} == {(1, 64, 6)}
    ages = np.array([one["streams/left_finger/age"][0] for one in taken])
    assert (ages.max() > 0.3) == late  # a late reading is taken, and its age says so


@pytest.mark.parametrize("rate_hz", [100, 1200])
def test_another_rate_is_refused_after_a_second(rate_hz):
    live = LiveCut(InputSpec(windows={"streams/left_finger/wrench": Window(64, rate_hz=500)}))
    with pytest.raises(DatasetError, match=rf"streams/left_finger has {rate_hz} Hz, but .* 64 readings at 500 Hz"):
        [live(seen) for seen in stream(rate_hz, 4.0)]
