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
import rerun.blueprint as rrb

from svfl_data.errors import UsageError
from svfl_data.schema.robot import Observation, Readings, Robot
from svfl_data.signals.camera_poses import mounted
from svfl_data.system.own_process import OwnProcess
from svfl_data.viewer.entities import images, names, plots, scene
from svfl_data.viewer.entities.robot import robot_for

PERIOD_S = 0.1
"""Shortest time between two sendings, [s]; a person sees this delay as immediate."""
SHARE = 0.03
"""Largest share of the time that sending may take."""
GAP_NS = 500_000_000
"""Time between two episodes on the recording's clock, [ns]."""
BEHIND_S = 4.0
"""Time before the present that the plots show, [s]."""
TIMEOUT_S = 2.0


@dataclass(frozen=True, eq=False)
class Step:
    """One observation that waits to be sent.

    Attributes:
        t_ns: Time of the observation on the recording's clock, [ns].
        seen: The observation.
        action: Action that led to the observation, shape (5,). None at the first observation of an episode.
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
        self._mounts: dict[str, np.ndarray] = {}
        self._rig: Robot | None = None  # the robot of the episode that is being recorded
        self._known = 0  # number of readings of that episode that have been taken
        self._begins_ns = self._ends_ns = 0  # start and end of that episode, on the recording's clock
        self._before: Step | None = None
        self._next_s = 0.0
        Finalize(None, self.close, exitpriority=10)  # runs at the end of worker processes too, where atexit does not

    def __call__(self, robot: Robot, seen: Observation, action: np.ndarray | None) -> None:
        """Add an observation, and send the waiting data if it is time.

        Args:
            robot: Robot that is recorded.
            seen: Observation of the robot.
            action: Action that led to the observation, shape (5,). None at the first observation of an episode.

        Raises:
            UsageError: If called in another process than the one that created this object.
        """
        self.check_process()
        if action is None:
            self.finish()
            self._recording = self._recording or self._open(robot, seen)
            self._rig, self._known, self._before = robot, 0, None
            self._readings.append((np.array([self._ends_ns + 1]), np.full((1, 6), np.nan)))  # interrupts the curves
            self._begins_ns = self._ends_ns + GAP_NS
            self._titles.append((self._begins_ns, self.name))
        self._ends_ns = self._begins_ns + seen.t_ns
        before = self._before and replace(self._before, before=None)  # keeps no chain of all observations in memory
        self._before = Step(self._ends_ns, seen, action, before)
        self._steps.append(self._before)
        if time.monotonic() >= self._next_s:
            self._send()

    def finish(self) -> None:
        """End the current episode: take its last readings, after which the robot may be used for something else."""
        self._take_readings()
        self._rig = None

    def close(self) -> None:
        """Send the waiting data and end the recording; this does nothing in a forked process."""
        if self._recording is not None and self.in_own_process:
            self._send()
            self._recording.disconnect()
            self._recording = None

    def _open(self, robot: Robot, seen: Observation) -> rr.RecordingStream:
        """Begin the recording, and log everything that never changes."""
        recording = rr.RecordingStream(names.APPLICATION)
        recording.connect_grpc(self._address)
        # Not sent only as the default blueprint, because the viewer would then keep the blueprint of its last window.
        recording.send_blueprint(arrange(list(robot.cameras)))
        recording.send_recording_name("live")
        scene.log_environment(recording, "", robot.workspace)
        plots.log_styles(recording, "")
        self._robot = robot_for(len(seen.joints)) if len(seen.joints) else None
        if self._robot:
            self._robot.log(recording, "")
        for name, optics in robot.cameras.items():
            entity, frame = images.camera_entity("", name), seen.frames[name]
            if optics.T_tcp_camera is None:
                images.log_camera(recording, entity, optics.intrinsics, optics.T_base_camera, frame.color.shape[:2])
            else:
                self._mounts[name] = optics.T_tcp_camera
                images.log_lens(recording, entity, optics.intrinsics, frame.color.shape[:2])
            images.log_depth_style(recording, entity, frame.depth[None], optics.depth_scale, small=False)
        return recording

    def _take_readings(self) -> None:
        if self._rig is not None:
            t_ns, raw = self._rig.wrench_t_ns[self._known :], self._rig.wrench[self._known :]
            self._known += len(t_ns)
            self._readings.append((t_ns + self._begins_ns, raw - np.asarray(self._rig.tare_offset)))

    def _send(self) -> None:
        """Send all waiting data."""
        recording, steps, began = self._recording, self._steps, time.monotonic()
        if not steps or recording is None:
            return
        self._take_readings()
        t_ns, seen = np.array([step.t_ns for step in steps]), [step.seen for step in steps]
        proprio = np.stack([one.proprio for one in seen])
        scene.send_gripper(recording, "", t_ns, proprio, boxes=self._robot is None)
        if self._robot:
            self._robot.send(recording, "", t_ns, np.stack([one.joints for one in seen]))
        for name in seen[0].frames:
            entity = images.camera_entity("", name)
            if name in self._mounts:
                tcp = np.stack([np.asarray(one.tcp) for one in seen])
                images.send_poses(recording, entity, t_ns, mounted(tcp, self._mounts[name]))
            images.send_color(recording, entity, t_ns, np.stack([one.frames[name].color for one in seen]), small=False)
            images.send_depth(recording, entity, t_ns, np.stack([one.frames[name].depth for one in seen]), small=False)
        self._send_wrench(recording)
        self._send_moves(recording)
        for at_ns, words in self._titles:
            names.send(recording, names.ABOUT, np.array([at_ns]), rr.TextDocument.columns(text=[words]))
        self._steps, self._readings, self._titles = [], [], []
        ended = time.monotonic()
        self._next_s = ended + max(self._period_s, (ended - began) / self._share)

    def _send_wrench(self, recording: rr.RecordingStream) -> None:
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
        achieved = [
            step.seen.proprio[1:4] - step.before.seen.proprio[1:4] if step.before else nothing for step in self._steps
        ]
        plots.send_curve(recording, names.COMMANDED, t_ns, np.stack(commanded))
        plots.send_curve(recording, names.ACHIEVED, t_ns, np.stack(achieved))


def arrange(cameras: list[str]) -> rrb.Blueprint:
    """Return the layout of the window for live episodes, which follows the clock and shows the last seconds.

    Args:
        cameras: Names of the cameras.
    """
    recent = rr.TimeRange(
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-BEHIND_S), end=rrb.TimeRangeBoundary.cursor_relative()
    )
    curves = {
        "Force, N: x orange, y green, z blue": [names.FORCE_PLOT],
        "Torque, N m": [names.TORQUE_PLOT],
        "Move, m: thick commanded, thin achieved": [names.COMMANDED, names.ACHIEVED],
    }
    pictures = [
        rrb.Spatial2DView(
            origin=images.camera_entity("", camera), contents=[f"$origin/{kind}"], name=f"{camera}: {word}"
        )
        for camera in cameras
        for kind, word in (("color", "colour"), ("depth", "depth"))
    ]
    lines = [
        rrb.TimeSeriesView(
            contents=[f"+ {path}" for path in paths], name=name, axis_x=rrb.TimeAxis(view_range=recent),
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, paths in curves.items()
    ]  # fmt: skip
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                rrb.Spatial3DView(origin=names.SCENE, name="Live"), rrb.Horizontal(*pictures), row_shares=[3, 2]
            ),
            rrb.Vertical(*lines, rrb.TextDocumentView(origin=names.ABOUT, name="Now"), row_shares=[4, 4, 4, 1]),
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=names.TIMELINE, play_state="following"),
    )
