"""Specifications of a replay buffer for the same laws: the paper's inputs, a robot's own, and cameras that move."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.replay import RecordedSpec, ReplayBuffer, ReplayConfig
from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.episode import Episode
from svfl_data.schema.input_spec import PROPRIO, WRENCH, InputSpec, Window
from svfl_data.schema.optics import rotations
from svfl_data.schema.robot import image_axes
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import ACTION_PARTS, PROPRIO_PARTS, WRENCH_PARTS, act
from tests.helpers.own_robot import MOUNT, own_episode, tcp_poses
from tests.helpers.replay_episodes import make_demo, spec_of
from tests.helpers.replay_episodes import observation as paper_observation

STEPS = (5, 6, 3)
INPUTS = InputSpec(
    cameras=("front", "side", "wrist"),
    frames=2,
    windows={
        "streams/wrench/wrench": Window(64, rate_hz=500),
        "streams/left_finger/wrench": Window(20, rate_hz=250, resample=True),
        "streams/tactile/pressure": Window(4, rate_hz=100),
    },
    vectors=("observations/tcp_velocity", "observations/tcp_position"),
)
INVARIANT = ("cameras/wrist", "streams/left_finger/wrench", "streams/tactile/pressure")
T_SIDE = np.array([[-1.0, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, -1, 0.8], [0, 0, 0, 1]])  # looks down, a quarter turn away
GONE = "streams/left_finger"
"""Stream that begins after the first observation."""
LATE_NS = 1_060_000_000


def own_demo(index: int) -> Episode:
    """An episode whose cameras are square; one of them comes at half the rate and late, and a sensor begins late."""
    episode = own_episode(index, STEPS[index])
    rng, t_ns = np.random.default_rng([13, index]), episode.t_ns
    arrays = {path: array for path, array in episode.arrays.items() if not path.startswith(GONE)}
    late = episode.arrays[f"{GONE}/t_ns"] >= LATE_NS
    arrays |= {f"{GONE}/{leaf}": episode.arrays[f"{GONE}/{leaf}"][late] for leaf in ("t_ns", "wrench")}
    arrays |= {
        "cameras/front/color": rng.integers(0, 256, (len(t_ns), 12, 12, 3), dtype=np.uint8),
        "cameras/front/depth": rng.integers(500, 900, (len(t_ns), 12, 12), dtype=np.uint16),
        "cameras/front/image_axes": image_axes(episode.arrays["cameras/front/T_base_camera"]),
        "cameras/side/t_ns": t_ns[1::2] + 1,
        "cameras/side/color": rng.integers(0, 256, (len(t_ns[1::2]), 14, 16, 3), dtype=np.uint8),
        "cameras/side/intrinsics": np.diag([20.0, 20.0, 1.0]),
        "cameras/side/T_base_camera": T_SIDE,
        "cameras/side/image_axes": image_axes(T_SIDE),
    }
    return Episode(episode.meta, arrays, declarations=episode.declarations)


def flying(index: int, count: int) -> np.ndarray:
    """Any poses of a camera, (count, 4, 4); from some it looks up, so that the axes of its image are mirrored."""
    q = np.random.default_rng([17, index]).normal(size=(count, 4))
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = rotations(q / np.linalg.norm(q, axis=1, keepdims=True))
    return poses


def moving_demo(index: int) -> Episode:
    """The same; one camera flies and has its first frame late, one is on the gripper, whose first pose comes late."""
    episode = own_demo(index)
    arrays = {
        path: array
        for path, array in episode.arrays.items()
        if path not in ("cameras/side/T_base_camera", "cameras/side/image_axes")
    }
    t_ns = np.arange(episode.t_ns[1] - 7_000_000, episode.t_ns[-1], 10_000_000)
    arrays |= {
        "streams/tcp/t_ns": t_ns,
        "streams/tcp/pose": tcp_poses(t_ns),
        "cameras/wrist/T_tcp_camera": MOUNT,
        "cameras/side/T_base_camera_per_frame": flying(index, len(episode.arrays["cameras/side/t_ns"])),
    }
    return Episode(episode.meta, arrays, declarations=episode.declarations)


def row_of(episode: Episode, inputs: InputSpec, step: int) -> dict[str, np.ndarray]:
    """The observation at a step as the one cut gives it."""
    return {key: values[0] for key, values in cut_steps(episode, inputs, [step]).items()}


@dataclass(frozen=True)
class Kind:
    """A specification, with the episodes that it is tried on."""

    name: str
    make: Callable[[int], Episode]
    preload: Callable[..., ReplayBuffer]
    spec: Callable[[Episode], object]
    observation: Callable[[Episode, int], Mapping[str, np.ndarray]]
    expected: Callable[[Episode, int], dict[str, np.ndarray]]
    acted: Callable[[Episode, int], dict[str, np.ndarray]]
    crop: int | None

    def dataset(self, folder: Path) -> Dataset:
        dataset = Dataset.create_or_resume(folder, self.make(0).meta.task, 0, {})
        for index in range(len(STEPS)):
            write_episode(self.make(index), dataset.episode_path(index))
        return dataset

    def config(self, **settings) -> ReplayConfig:
        return replace(ReplayConfig(crop=self.crop), **settings)

    def lived(self, capacity: int = 1000, **settings) -> ReplayBuffer:
        """A buffer whose episodes were added step by step."""
        buffer = ReplayBuffer(capacity, self.spec(self.make(0)), self.config(**settings))
        for index in range(len(STEPS)):
            self.live(buffer, self.make(index))
        return buffer

    def live(self, buffer: ReplayBuffer, episode: Episode) -> None:
        buffer.begin_episode(self.observation(episode, 0))
        action = episode.arrays["actions/action"]
        for step in range(len(episode)):
            last = step + 1 == len(episode)
            buffer.add(action[step], self.observation(episode, step + 1), float(last), last, False)


def _paper_expected(episode: Episode, step: int) -> dict[str, np.ndarray]:
    inputs = InputSpec(cameras=("front",), windows={WRENCH: Window(64)}, vectors=(PROPRIO,))
    seen, camera = row_of(episode, inputs, step), episode.cameras["front"]
    color = seen["cameras/front/color"][0].transpose(2, 0, 1) / np.float32(255)
    depth = seen["cameras/front/depth"][0] * np.float32(camera.depth_scale)
    middle = np.array([0, *episode.centre, 0, 0])
    return {
        "image": np.concatenate([color, depth[None]]),
        "wrench": act(camera.image_axes, seen[WRENCH], WRENCH_PARTS),
        "proprio": act(camera.image_axes, seen[PROPRIO] - middle, PROPRIO_PARTS),
    }


PAPER = Kind(
    "paper",
    lambda index: make_demo(index, STEPS[index]),
    lambda dataset, config, **more: ReplayBuffer.from_demos(dataset, 3, config=config, **more),
    spec_of,
    paper_observation,
    _paper_expected,
    lambda episode, step: {
        "action": act(episode.cameras["front"].image_axes, episode.action[step], ACTION_PARTS),
    },
    16,
)


def _of_inputs(name: str, make: Callable[[int], Episode], invariant: tuple[str, ...]) -> Kind:
    return Kind(
        name,
        make,
        lambda dataset, config, **more: ReplayBuffer.from_demos(
            dataset, 3, config=config, inputs=INPUTS, invariant=invariant, **more
        ),
        lambda episode: RecordedSpec.of_episode(episode, INPUTS, invariant=invariant),
        lambda episode, step: row_of(episode, INPUTS, step),
        lambda episode, step: row_of(episode, INPUTS, step),
        lambda episode, step: {"actions/action": episode.arrays["actions/action"][step]},
        None,
    )


OWN = _of_inputs("own", own_demo, INVARIANT)
MOVING = _of_inputs("moving", moving_demo, INVARIANT[1:])
KINDS = [PAPER, OWN, MOVING]
