"""Episodes of a robot with inputs and actions of its own, for tests of learning from them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import Part

VELOCITY = Field(
    path="observations/tcp_velocity", dtype="float32", shape=("N+1", 3), unit="m/s", axes="base",
    components=("vx", "vy", "vz"), parts=(Part("vector", (0, 1)), Part("invariant", (2,))),
)  # fmt: skip
POSITION = Field(
    path="observations/tcp_position", dtype="float32", shape=("N+1", 3), unit="m", axes="base", about="base origin",
    components=("x", "y", "z"), parts=(Part("vector", (0, 1)), Part("invariant", (2,))),
)  # fmt: skip
TACTILE = Field(path="streams/tactile/pressure", dtype="float32", shape=("T", 2, 4, 4), unit="kPa")
ACTION = pose_action(0.02, 0.1)
FIELDS = [ACTION, VELOCITY, POSITION, TACTILE, wrench_stream("left_finger", axes="sensor")[0]]
CENTRE = np.array([0.5, 0.1])
MOUNT = np.array([[0.0, 1, 0, 0.04], [1, 0, 0, -0.02], [0, 0, -1, 0.08], [0, 0, 0, 1]])
IMAGE_AXES = np.array([[0.0, 1.0], [-1.0, 0.0]])


def own_episode(index: int, steps: int = 6, success: bool = True) -> Episode:
    """Numbers that are all different; the second camera is on the gripper, the second wrench in a finger's axes."""
    rng = np.random.default_rng([11, index])
    t_ns = 1_000_000_000 + np.arange(steps + 1) * 50_000_000
    fast_ns = np.arange(0, t_ns[-1] + 1, 2_000_000)
    slow_ns = np.arange(0, t_ns[-1] + 1, 10_000_000)
    action = rng.uniform(-1, 1, (steps, 7)) * [0.02, 0.02, 0.02, 0.1, 0.1, 0.1, 1]
    action[:, 6] = rng.integers(0, 2, steps)
    arrays = {
        "observations/t_ns": t_ns,
        "observations/tcp_velocity": rng.normal(0, 0.1, (steps + 1, 3)).astype(np.float32),
        "observations/tcp_position": rng.uniform(0.2, 0.6, (steps + 1, 3)).astype(np.float32),
        "actions/action": action.astype(np.float32),
        "streams/wrench/t_ns": fast_ns,
        "streams/wrench/wrench": rng.normal(0, 2, (len(fast_ns), 6)).astype(np.float32),
        "streams/wrench/tare": rng.normal(0, 1, 6),
        "streams/left_finger/t_ns": fast_ns,
        "streams/left_finger/wrench": rng.normal(0, 1, (len(fast_ns), 6)).astype(np.float32),
        "streams/tactile/t_ns": slow_ns,
        "streams/tactile/pressure": rng.uniform(0, 5, (len(slow_ns), 2, 4, 4)).astype(np.float32),
        "workspace": np.array([[0.3, 0.7], [-0.1, 0.3], [0.0, 0.3]]),
    }
    for name, size in (("front", (10, 12)), ("wrist", (10, 10))):
        arrays |= {
            f"cameras/{name}/t_ns": t_ns,
            f"cameras/{name}/color": rng.integers(0, 256, (steps + 1, *size, 3), dtype=np.uint8),
            f"cameras/{name}/intrinsics": np.array([[20.0, 0, 5], [0, 20.0, 5], [0, 0, 1]]),
        }
    arrays |= {
        "cameras/front/depth": rng.integers(500, 900, (steps + 1, 10, 12), dtype=np.uint16),
        "cameras/front/depth_scale": np.array(0.001),
        "cameras/front/T_base_camera": np.array([[0, 1, 0, 0.5], [1, 0, 0, 0], [0, 0, -1, 0.8], [0, 0, 0, 1.0]]),
        "cameras/front/image_axes": IMAGE_AXES,
        "cameras/wrist/T_tcp_camera": np.eye(4),
    }
    rates = {"rates_hz": {"streams/wrench": 500, "streams/left_finger": 500, "streams/tactile": 100}}
    meta = Meta("wiping", index, 0, "robot", success, config=rates, instruction="wipe", robot="UR5e")
    return Episode(meta, arrays, declarations=Declarations(FIELDS))


def tcp_poses(t_ns: np.ndarray) -> np.ndarray:
    """A gripper that points straight down, with another yaw at every time; position [m], quat_xyzw, (K, 7)."""
    yaw = 0.4 * t_ns / 1e9
    down = np.stack([np.cos(yaw / 2), np.sin(yaw / 2), np.zeros_like(yaw), np.zeros_like(yaw)], axis=1)
    return np.concatenate([np.stack([0.4 + 0.1 * yaw, 0.1 * yaw, 0.2 - 0.01 * yaw], axis=1), down], axis=1)


def moving_episode(index: int) -> Episode:
    """The same, with the poses of the TCP at 100 Hz, so that the pose of the camera on the gripper is known."""
    episode = own_episode(index)
    t_ns = np.arange(3_000_000, episode.t_ns[-1], 10_000_000)
    tcp = {"streams/tcp/t_ns": t_ns, "streams/tcp/pose": tcp_poses(t_ns), "cameras/wrist/T_tcp_camera": MOUNT}
    return replace(episode, arrays={**episode.arrays, **tcp})


def own_dataset(folder, count: int = 5, episode: Callable[[int], Episode] = own_episode) -> Dataset:
    """A dataset of such episodes."""
    dataset = Dataset.create_or_resume(folder, "wiping", 0, {})
    for index in range(count):
        write_episode(episode(index), dataset.episode_path(index))
    return dataset
