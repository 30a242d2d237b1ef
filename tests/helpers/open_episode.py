"""Episodes as a new user records them: many sensors of their own, or only a few joints."""

import numpy as np

from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.action_fields import joint_action, pose_action
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.storage.store import write_episode
from svfl_data.symmetry import Part

JOINTS = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
OWN = Declarations([
    pose_action(max_move=0.02, max_turn=0.1),
    *wrench_stream("left_finger", axes="sensor", doc="Sensor in the left finger.")[:1],
    Field(path="streams/tactile/pressure", dtype="float32", shape=("T", 2, 16, 16), unit="kPa", doc="Both fingertips."),
    Field(
        path="observations/tcp_velocity", dtype="float32", shape=("N+1", 3), unit="m/s", axes="base",
        components=("vx", "vy", "vz"), parts=(Part("vector", (0, 1)), Part("invariant", (2,))),
        assumed=("axes", "parts"), doc="Velocity of the TCP.",
    ),
    Field(path="streams/notes/words", dtype="S40", shape=("T",), doc="What the operator said."),
])  # fmt: skip
META = {
    "source": "teleop",
    "success": True,
    "instruction": "put the cup on the plate",
    "robot": "ur5e",
    "operator": "A",
}


def clock(hz: float, seconds: float) -> np.ndarray:
    """Times of a stream from 0 to the end, [ns]."""
    return (np.arange(int(seconds * hz) + 1) * (1e9 / hz)).astype(np.int64)


def picture(rng: np.random.Generator, frames: int, height: int, width: int) -> np.ndarray:
    """Colour images of a square that moves, with noise."""
    images = rng.integers(40, 80, (frames, height, width, 3), dtype=np.uint8)
    for row in range(frames):
        left = row * (width - 8) // max(1, frames - 1)
        images[row, height // 3 : height // 3 + 8, left : left + 8] = (220, 120, 40)
    return images


def open_arrays(seed: int = 0, steps: int = 20) -> dict[str, np.ndarray]:
    """Arrays of an episode of a UR5e with a second wrench sensor, tactile sensors and a camera on the gripper."""
    rng, seconds = np.random.default_rng(seed), steps * 0.05
    t_ns, fast, slow, frames = clock(20, seconds), clock(500, seconds), clock(100, seconds), clock(10, seconds)
    s = fast / 1e9
    angle = 0.3 * np.sin(2 * np.pi * s)
    tcp = np.stack([0.4 + 0.1 * s, 0.1 * np.sin(3 * s), 0.3 - 0.1 * s, *np.zeros((2, len(s)))], axis=1)
    tcp = np.concatenate([tcp, np.sin(angle / 2)[:, None], np.cos(angle / 2)[:, None]], axis=1)
    load = np.where(s[:, None] > 0.6 * seconds, [2.0, 0.0, 15.0, 0.1, 0.3, 0.0], 0.0)
    tare = np.array([0.5, -0.2, -9.0, 0.02, 0.01, 0.0])
    spot = np.exp(-((np.indices((16, 16)) - 8) ** 2).sum(axis=0) / 18)
    press = np.clip((slow / 1e9 - 0.6 * seconds) * 40, 0, None)[:, None, None, None]
    front, fixed = picture(rng, len(frames), 48, 64), np.eye(4)
    fixed[:3, :3], fixed[:3, 3] = [[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [1.2, 0.0, 0.3]
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = np.diag([1.0, -1.0, -1.0]), [0.05, 0.0, 0.05]
    move = np.zeros((steps, 7), np.float32)
    move[1:, :3], move[:, 6] = [0.005, 0.002, -0.005], 1.0
    return {
        "observations/t_ns": t_ns,
        "observations/tcp_velocity": rng.normal(0, 0.05, (steps + 1, 3)).astype(np.float32),
        "actions/action": move,
        "streams/wrench/t_ns": fast,
        "streams/wrench/wrench": (load + tare + rng.normal(0, 0.05, (len(fast), 6))).astype(np.float32),
        "streams/wrench/tare": tare,
        "streams/left_finger/t_ns": slow,
        "streams/left_finger/wrench": rng.normal(0, 0.2, (len(slow), 6)).astype(np.float32),
        "streams/tactile/t_ns": slow,
        "streams/tactile/pressure": (press * spot * [[[1.0]], [[0.5]]] + rng.uniform(0, 0.2, (len(slow), 2, 16, 16)))
        .astype(np.float32),
        "streams/joints/t_ns": fast,
        "streams/joints/position": np.stack([np.sin(s + k) for k in range(6)], axis=1).astype(np.float32),
        "streams/joints/velocity": np.stack([np.cos(s + k) for k in range(6)], axis=1).astype(np.float32),
        "streams/tcp/t_ns": fast,
        "streams/tcp/pose": tcp,
        "streams/notes/t_ns": np.array([int(0.2e9), int(0.7e9)]),
        "streams/notes/words": np.array([b"reaching", b"contact"], "S40"),
        "cameras/front/t_ns": frames,
        "cameras/front/color": front,
        "cameras/front/depth": (9000 - 60 * np.arange(48)[:, None] + rng.integers(0, 50, (len(frames), 48, 64)))
        .astype(np.uint16),
        "cameras/front/depth_scale": np.array(1e-4),
        "cameras/front/intrinsics": np.array([[60.0, 0.0, 31.5], [0.0, 60.0, 23.5], [0.0, 0.0, 1.0]]),
        "cameras/front/T_base_camera": fixed,
        "cameras/wrist/t_ns": frames,
        "cameras/wrist/color": picture(rng, len(frames), 32, 32),
        "cameras/wrist/intrinsics": np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 15.5], [0.0, 0.0, 1.0]]),
        "cameras/wrist/T_tcp_camera": mount,
    }  # fmt: skip


def open_episode(index: int = 0, seed: int = 0, steps: int = 20) -> Episode:
    """The episode of the UR5e."""
    return Episode(Meta("cups", index, seed, **META), open_arrays(seed + index, steps), declarations=OWN)


BARE = Declarations([joint_action([(-3.2, 3.2)] * 6, JOINTS)])


def bare_episode(index: int = 0, seed: int = 0, steps: int = 20) -> Episode:
    """An episode of nothing but joint commands."""
    rng = np.random.default_rng(seed + index)
    action = np.cumsum(rng.normal(0, 0.02, (steps, 6)), axis=0).astype(np.float32)
    arrays = {"observations/t_ns": clock(20, steps * 0.05), "actions/action": action}
    return Episode(Meta("cups", index, seed, "robot", True), arrays, declarations=BARE)


def dataset_of(folder, make, count: int = 3) -> Dataset:
    """A dataset of episodes of one kind."""
    dataset = Dataset.create_or_resume(folder, "cups", 0, {})
    for index in range(count):
        write_episode(make(index), dataset.episode_path(index))
    return dataset
