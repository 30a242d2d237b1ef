"""A robot that no code knows: two wrenches, a tactile array, a slow camera without depth, actions of seven numbers."""

import numpy as np

from svfl_data.schema.action_fields import pose_action
from svfl_data.schema.declarations import Declarations, wrench_stream
from svfl_data.schema.field import Field
from svfl_data.schema.observation import Frame, Observation
from svfl_data.schema.optics import Calibration, image_axes
from svfl_data.symmetry import Part

ACTION = pose_action(0.02, 0.1)
TACTILE = Field(path="streams/tactile/pressure", dtype="float32", shape=("T", 2, 6, 6), unit="kPa")
VELOCITY = Field(
    path="observations/tcp_velocity", dtype="float32", shape=("N+1", 3), unit="m/s", axes="base",
    components=("vx", "vy", "vz"), parts=(Part("vector", (0, 1)), Part("invariant", (2,))),
)  # fmt: skip
STEP_NS, FAST_NS, SLOW_NS, FRAME_NS = 100_000_000, 10_000_000, 20_000_000, 250_000_000
"""Periods of steps, wrenches, tactile arrays and pictures, [ns]."""
POSE = np.array([[0, 1, 0, 0.5], [1, 0, 0, 0], [0, 0, -1, 0.8], [0, 0, 0, 1.0]])

WORKSPACE = np.array([[0.3, 0.7], [-0.2, 0.2], [0.0, 0.3]])


def noise(seed: int, t_ns: np.ndarray, *shape: int) -> np.ndarray:
    """Numbers that depend on the time only."""
    rows = [np.random.default_rng([seed, int(t)]).normal(size=shape) for t in t_ns]
    return np.array(rows, np.float32).reshape(len(t_ns), *shape)


class FingerRobot:
    """A stand-in with a clock of its own, which does the same whenever it does the same again."""

    name, rate_hz, action = "finger_arm", 10.0, ACTION
    declarations = Declarations([ACTION, TACTILE, VELOCITY, *wrench_stream("left_finger")])

    def __init__(self):
        self.calls: list[str] = []
        self.tares = np.zeros((2, 6))
        self.home()
        self.calls.clear()

    def connect(self):
        self.calls.append("connect")

    def close(self):
        self.calls.append("close")

    def stop(self):
        self.calls.append("stop")

    def home(self):
        self.calls.append("home")
        self.now_ns, self.given_ns, self.place = 500_000_000, -1, np.zeros(3, np.float32)

    def tare(self):
        self.calls.append("tare")
        past = self.clock(FAST_NS, -1)
        self.tares = np.stack([noise(seed, past, 6).mean(axis=0, dtype=np.float64) for seed in (1, 2)])

    def step(self, action):
        assert (action.shape, action.dtype) == ((7,), np.float32)
        self.place = self.place + action[:3]
        self.now_ns += STEP_NS

    def clock(self, period_ns: int, after_ns: int) -> np.ndarray:
        """Times of a sensor after a time, up to now."""
        t_ns = np.arange(0, self.now_ns + 1, period_ns)
        return t_ns[t_ns > after_ns]

    def rows(self, after_ns: int) -> dict:
        fast, slow = self.clock(FAST_NS, after_ns), self.clock(SLOW_NS, after_ns)
        return {
            "streams/wrench": {"t_ns": fast, "wrench": noise(1, fast, 6)},
            "streams/left_finger": {"t_ns": fast, "wrench": noise(2, fast, 6)},
            "streams/tactile": {"t_ns": slow, "pressure": noise(3, slow, 2, 6, 6)},
        }

    def readings(self):
        found = self.rows(self.given_ns)
        self.given_ns = self.now_ns
        return found

    def observe(self):
        frame_ns = self.clock(FRAME_NS, -1)[-1:]
        picture = (128 + 20 * noise(4, frame_ns, 8, 10, 3)[0]).astype(np.uint8)
        recent = self.rows(-1)
        values = {f"{group}/{leaf}": rows for group, found in recent.items() for leaf, rows in found.items()}
        for group, tare in zip(("wrench", "left_finger"), self.tares, strict=True):
            values[f"streams/{group}/wrench"] = (values[f"streams/{group}/wrench"] - tare).astype(np.float32)
        values["observations/tcp_velocity"] = self.place
        frames = {"eye": Frame(picture, t_ns=int(frame_ns[0]))}
        return Observation(self.now_ns, frames, tcp=np.array([*self.place, 1.0, 0, 0, 0], np.float64), values=values)

    @property
    def cameras(self):
        return {"eye": Calibration(np.array([[9.0, 0, 4.5], [0, 9.0, 3.5], [0, 0, 1]]), POSE, image_axes(POSE))}

    def constants(self):
        tares = {"streams/wrench/tare": self.tares[0], "streams/left_finger/tare": self.tares[1]}
        return {
            "workspace": WORKSPACE,
            **tares,
            **self.cameras["eye"].constants("eye"),
        }
