"""Observation of a robot at one step: images, vectors, and the latest rows of its streams."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svfl_data.errors import FieldError
from svfl_data.schema.optics import image_axes
from svfl_data.system.printable import printable


@dataclass(frozen=True)
class Frame:
    """Images of one camera at one moment.

    Attributes:
        color: Colour image, shape (H, W, 3), uint8, RGB.
        depth: Depth image, shape (H, W), uint16, in units of the camera's depth scale; 0 where there is no measurement.
            None for a camera without depth.
        t_ns: Time at which the images were taken, [ns] of the episode clock. None means the time of the observation.
        T_base_camera: Pose in base, at this moment, of a camera that moves, shape (4, 4), [m]. None for a
            fixed camera, whose pose its calibration has, and where the pose is unknown. NaN also means a pose that is
            unknown at this time.

    Example:
        >>> Frame(np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.uint16)).depth.shape
        (4, 4)
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.uint16] | None = None
    t_ns: int | None = None
    T_base_camera: NDArray[np.float64] | None = None

    @property
    def image_axes(self) -> NDArray[np.float64] | None:
        """Orthogonal matrix from base (x, y) to image (right, up) at this moment, shape (2, 2).

        None if the camera is fixed, or its pose is unknown.
        """
        pose = self.T_base_camera
        return None if pose is None or not np.isfinite(pose).all() else image_axes(pose)


@dataclass(frozen=True)
class Observation:
    """Data that a robot observes at one step; what the robot does not have is None or absent.

    Of each stream, an observation carries the latest rows, at least all since the observation before. A policy that
    needs a longer past therefore misses nothing if it keeps the rows of the observations that it is given. Rows of
    wrenches are tared.

    Attributes:
        t_ns: Time of the latest reading, [ns] of the episode clock.
        frames: Frame of each camera by name.
        wrench: Last 64 wrench readings, latest last, shape (64, 6), float32, tared, [N] and [N m], base axes, about the
            sensor origin.
        proprio: Proprioception, shape (5,), float32: gripper opening (0 closed, 1 open), TCP x, y, z [m] and yaw theta
            [rad], in base.
        joints: Joint positions, shape (J,), float32: arm joints [rad], then fingers [m].
        tcp: Measured pose of the TCP in base, position [m], then quat_xyzw, shape (7,).
        values: Further arrays by dataset path: of ``observations/NAME`` the row of this step, of ``streams/NAME/...``
            the latest rows, shape (M, ...), with their times ``streams/NAME/t_ns``, shape (M,), [ns]. The times of
            `wrench` are ``streams/wrench/t_ns``. What is here comes before the attributes above, so that a robot can
            give more readings than the last 64, or joints at their own rate.

    Example:
        >>> seen = Observation(0, {}, np.zeros((64, 6)), proprio=np.zeros(5), joints=np.zeros(9))
        >>> seen.at("streams/wrench/wrench").shape, seen.at("observations/proprio").shape
        ((64, 6), (5,))
    """

    t_ns: int
    frames: Mapping[str, Frame] = field(default_factory=dict)
    wrench: NDArray[np.float32] | None = None
    proprio: NDArray[np.float32] | None = None
    joints: NDArray[np.float32] | None = None
    tcp: NDArray[np.float64] | None = None
    values: Mapping[str, NDArray[Any]] = field(default_factory=dict)

    def at(self, path: str) -> NDArray[Any]:
        """Return what was observed at a dataset path.

        Args:
            path: Dataset path, such as ``observations/proprio``, ``cameras/front/color`` or ``streams/wrench/wrench``.

        Returns:
            Of ``observations/`` and ``cameras/`` the row of this step, shape (...). Of ``streams/`` all rows that the
            observation carries, latest last, shape (M, ...).

        Raises:
            FieldError: If the robot did not observe it.
        """
        rows = self._rows(path)
        return rows if path.startswith("streams/") else rows[0]

    def times(self, path: str) -> NDArray[np.int64]:
        """Return the times of the rows of an array, shape (M,), [ns] of the episode clock; (1,) outside of streams.

        Args:
            path: Dataset path of the array.

        Raises:
            FieldError: If the robot did not observe it, or did not tell its times.
        """
        self._rows(path)
        return self._rows(f"{path.rpartition('/')[0]}/t_ns")

    @cached_property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """Everything observed by dataset path, as an episode holds it: one row, or the latest rows of a stream.

        `svfl_data.sampling.cut.cut` takes the inputs of a network from it:
        ``cut(seen.arrays, inputs, np.array([seen.t_ns]), np.array([0]))``.
        """
        now = np.array([self.t_ns], np.int64)
        found: dict[str, NDArray[Any]] = {"observations/t_ns": now}
        if self.proprio is not None:
            found["observations/proprio"] = self.proprio[None]
        if self.wrench is not None:
            found["streams/wrench/wrench"] = self.wrench
        if self.joints is not None:
            found |= {"streams/joints/t_ns": now, "streams/joints/position": self.joints[None]}
        if self.tcp is not None:
            found |= {"streams/tcp/t_ns": now, "streams/tcp/pose": self.tcp[None]}
        for name, frame in self.frames.items():
            found[f"cameras/{name}/t_ns"] = now if frame.t_ns is None else np.array([frame.t_ns], np.int64)
            found[f"cameras/{name}/color"] = frame.color[None]
            if frame.depth is not None:
                found[f"cameras/{name}/depth"] = frame.depth[None]
            if frame.T_base_camera is not None:
                found[f"cameras/{name}/T_base_camera_per_frame"] = frame.T_base_camera[None]
        for path, values in self.values.items():
            found[path] = values if path.startswith("streams/") else np.asarray(values)[None]
        return found

    def _rows(self, path: str) -> NDArray[Any]:
        if path not in self.arrays:
            raise FieldError(
                f"the observation has no {printable(path)}; it has {', '.join(map(printable, self.arrays))}"
            )
        return self.arrays[path]
