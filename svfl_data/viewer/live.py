"""Live display of episodes in a running viewer while they are recorded.

Recorded data are buffered and sent a few times a second, in columns, by the same functions that write files. The
duration of each sending decides when the next one may begin, so that the recording loop never loses more than `SHARE`
of its time. All episodes of a process are in one recording, one after the other on the clock of that recording.
"""

import socket
import time
from dataclasses import dataclass, replace
from multiprocessing.util import Finalize

import numpy as np
import rerun as rr

from svfl_data.errors import UsageError
from svfl_data.schema.robot import Observation, Readings, Robot
from svfl_data.system.own_process import OwnProcess
from svfl_data.viewer.entities import names, plots, scene
from svfl_data.viewer.entities.episode_source import PLANAR
from svfl_data.viewer.entities.robot import robot_for
from svfl_data.viewer.live_cameras import LiveCamera
from svfl_data.viewer.live_fields import LiveFields
from svfl_data.viewer.live_layout import arrange

PERIOD_S = 0.1
"""Shortest time between two sendings, [s]; a person sees this delay as immediate."""
SHARE = 0.03
"""Largest share of the time that sending may take."""
GAP_NS = 500_000_000
"""Time between two episodes on the recording's clock, [ns]."""
TIMEOUT_S = 2.0
WRENCH = "streams/wrench"


@dataclass(frozen=True, eq=False)
class Step:
    """One observation that waits to be sent.

    Attributes:
        t_ns: Time of the observation on the recording's clock, [ns].
        seen: The observation.
        action: Action that led to the observation, shape (A,). None at the first observation of an episode.
        before: Step of the previous observation. None at the first observation of an episode.
    """

    t_ns: int
    seen: Observation
    action: np.ndarray | None
    before: "Step | None"


class Live(OwnProcess):
    """Stream of episodes to a running viewer, one after the other; call the object with every observation.

    Attributes:
        name: Name of the episode that begins next, which the viewer shows.

    Args:
        address: Address HOST:PORT of a running viewer, such as one started with ``rerun``.
        period_s: Shortest time between two sendings, [s].
        share: Largest share of the time that sending may take.

    Raises:
        UsageError: If no program listens at the address.
    """

    def __init__(self, address: str, period_s: float = PERIOD_S, share: float = SHARE) -> None:
        host, _, port = address.rpartition(":")
        try:
            socket.create_connection((host, int(port)), timeout=TIMEOUT_S).close()
        except (OSError, ValueError) as error:
            raise UsageError(f"--rerun {address}: no viewer listens there ({error}); start one with: rerun") from error
        self.name = "live"
        self._period_s, self._share = period_s, share
        self._address = f"rerun+http://{address}/proxy"
        self._recording: rr.RecordingStream | None = None
        self._steps: list[Step] = []
        self._readings: list[tuple[np.ndarray, np.ndarray]] = []  # times and tared wrenches that wait to be sent
        self._titles: list[tuple[int, str]] = []
        self._begins_ns = self._ends_ns = 0  # start and end of that episode, on the recording's clock
        self._before: Step | None = None
        self._next_s = 0.0
        Finalize(None, self.close, exitpriority=10)  # runs at the end of worker processes too, where atexit does not

    def __call__(self, robot: Robot, seen: Observation, action: np.ndarray | None, readings: Readings) -> None:
        """Add an observation, and send the waiting data if it is time.

        Args:
            robot: Robot that is recorded.
            seen: Observation of the robot.
            action: Action that led to the observation, shape (A,). None at the first observation of an episode.
            readings: Readings since the observation before.

        Raises:
            UsageError: If called in another process than the one that created this object.
        """
        self.check_process()
        if action is None:
            self._recording = self._recording or self._open(robot, seen, readings)
            self._before = None
            self._readings.append((np.array([self._ends_ns + 1]), np.full((1, 6), np.nan)))  # interrupts the curves
            self._fields.begin(self._ends_ns + 1)
            self._begins_ns = self._ends_ns + GAP_NS
            self._titles.append((self._begins_ns, self.name))
        self._ends_ns = self._begins_ns + seen.t_ns
        before = self._before and replace(self._before, before=None)  # keeps no chain of all observations in memory
        self._before = Step(self._ends_ns, seen, action, before)
        self._steps.append(self._before)
        if WRENCH in readings:
            tare = robot.constants().get(f"{WRENCH}/tare", np.zeros(6))
            self._readings.append((readings[WRENCH]["t_ns"] + self._begins_ns, readings[WRENCH]["wrench"] - tare))
        self._fields.add(self._begins_ns, seen, action, before.t_ns if before else 0, readings)
        if time.monotonic() >= self._next_s:
            self._send()

    def close(self) -> None:
        """Send the waiting data and end the recording; this does nothing in a forked process."""
        if self._recording is not None and self.in_own_process:
            self._send()
            self._recording.disconnect()
            self._recording = None

    def _open(self, robot: Robot, seen: Observation, readings: Readings) -> rr.RecordingStream:
        """Begin the recording, and log everything that never changes."""
        recording = rr.RecordingStream(names.APPLICATION)
        recording.connect_grpc(self._address)
        self._planar, wrench = robot.action.components == PLANAR, WRENCH in readings
        parts = {"wrench": wrench, "motion": self._planar}
        scene.log_environment(recording, "", robot.constants().get("workspace"))
        plots.log_styles(recording, "", [name for name, there in parts.items() if there])
        self._robot = None if seen.joints is None or not len(seen.joints) else robot_for(len(seen.joints))
        if self._robot:
            self._robot.log(recording, "")
        known = robot.cameras
        self._cameras = {name: LiveCamera(recording, name, known.get(name), seen) for name in seen.frames}
        drawn_as_curves = None if self._planar else robot.action
        self._fields = LiveFields(recording, robot.declarations, drawn_as_curves, seen, readings)
        # Not sent only as the default blueprint, because the viewer would then keep the blueprint of its last window.
        recording.send_blueprint(arrange(self._cameras, self._fields.views, wrench, self._planar))
        recording.send_recording_name("live")
        return recording

    def _send(self) -> None:
        """Send all waiting data."""
        recording, steps, began = self._recording, self._steps, time.monotonic()
        if not steps or recording is None:
            return
        t_ns, seen = np.array([step.t_ns for step in steps]), [step.seen for step in steps]
        self._send_pose(recording, t_ns, seen)
        for name, camera in self._cameras.items():
            there = np.array([name in one.frames for one in seen])
            if there.any():
                camera.send(recording, t_ns[there], [one for one in seen if name in one.frames])
        self._send_wrench(recording)
        if self._planar:
            self._send_moves(recording)
        self._fields.send(recording)
        for at_ns, words in self._titles:
            names.send(recording, names.ABOUT, np.array([at_ns]), rr.TextDocument.columns(text=[words]))
        self._steps, self._readings, self._titles = [], [], []
        ended = time.monotonic()
        self._next_s = ended + max(self._period_s, (ended - began) / self._share)

    def _send_pose(self, recording: rr.RecordingStream, t_ns: np.ndarray, seen: list[Observation]) -> None:
        """Send where the gripper and the arm are, as far as the robot states it."""
        proprio = [one.proprio for one in seen if one.proprio is not None]
        tcp = [one.tcp for one in seen if one.tcp is not None]
        joints = [one.joints for one in seen if one.joints is not None]
        if len(proprio) == len(seen):
            scene.send_gripper(recording, "", t_ns, np.stack(proprio), boxes=self._robot is None)
        elif len(tcp) == len(seen):
            scene.send_tcp(recording, "", t_ns, np.stack(tcp))
        if self._robot and len(joints) == len(seen):
            self._robot.send(recording, "", t_ns, np.stack(joints))

    def _send_wrench(self, recording: rr.RecordingStream) -> None:
        if all(np.isnan(values).all() for _, values in self._readings):  # the robot has no such sensor
            return
        t_ns = np.concatenate([times for times, _ in self._readings])
        tared = np.concatenate([values for _, values in self._readings])
        plots.send_curve(recording, names.FORCE_PLOT, t_ns, tared[:, :3])
        plots.send_curve(recording, names.TORQUE_PLOT, t_ns, tared[:, 3:])
        scene.send_arrows(recording, "", t_ns[-1:], tared[-1:])

    def _send_moves(self, recording: rr.RecordingStream) -> None:
        """Send the commanded and the achieved displacement, each at the time of the observation before the action."""
        nothing = np.full(3, np.nan)  # for an episode's first observation: breaks the curves where the last one ended
        t_ns = np.array([(step.before or step).t_ns for step in self._steps])
        t_ns -= [0 if step.before else step.seen.t_ns + GAP_NS for step in self._steps]
        commanded = [nothing if step.action is None else step.action[1:4] for step in self._steps]
        achieved = [_moved(step.before.seen, step.seen) if step.before else nothing for step in self._steps]
        plots.send_curve(recording, names.COMMANDED, t_ns, np.stack(commanded))
        plots.send_curve(recording, names.ACHIEVED, t_ns, np.stack(achieved))


def _moved(before: Observation, after: Observation) -> np.ndarray:
    """Return the displacement of the TCP between two observations, shape (3,), [m]; NaN if the robot does not tell."""
    if before.proprio is None or after.proprio is None:
        return np.full(3, np.nan)
    return np.asarray(after.proprio[1:4] - before.proprio[1:4])
