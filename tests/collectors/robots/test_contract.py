"""The contract of a robot, held by three with little in common: a simulation, a record, and one of the user's own."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from inspect import signature

import numpy as np
import pytest

from collectors.recording.loop import record, record_into
from collectors.robots.playback import Playback
from collectors.simulation.camera import CAMERAS
from collectors.simulation.world import World
from collectors.sources.policy import Bounded
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError, FieldError
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.sampling.cut import cut, cut_steps
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.schema.action_bounds import ActionBounds
from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.robot import Policy, Robot
from tests.helpers.collectors import SMALL
from tests.helpers.finger_robot import FingerRobot
from tests.helpers.own_robot import moving_episode, own_episode, tcp_poses

STEPS = 5
WITH_WRIST = replace(SMALL, cameras={**SMALL.cameras, "wrist": replace(CAMERAS["wrist"], height=16, width=16)})


@dataclass(frozen=True)
class Case:
    """A robot at the start of an episode, and what a policy may need of it."""

    begin: Callable[[], Robot]
    inputs: InputSpec


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with World(WITH_WRIST) as world:
        yield world


@pytest.fixture(params=["simulation", "record", "own"])
def case(request, world) -> Case:
    def simulation() -> World:
        world.reset(seed=3)
        world.add_box((0.02, 0.02, 0.02), (0.55, 0.0, 0.02), 0.1, 0.1, 0.5)
        world.tare()
        return world

    def record_of_own() -> Playback:
        return Playback(own_episode(0, steps=STEPS))

    def own() -> FingerRobot:
        robot = FingerRobot()
        robot.home()
        robot.tare()
        return robot

    finger = Window(8, rate_hz=100.0)
    return {
        "simulation": Case(
            simulation,
            InputSpec(
                ("front", "wrist"),
                windows={"streams/wrench/wrench": Window(64, rate_hz=500.0), "streams/joints/position": Window(1)},
                vectors=("observations/proprio",),
            ),
        ),
        "record": Case(
            record_of_own,
            InputSpec(
                ("front", "wrist"),
                windows={
                    "streams/wrench/wrench": Window(64, rate_hz=500.0),
                    "streams/left_finger/wrench": Window(20, rate_hz=500.0),
                    "streams/tactile/pressure": Window(4, rate_hz=100.0),
                },
                vectors=("observations/tcp_velocity", "observations/tcp_position"),
            ),
        ),
        "own": Case(
            own,
            InputSpec(
                ("eye",),
                windows={
                    "streams/wrench/wrench": finger,
                    "streams/left_finger/wrench": finger,
                    "streams/tactile/pressure": Window(3, rate_hz=25.0, resample=True),
                },
                vectors=("observations/tcp_velocity",),
            ),
        ),
    }[request.param]


def commands(robot: Robot) -> Policy:
    """Other actions at every step, in the bounds; those of a record are the recorded ones."""
    if isinstance(robot, Playback):
        return robot.policy
    bounds = ActionBounds.of(robot.action)
    assert bounds is not None
    rng = np.random.default_rng(0)
    return lambda _: rng.uniform(bounds.low, bounds.high).astype(np.float32)


def episode_of(robot: Robot, arrays: dict[str, np.ndarray]) -> Episode:
    meta = Meta("wiping", 0, 0, "robot", success=False, robot=robot.name)
    return Episode(meta, arrays, declarations=robot.declarations)


def same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for path, values in one.items():
        assert values.dtype == other[path].dtype, path
        np.testing.assert_array_equal(values, other[path], err_msg=path)


def test_a_robot_has_all_that_the_contract_asks_for(case):
    robot = case.begin()
    for name, member in vars(Robot).items():
        if not name.startswith("_"):
            assert hasattr(robot, name), name
            if callable(member):
                wanted = [one for one in signature(member).parameters if one != "self"]
                assert [*signature(getattr(robot, name)).parameters][: len(wanted)] == wanted, name
    assert robot.rate_hz > 0
    assert robot.declarations.at("actions/action") == robot.action
    assert set(robot.observe().frames) <= set(robot.cameras)


def test_the_loop_records_it_whole(case):
    robot = case.begin()
    episode = episode_of(robot, record(robot, commands(robot), STEPS))
    assert [finding for finding in check_episode(episode) if finding.severity == "error"] == []
    assert episode.action.shape == (STEPS, *robot.action.shape[1:])
    assert len(episode.t_ns) == STEPS + 1
    for path in case.inputs.windows:
        assert episode[f"{path.rpartition('/')[0]}/t_ns"][-1] > episode.t_ns[-2], path


class Remembering:
    """A policy with a past, of which only its calls are kept."""

    def __init__(self, robot: Robot) -> None:
        self.act, self.calls = commands(robot), []

    def forget(self) -> None:
        self.calls.append("forget")

    def __call__(self, seen):
        self.calls.append("act")
        return self.act(seen)


@pytest.mark.parametrize("wrapped", [False, True])
def test_a_policy_forgets_before_each_episode(case, wrapped):
    robot = case.begin()
    policy = Remembering(robot)
    for _ in range(2):
        robot = case.begin()
        record(robot, Bounded(policy, robot) if wrapped else policy, 2)
    assert policy.calls == ["forget", "act", "act"] * 2


def test_a_file_holds_what_memory_holds(case, tmp_path):
    robot = case.begin()
    kept = record(robot, commands(robot), STEPS)
    robot = case.begin()
    dataset = Dataset.create_or_resume(tmp_path, "wiping", 0, {})
    meta = Meta("wiping", 0, 0, "robot", success=False, robot=robot.name)
    with EpisodeWriter(dataset, meta, robot.constants(), robot.declarations.own) as writer:
        assert record_into(writer, robot, commands(robot), STEPS) == STEPS
        writer.seal()
    same(dataset.read(0).arrays, kept)
    assert dataset.read(0).declarations.at("actions/action") == robot.action


def test_a_record_of_it_plays_back_the_same(case):
    robot = case.begin()
    episode = episode_of(robot, record(robot, commands(robot), STEPS))
    playback = Playback(episode)
    for _ in range(2):  # as often as one likes
        playback.home()
        same(record(playback, playback.policy, STEPS), episode.arrays)
    assert (playback.name, playback.rate_hz) == (robot.name, pytest.approx(robot.rate_hz))
    with pytest.raises(CollectError, match=f"{STEPS} steps"):
        playback.step(np.zeros(5, np.float32))


def test_what_is_observed_is_what_is_cut_from_the_record(case):
    """A policy that acts sees the numbers that a training sees, at the rates that were declared."""
    robot, seen = case.begin(), []
    arrays = record(robot, commands(robot), STEPS, watch=lambda robot, one, action, readings: seen.append(one))
    episode = episode_of(robot, arrays)
    for step, one in enumerate(seen):
        live = cut(one.arrays, case.inputs, np.array([one.t_ns]), np.array([0]))
        recorded = cut_steps(episode, case.inputs, [step])
        for path, values in recorded.items():
            if not path.endswith("/age") and not (step == 0 and path.endswith("/padding")):
                np.testing.assert_allclose(live[path], values, rtol=0, atol=1e-6, err_msg=f"{path} at {step}")


def test_at_and_times_go_by_dataset_paths(case):
    seen = case.begin().observe()
    for path in (*case.inputs.windows, *case.inputs.vectors):
        values, times = seen.at(path), seen.times(path)
        assert times[-1] <= seen.t_ns
        if path.startswith("streams/"):
            assert len(values) == len(times)
            assert (np.diff(times) > 0).all()
        else:
            assert times.tolist() == [seen.t_ns]
    for camera in case.inputs.cameras:
        assert seen.at(f"cameras/{camera}/color").ndim == 3
    with pytest.raises(FieldError, match=r"no streams/sound/volume; it has observations/t_ns, .*streams/"):
        seen.at("streams/sound/volume")


def test_a_watcher_is_shown_every_row_once(case):
    robot, pieces, seen = case.begin(), {}, []

    def watch(robot, observation, action, readings):
        seen.append((observation.t_ns, None if action is None else action.tolist()))
        for group, columns in readings.items():
            for name, rows in columns.items():
                pieces.setdefault(f"{group}/{name}", []).append(rows)

    arrays = record(robot, commands(robot), STEPS, watch=watch)
    assert [t_ns for t_ns, _ in seen] == arrays["observations/t_ns"].tolist()
    assert [action for _, action in seen] == [None, *arrays["actions/action"].tolist()]
    for path, rows in pieces.items():
        np.testing.assert_array_equal(np.concatenate(rows), arrays[path], err_msg=path)


def test_an_action_of_another_length_is_refused_in_one_line(case):
    robot = case.begin()
    names = ", ".join(robot.action.components)
    with pytest.raises(CollectError, match=rf"shape \(3,\); robot {robot.name} takes .* numbers \({names}\)"):
        record(robot, lambda _: np.zeros(3, np.float32), STEPS)


def test_home_begins_a_new_episode(case):
    robot = case.begin()
    first = record(robot, commands(robot), STEPS)
    robot.home()
    robot.tare()
    again = record(robot, commands(robot), STEPS)
    assert again.keys() == first.keys()
    for path in first:
        if path.endswith("/t_ns"):
            np.testing.assert_array_equal(again[path], first[path], err_msg=path)


def test_a_world_is_connected_again():
    with World(SMALL) as world:
        world.reset(seed=0)
        before = world.observe()
        for _ in range(2):
            world.close()
            world.connect()
        world.connect()
        world.reset(seed=0)
        np.testing.assert_array_equal(world.observe().wrench, before.wrench)


def test_the_robot_is_stopped_whatever_happens():
    def fails(_):
        raise RuntimeError

    robot = FingerRobot()
    record(robot, lambda _: None, STEPS)
    assert robot.calls == ["stop"]
    with pytest.raises(RuntimeError):
        record(robot, fails, STEPS)
    assert robot.calls == ["stop", "stop"]


def test_a_slow_camera_gives_each_frame_once():
    robot = FingerRobot()
    arrays = record(robot, commands(robot), 10)
    assert arrays["cameras/eye/t_ns"].tolist() == [*range(500_000_000, 1_500_000_001, 250_000_000)]
    assert "cameras/eye/depth" not in arrays
    assert "observations/proprio" not in arrays


def test_a_reading_that_comes_late_is_a_fault_and_not_lost_in_silence(tmp_path):
    class Late(FingerRobot):
        """Its tactile array repeats itself."""

        def readings(self):
            return {**super().readings(), "streams/tactile": self.rows(-1)["streams/tactile"]}

    robot = Late()
    dataset = Dataset.create_or_resume(tmp_path, "wiping", 0, {})
    meta = Meta("wiping", 0, 0, "robot", success=False)
    with (
        EpisodeWriter(dataset, meta, robot.constants(), robot.declarations.own) as writer,
        pytest.raises(FieldError, match=r"streams/tactile: row .* ascend"),
    ):
        record_into(writer, robot, commands(robot), STEPS)
    assert robot.calls == ["stop"]


def test_an_episode_without_actions_has_the_width_of_the_robots():
    arrays = record(FingerRobot(), lambda _: None, STEPS)
    assert (arrays["actions/action"].shape, arrays["actions/action"].dtype) == ((0, 7), np.float32)


def test_a_record_plays_back_its_cameras_and_constants():
    episode = own_episode(0, steps=STEPS)
    playback = Playback(episode)
    front = playback.cameras["front"]
    assert front is not None
    np.testing.assert_array_equal(front.T_base_camera, episode.cameras["front"].T_base_camera)
    assert (front.depth_scale, front.T_tcp_camera) == (0.001, None)
    assert playback.cameras["wrist"] is None  # nobody recorded where the TCP was
    same(
        {path: values for path, values in playback.constants().items() if path.startswith("cameras/front")},
        front.constants("front"),
    )

    arms = {path.replace("/action", "/left"): values for path, values in episode.arrays.items()}
    left = replace(
        episode, arrays=arms, declarations=episode.declarations.with_own([pose_action(0.1, 0.1, "actions/left")])
    )
    with pytest.raises(FieldError, match="has no actions/action"):
        Playback(left)


def test_a_camera_on_the_gripper_tells_where_it_is(world):
    world.reset(seed=0)
    for action in ([1, 0.02, 0, -0.02, 0.1], [1, 0, -0.02, 0, -0.15]):
        world.step(action)
        frame, known = world.observe().frames["wrist"], world.cameras["wrist"]
        np.testing.assert_array_equal(frame.T_base_camera, known.T_base_camera)
        np.testing.assert_allclose(frame.image_axes, known.image_axes, atol=1e-12)
        np.testing.assert_allclose(frame.image_axes @ frame.image_axes.T, np.eye(2), atol=1e-12)
    assert world.observe().frames["front"].image_axes is None


def test_a_moving_camera_without_a_mount_is_recorded_with_its_poses():
    class Flying(FingerRobot):
        """A camera on a drone."""

        def observe(self):
            seen = super().observe()
            pose = np.eye(4)
            pose[:3, 3] = seen.t_ns / 1e9
            return replace(seen, frames={"eye": replace(seen.frames["eye"], T_base_camera=pose)})

        @property
        def cameras(self):
            return {"eye": None}

        def constants(self):
            return {}

    arrays = record(Flying(), commands(FingerRobot()), STEPS)
    poses, t_ns = arrays["cameras/eye/T_base_camera_per_frame"], arrays["cameras/eye/t_ns"]
    assert poses.shape == (len(t_ns), 4, 4)
    assert (np.diff(poses[:, 0, 3]) > 0).all()
    np.testing.assert_array_equal(
        Playback(episode_of(Flying(), arrays)).observe().frames["eye"].T_base_camera, poses[0]
    )


def slow_tcp(episode):
    """Poses of the TCP at 7 Hz, the first of them after the first observation."""
    t_ns = np.arange(episode.t_ns[0] + 20_000_000, episode.t_ns[-1], 143_000_000)
    tcp = {"streams/tcp/t_ns": t_ns, "streams/tcp/pose": tcp_poses(t_ns)}
    early = {"cameras/wrist/t_ns": episode["cameras/wrist/t_ns"] - 31_000_000}  # images are older than the observation
    return replace(episode, arrays={**episode.arrays, **tcp, **early})


def grey(episode):
    """One camera is grey and moves by itself, the other one has infrared beside its colours."""
    arrays = {path: values for path, values in episode.arrays.items() if not path.startswith("cameras/wrist/")}
    t_ns = episode["cameras/wrist/t_ns"] - 7_000_000
    poses = np.repeat(np.eye(4)[None], len(t_ns), axis=0)
    poses[:, :2, :2] = [[[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]] for a in np.linspace(0, 1, len(t_ns))]
    moving = {"t_ns": t_ns, "grey": episode["cameras/wrist/color"][..., 0], "T_base_camera_per_frame": poses}
    arrays |= {f"cameras/wrist/{name}": values for name, values in moving.items()}
    arrays["cameras/front/grey16"] = episode["cameras/front/color"][..., 1].astype(np.uint16) * 257
    return replace(episode, arrays=arrays)


@pytest.mark.parametrize("change", [lambda episode: episode, slow_tcp, grey])
def test_a_record_that_plays_back_is_cut_as_the_record_itself(change):
    """A policy that acts on a playback sees what a training sees, whatever images there are and however late a pose."""
    episode = change(moving_episode(0))
    inputs = InputSpec(cameras=("front", "wrist"), windows={"streams/tactile/pressure": Window(4, rate_hz=100)})
    playback, live = Playback(episode), LiveCut(inputs, episode.declarations)
    for step in range(len(episode) + 1):
        now, expected = live(playback.observe()), cut_steps(episode, inputs, [step])
        assert now.keys() == expected.keys()
        for path, values in expected.items():
            np.testing.assert_array_equal(now[path], values, err_msg=f"{path} at {step}")
        if step < len(episode):
            playback.step(np.zeros(7))
    playback.home()
    same(record(playback, playback.policy, len(episode)), episode.arrays)
