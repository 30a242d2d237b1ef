"""Cameras of a robot in the live display: the pose and the lens once, the images of every observation."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from svfl_data.schema.optics import mounted
from svfl_data.schema.robot import Calibration, Observation
from svfl_data.viewer.entities import images
from svfl_data.viewer.entities.names import PICTURES


class LiveCamera:
    """One camera of the robot.

    A camera whose pose is unknown is outside of the 3-D scene.

    Args:
        recording: Recording to log to.
        name: Name of the camera.
        known: Calibration of the camera, or None if it is unknown.
        first: An observation with images of the camera.

    Attributes:
        entity: Entity of the camera.
        kinds: Kinds of images that are shown: ``color``, and ``depth`` if its unit is known.
    """

    def __init__(self, recording: rr.RecordingStream, name: str, known: Calibration | None, first: Observation) -> None:
        frame = first.frames[name]
        self._name, self._mount = name, None if known is None else known.T_tcp_camera
        self._moves = frame.T_base_camera is not None or (self._mount is not None and first.tcp is not None)
        placed = self._moves or (known is not None and self._mount is None)
        self.entity = images.camera_entity("", name) if placed else f"{PICTURES}/{name}"
        self.kinds = ["color"]
        if placed and known is not None:
            if self._moves:
                images.log_lens(recording, self.entity, known.intrinsics, frame.color.shape[:2])
            else:
                size = frame.color.shape[:2]
                images.log_camera(recording, self.entity, known.intrinsics, known.T_base_camera, size)
        if frame.depth is not None and known is not None and known.depth_scale > 0:
            self.kinds.append("depth")
            images.log_depth_style(recording, self.entity, frame.depth[None], known.depth_scale, small=False)

    def send(self, recording: rr.RecordingStream, t_ns: np.ndarray, seen: Sequence[Observation]) -> None:
        """Log the images of some observations, and where the camera was.

        Args:
            recording: Recording to log to.
            t_ns: Times of the observations on the recording's clock, shape (N,), [ns].
            seen: Observations with images of the camera.
        """
        if self._moves:
            images.send_poses(recording, self.entity, t_ns, np.stack([self._pose(one) for one in seen]))
        frames = [one.frames[self._name] for one in seen]
        images.send_color(recording, self.entity, t_ns, np.stack([frame.color for frame in frames]), small=False)
        if "depth" in self.kinds:
            depth = np.stack([frame.depth for frame in frames if frame.depth is not None])
            images.send_depth(recording, self.entity, t_ns, depth, small=False)

    def _pose(self, seen: Observation) -> np.ndarray:
        """Return the pose of the camera in base at an observation, shape (4, 4), [m]; NaN if it is unknown now."""
        pose = seen.frames[self._name].T_base_camera
        if pose is not None:
            return pose
        if self._mount is None or seen.tcp is None:
            return np.full((4, 4), np.nan)
        return mounted(np.asarray(seen.tcp)[None], self._mount)[0]
