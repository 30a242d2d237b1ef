"""Session in which a person records episodes one after the other until the person quits, without losing data."""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.recording.collection import software_versions
from collectors.recording.live_view import shown
from collectors.recording.loop import record_into, unwatched
from collectors.teleop.action_mapper import ActionMapper
from collectors.teleop.clock import Clock
from collectors.teleop.devices.device import Command, Device, DeviceLostError
from collectors.teleop.devices.script import InputLog
from collectors.teleop.screen import Screen
from collectors.teleop.setting import Setting
from collectors.teleop.view import View, felt, in_contact
from svfl_data.datasets.dataset import Dataset
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import INFLIGHT, NEXT
from svfl_data.recording.journal import SUFFIX
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.schema.episode import Meta
from svfl_data.schema.robot import Observation
from svfl_data.system.printable import say

ENDS = {
    Command.SUCCESS: "marked as success",
    Command.STOP: "stopped",
    Command.DISCARD: "discarded",
    Command.QUIT: "quit",
}
"""Commands that end an episode, and the reason for the end that the episode stores."""

ACHIEVED = "achieved"
"""Reason for the end of an episode whose task was achieved."""


class Session:
    """Session of one person at one device.

    Args:
        dataset: Dataset to record the episodes into.
        what: Settings of the dataset, which also give the robot.
        device: Device that the person steers with.
        screen: Screen that the person looks at.
        clock: Clock that times the actions.
        pace: Fraction of full speed at full deflection, 0 to 1.
        max_steps: Number of steps after which an episode ends.
        about: Facts of the session that every episode stores in addition, JSON values.
        log: Log that the inputs are written to. None writes no log.
        viewer: Address of the viewer on which episodes are shown as well, HOST:PORT. None shows them on no viewer.
        tell: Function that prints a message about the session.
    """

    def __init__(
        self, dataset: Dataset, what: Setting, device: Device, screen: Screen, clock: Clock, pace: float,
        max_steps: int, about: dict[str, Any], log: InputLog | None = None, viewer: str | None = None,
        tell: Callable[[str], None] = say,
    ) -> None:  # fmt: skip
        self._dataset, self._what, self._device, self._screen, self._clock = dataset, what, device, screen, clock
        self._robot, self._max_steps, self._log, self._viewer = what.opened, max_steps, log, viewer
        self._tell = tell
        self._about = {"device": device.name, "pace": pace, **about}
        cameras = self._robot.cameras
        self._camera = next(iter(cameras), None)
        seen = None if self._camera is None else cameras[self._camera]
        axes = np.eye(2) if seen is None else seen.image_axes  # without a known picture, as seen along the base axes
        self._mapper = ActionMapper(self._robot.action, axes, pace)
        self._message = "press enter to start"
        self._again: int | None = None  # index of the saved episode that the next one replaces
        self._saved: dict[int, bool] = {}  # whether each episode of this session succeeded, by index
        self._steps: int | None = None
        self._contact = self._interrupted = self._over = False
        self._lost: DeviceLostError | None = None

    def run(self) -> int:
        """Record until the person quits, and return the number of episodes that were saved.

        Raises:
            DeviceLostError: If the device was unplugged; what was recorded until then is saved.
            KeyboardInterrupt: If the process was told to end; what was recorded until then is saved.
            SvflError: If an episode cannot be written.
        """
        with self._dataset.writing() as self._held, self._signals():
            self._salvage()
            self._set_up()
            while self._ready():
                self._record()
                if self._over:
                    break
                self._set_up()
        if self._lost:
            raise self._lost
        if self._interrupted:
            raise KeyboardInterrupt
        return len(self._saved)

    def _salvage(self) -> None:
        """Make episodes of the journals that killed sessions have left."""
        if any((self._dataset.path / INFLIGHT).glob(f"*{SUFFIX}")):
            for action in repair_dataset(self._dataset.path):
                self._say(f"{action.path.name}: {action.done}, {action.detail}")

    def _set_up(self) -> None:
        """Set up the scene of the next episode, with the gripper at home."""
        self._scene = max([-1, *self._dataset.indices]) + 1 if self._again is None else self._again
        self._begun = self._what.begin(self._scene)
        self._workspace = self._robot.constants().get("workspace")
        self._device.begin(opened=self._begun.opened)
        self._mapper.begin()
        self._clock.begin()
        self._contact, self._steps = False, None

    def _ready(self) -> bool:
        """Wait for the start of an episode, and return False if the person quits instead."""
        while True:
            for command in self._tick(self._robot.observe()):
                if command in (Command.START, Command.QUIT):
                    return command is Command.START
                if command is Command.TARE:
                    self._tare()
                elif command is Command.AGAIN:
                    self._record_again()

    def _record_again(self) -> None:
        """Set up the scene of the last episode again, or at the second request the scene of the next episode."""
        if not self._saved:
            self._message = "there is no episode of this session to record again"
            return
        self._again = list(self._saved)[-1] if self._again is None else None
        self._message = f"{'the next' if self._again is None else 'the same'} scene: press enter to start"
        self._set_up()

    def _record(self) -> None:
        """Record one episode from its start to its end, and save it unless it was discarded."""
        what, robot, begun = self._what, self._robot, self._begun
        config = what.config() | begun.facts | {"teleop": self._about}
        index = self._scene if self._again is None else NEXT
        software = software_versions(*what.versions)
        meta = Meta(what.task, index, what.seed, "teleop", False, config, software, robot=robot.name)
        self._end, self._tares = "time was up", list[int]()
        self._steps, self._message = 0, "recording"
        self._clock.begin()
        constants = robot.constants()
        with EpisodeWriter(self._dataset, meta, constants, robot.declarations.own) as writer:
            with shown(self._viewer, self._scene) if self._viewer else nullcontext(unwatched) as watch:
                steps = record_into(writer, robot, self._act, self._max_steps, begun.success, begun.state, watch)
            if begun.success():
                self._end = ACHIEVED
            if steps and self._end != ENDS[Command.DISCARD]:
                self._save(writer, steps, constants)
            else:
                writer.discard()
                self._say("discarded; press enter to start")

    def _save(self, writer: EpisodeWriter, steps: int, constants: Mapping[str, np.ndarray]) -> None:
        """Seal the episode, with the last tare, even if it has faults: the person's work is kept, the faults noted."""
        success = self._end in (ACHIEVED, ENDS[Command.SUCCESS])
        facts: dict[str, Any] = {"ended": self._end, "tares_ns": self._tares}
        late = {
            path: values
            for path, values in self._robot.constants().items()
            if path.endswith("/tare") and not np.array_equal(values, constants[path])
        }
        if self._clock.paced:
            beats = self._clock.beats_ns(steps)
            facts |= self._clock.steadiness(beats)
            late["extra/teleop/beat_ns"] = beats
        self._held.check()
        writer.seal(
            success, constants=late, despite_faults=True, config={"teleop": self._about | facts},
            replaces=None if self._again is None else self._scene,
        )  # fmt: skip
        self._saved[self._scene] = success
        self._again = None
        words = f"{'success' if success else 'no success'} ({self._end}), {steps} steps"
        self._say(f"episode {self._scene} saved: {words}, {steps / self._robot.rate_hz:.1f} s")

    def _act(self, observation: Observation) -> NDArray[np.float32] | None:
        """Return the action that the person wants, as a policy does, or None when the person ends the episode."""
        for command in self._tick(observation):
            if command in ENDS:
                self._over = command is Command.QUIT
                self._end = "interrupted" if self._interrupted else "device lost" if self._lost else ENDS[command]
                return None
            if command is Command.TARE:
                self._tares.append(observation.t_ns)
                self._tare()
        self._steps = (self._steps or 0) + 1
        return self._mapper.action(self._reading)

    def _tare(self) -> None:
        self._robot.tare()
        tare = self._robot.constants().get("streams/wrench/tare")
        touching = " in contact, so again when the gripper is free" if self._contact else ""
        force = "" if tare is None else f": {np.linalg.norm(tare[:3]):.1f} N are subtracted"
        self._message = f"tared{touching}{force}"

    def _tick(self, observation: Observation) -> list[Command]:
        """Show the state, wait for the beat, and return the commands; a lost device or a signal means to quit."""
        wrench = felt(observation)
        before, self._contact = self._contact, in_contact(self._contact, wrench)
        if wrench is not None and self._contact and not before and self._steps:
            self._device.touch(float(np.linalg.norm(wrench[:3])))
        self._screen.show(self._view(observation, wrench))
        self._clock.wait()
        events, commands = self._screen.poll()
        try:
            for event in events:
                self._device.handle(event)
            self._reading = self._device.read()
            commands += self._device.commands()
        except DeviceLostError as error:
            self._lost = error
        if self._lost or self._interrupted:
            return [Command.QUIT]
        if self._log:
            self._log.append(self._reading, commands)
        return commands

    def _view(self, observation: Observation, wrench: NDArray[np.float64] | None) -> View:
        return View(
            task=self._what.task,
            observation=observation,
            camera=self._camera,
            calibration=None if self._camera is None else self._robot.cameras[self._camera],
            workspace=self._workspace,
            wrench=wrench,
            contact=self._contact,
            episode=self._scene,
            seconds=None if self._steps is None else self._steps / self._robot.rate_hz,
            saved=len(self._saved),
            succeeded=sum(self._saved.values()),
            message=self._message,
            pace=self._clock.words(),
        )

    def _say(self, message: str) -> None:
        self._message = message
        self._tell(message)

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """Make a signal end the session in order, so that the current episode is saved first."""

        def interrupt(number: int, frame: Any) -> None:  # noqa: ANN401 - Python's
            self._interrupted = True

        before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
