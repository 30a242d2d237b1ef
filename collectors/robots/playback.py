"""A recorded episode as a robot: what was recorded is observed again, whatever is commanded."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import CollectError, FieldError
from svfl_data.sampling.windows import latest
from svfl_data.schema.action_fields import ACTION
from svfl_data.schema.clocks import mean_hz
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode
from svfl_data.schema.field import Field
from svfl_data.schema.fields import EXTRA, camera_names
from svfl_data.schema.input_spec import WINDOW
from svfl_data.schema.optics import Calibration, image_axes
from svfl_data.schema.robot import Frame, Observation
from svfl_data.signals.camera_poses import camera_poses, moves

CLOCKED = ("streams/", "cameras/")
"""Beginnings of the paths of groups with clocks of their own."""


class Playback:
    """Robot that plays a recorded episode back (`svfl_data.schema.robot.Robot`).

    A step goes on to the next recorded observation and ignores the action. With the recorded actions (`policy`), the
    recording of a playback has the arrays of the episode, except for actions other than ``actions/action``.

    Attributes:
        name: Name of the robot that the episode was recorded on; empty if unknown.
        rate_hz: Mean rate of the observations, [Hz]; 0 if there is only one.
        declarations: Declarations of the episode's arrays.
        action: Declaration of ``actions/action``.

    Example:
        >>> from collectors.recording.loop import record
        >>> playback = Playback(dataset[0])
        >>> arrays = record(playback, playback.policy, max_steps=len(dataset[0]))
        >>> np.array_equal(arrays["streams/wrench/wrench"], dataset[0].wrench)
        True
    """

    def __init__(self, episode: Episode) -> None:
        """Begin at the first observation.

        Args:
            episode: The episode.

        Raises:
            FieldError: If the episode has no ``actions/action``, as one of two arms.
        """
        declared = episode.declarations.at(ACTION)
        if ACTION not in episode.arrays or declared is None:
            raise FieldError(f"{episode.name}: has no {ACTION}, so it cannot be played back as one robot")
        own = [one for one in episode.declarations.own if one.group != "actions" or one.path == ACTION]
        self.name, self.rate_hz = episode.meta.robot, mean_hz(episode.t_ns)
        self.action: Field = declared
        self.declarations = Declarations(own)
        self._episode, self._arrays = episode, episode.arrays
        self._groups: dict[str, list[str]] = {}  # names of the arrays of each group with a clock
        for path in self._arrays:
            group, _, leaf = path.rpartition("/")
            if path.startswith(CLOCKED) and self._grows(path):
                self._groups.setdefault(group, []).append(leaf)
        self.home()

    def connect(self) -> None:
        """Do nothing, since there is nothing to connect to."""

    def home(self) -> None:
        """Go back to the first observation."""
        self._step = 0
        self._given = dict.fromkeys(self._groups, 0)

    def tare(self) -> None:
        """Do nothing, since the recorded tares are those of the episode."""

    def stop(self) -> None:
        """Do nothing, since nothing moves."""

    def close(self) -> None:
        """Do nothing, since nothing is open."""

    def step(self, action: NDArray[np.float32]) -> None:
        """Go on to the next recorded observation.

        Args:
            action: Action, shape (A,), which is ignored.

        Raises:
            CollectError: If there is no further observation.
        """
        if self._step == len(self._episode):
            raise CollectError(
                f"{self._episode.name}: has {len(self._episode)} steps, no further one can be played back"
            )
        self._step += 1

    def policy(self, observation: Observation) -> NDArray[np.float32] | None:
        """Return the recorded action of this step, shape (A,), or None at the end (`svfl_data.schema.robot.Policy`).

        Args:
            observation: Observation, which is ignored.
        """
        actions = self._arrays[ACTION]
        return np.asarray(actions[self._step]) if self._step < len(self._episode) else None

    def observe(self) -> Observation:
        """Return what was recorded at this step: rows of the observations, and the latest of all streams."""
        now_ns = int(self._episode.t_ns[self._step])
        values: dict[str, NDArray[Any]] = {}
        for path in self._arrays:
            if path.startswith("observations/") and path not in ("observations/t_ns", "observations/proprio"):
                values[path] = np.asarray(self._arrays[path][self._step])
        for group in self._groups:
            if group.startswith("streams/"):
                values |= self._window(group, now_ns)
        frames = {}
        for camera in camera_names(self._arrays):
            row = latest(self._arrays[f"cameras/{camera}/t_ns"], now_ns)
            if row < 0:
                continue
            if "color" in self._groups[f"cameras/{camera}"]:
                frames[camera] = self._frame(camera, row)
            values |= self._further_images(camera, row)
        wrench = values.get("streams/wrench/wrench")  # where there are fewer readings, the first one is repeated
        position, tcp = values.get("streams/joints/position"), values.get("streams/tcp/pose")
        return Observation(
            now_ns,
            frames,
            wrench=None if wrench is None else wrench[np.maximum(np.arange(-WINDOW, 0), -len(wrench))],
            proprio=self._row("observations/proprio"),
            joints=None if position is None else position[-1],
            tcp=None if tcp is None else tcp[-1],
            values=values,
        )

    def readings(self) -> dict[str, dict[str, NDArray[Any]]]:
        """Return the rows of all streams and cameras since the last call; at the last step also those after it."""
        found = {}
        for group, leaves in self._groups.items():
            clock, start = self._arrays[f"{group}/t_ns"], self._given[group]
            stop = latest(clock, int(self._episode.t_ns[self._step])) + 1
            stop = len(clock) if self._step == len(self._episode) else stop
            self._given[group] = stop
            found[group] = {leaf: np.asarray(self._arrays[f"{group}/{leaf}"][start:stop]) for leaf in leaves}
        return found

    @property
    def cameras(self) -> Mapping[str, Calibration | None]:
        """Calibration of each camera by name; None for one whose lens or pose was not recorded."""
        return {camera: self._calibration(camera) for camera in camera_names(self._arrays)}

    def constants(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the episode has once, and all arrays below ``extra/``, by dataset path."""
        return {path: np.asarray(values) for path, values in self._arrays.items() if self._once(path)}

    def _grows(self, path: str) -> bool:
        declared = self._episode.declarations.at(path)
        return declared is not None and declared.grows

    def _once(self, path: str) -> bool:
        return path.startswith(EXTRA) or not self._grows(path)

    def _row(self, path: str) -> NDArray[Any] | None:
        return np.asarray(self._arrays[path][self._step]) if path in self._arrays else None

    def _window(self, group: str, now_ns: int) -> dict[str, NDArray[Any]]:
        """Return the latest rows of a stream, tared: `WINDOW` rows, or all since the step before if those are more."""
        clock = self._arrays[f"{group}/t_ns"]
        stop = latest(clock, now_ns) + 1
        before_ns = int(self._episode.t_ns[max(0, self._step - 1)])
        start = max(0, min(stop - WINDOW, latest(clock, before_ns) + 1))
        if stop == 0:
            return {}
        found = {}
        for leaf in self._groups[group]:
            found[f"{group}/{leaf}"] = np.asarray(self._arrays[f"{group}/{leaf}"][start:stop])
        tare = self._arrays.get(f"{group}/tare")
        for path, part in found.items():
            if tare is not None and tare.shape == part.shape[1:]:
                found[path] = (part - tare).astype(part.dtype)
        return found

    def _frame(self, camera: str, row: int) -> Frame:
        group, leaves = f"cameras/{camera}", self._groups[f"cameras/{camera}"]
        return Frame(
            np.asarray(self._arrays[f"{group}/color"][row]),
            np.asarray(self._arrays[f"{group}/depth"][row]) if "depth" in leaves else None,
            int(self._arrays[f"{group}/t_ns"][row]),
            self._pose(camera, row),
        )

    def _further_images(self, camera: str, row: int) -> dict[str, NDArray[Any]]:
        """Return the images that a `Frame` has no place for; of a camera without colour all, with time and pose."""
        group, leaves = f"cameras/{camera}", self._groups[f"cameras/{camera}"]
        images = self.declarations.image_paths(camera, self._arrays)
        found = {path: np.asarray(self._arrays[path][row]) for path in images}
        if "color" in leaves:
            return {path: image for path, image in found.items() if path.rpartition("/")[2] not in ("color", "depth")}
        pose = self._pose(camera, row)
        found[f"{group}/t_ns"] = np.asarray(self._arrays[f"{group}/t_ns"][row])
        return found if pose is None else {**found, f"{group}/T_base_camera_per_frame": pose}

    def _pose(self, camera: str, row: int) -> NDArray[Any] | None:
        """Return the pose of a camera that moves at one of its frames, NaN before the first pose of the TCP."""
        if not moves(self._arrays, camera):
            return None
        pose: NDArray[Any] = camera_poses(self._arrays, camera, np.asarray(self._arrays[f"cameras/{camera}/t_ns"]))[row]
        return pose

    def _calibration(self, camera: str) -> Calibration | None:
        """Return the calibration of a camera, with its pose at this step if it moves; None if anything is unknown."""
        group = f"cameras/{camera}"
        known = {
            path.rpartition("/")[2]: values for path, values in self._arrays.items() if path.startswith(f"{group}/")
        }
        pose, mount = known.get("T_base_camera"), known.get("T_tcp_camera")
        if pose is None:
            row = latest(known["t_ns"], int(self._episode.t_ns[self._step]))
            pose = self._pose(camera, max(row, 0))
        if pose is None or not np.isfinite(pose).all() or "intrinsics" not in known:
            return None
        axes = known["image_axes"] if "image_axes" in known else image_axes(pose)
        scale = float(known["depth_scale"]) if "depth_scale" in known else math.nan
        return Calibration(known["intrinsics"], pose, axes, scale, mount)
