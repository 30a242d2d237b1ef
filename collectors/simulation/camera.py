"""The RGB-D camera, which is fixed or mounted on the gripper, and its calibration."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from collectors.simulation.bounds import Degrees, Pixels, Point, Positive
from collectors.simulation.bullet import pybullet
from collectors.simulation.linear import length, product
from svfl_data.errors import UsageError
from svfl_data.schema.observation import Frame
from svfl_data.schema.optics import Calibration
from svfl_data.system.near_names import instead
from svfl_data.system.own_process import OwnProcess
from svfl_data.system.printable import printable


@dataclass(frozen=True)
class CameraConfig:
    """Pose and optics of a camera. The default is the oblique front view of the paper's simulation.

    Attributes:
        height: Image height, [px].
        width: Image width, [px].
        eye: Optical centre, (x, y, z), [m], in base or, if `mounted`, relative to the TCP.
        target: Point on the optical axis, (x, y, z), [m]. The default is the workspace centre, which therefore is the
            image centre.
        up: Direction that is up in the image, (x, y, z).
        fov_deg: Vertical field of view, [deg].
        near: Nearest visible depth, [m].
        far: Farthest visible depth, [m]. A pixel that sees nothing up to this depth reads 0.
        depth_scale: Metres per unit of the stored depth, [m].
        mounted: Whether the camera is mounted on the gripper and moves with it.
    """

    height: Pixels = 76
    width: Pixels = 76
    eye: Point = (1.1, 0.0, 0.6)
    target: Point = (0.55, 0.0, 0.0)
    up: Point = (-1.0, 0.0, 0.0)
    fov_deg: Degrees = 40.0
    near: Positive = 0.1
    far: Positive = 3.0
    depth_scale: Positive = 1e-4
    mounted: bool = False

    def __post_init__(self) -> None:
        """Refuse numbers that no camera can have.

        Raises:
            UsageError: If `near` is not below `far`, the field of view is not between 0 and 180 degrees, 16 bits do not
                hold a depth of `far`, `eye` and `target` are the same point, or `up` is zero or along the line of
                sight.
        """
        if self.far > self.depth_scale * np.iinfo(np.uint16).max:
            raise UsageError(f"a depth of {self.far} m in units of {self.depth_scale} m does not fit into 16 bits")
        if not (self.near < self.far and 0.0 < self.fov_deg < 180.0):
            raise UsageError(
                f"a camera needs near < far and a field of view between 0 and 180 degrees, got near {self.near} m, far "
                f"{self.far} m and {self.fov_deg} degrees"
            )
        forward = np.subtract(self.target, self.eye)
        if not length(np.cross(forward, self.up)) > 1e-9:
            raise UsageError(
                f"a camera needs a target away from its eye, and an up that is not parallel to the line between them, "
                f"got eye {self.eye}, target {self.target} and up {self.up}"
            )


CAMERAS = {
    "front": CameraConfig(),
    "top": CameraConfig(eye=(0.55, 0.0, 1.2), fov_deg=24.0),
    "side_left": CameraConfig(eye=(0.55, 0.55, 0.6), up=(0.0, -1.0, 0.0)),
    "side_right": CameraConfig(eye=(0.55, -0.55, 0.6), up=(0.0, 1.0, 0.0)),
    "wrist": CameraConfig(
        eye=(0.09, 0.0, -0.14), target=(0.0, 0.0, 0.02), up=(-1.0, 0.0, 0.0), mounted=True, fov_deg=60.0, near=0.03
    ),
}
"""Cameras by name. The fixed ones look at the workspace centre from 0.8 to 1.2 m, left and right as seen from
the robot. The one at the wrist looks at the fingertips from beside the gripper."""


def cameras_named(names: Iterable[str]) -> dict[str, CameraConfig]:
    """Return the configurations of cameras by name.

    Args:
        names: Names, each one of `CAMERAS`.

    Raises:
        UsageError: If there is no such camera.
    """
    chosen = list(names)
    if unknown := [name for name in chosen if name not in CAMERAS]:
        raise UsageError(f"no camera {printable(unknown[0], 40)!r}; {instead(unknown[0], CAMERAS)}")
    return {name: CAMERAS[name] for name in chosen}


def calibration(config: CameraConfig) -> Calibration:
    """Derive a camera's intrinsics, pose and image axes from its configuration (pinhole model, square pixels)."""
    focal = 0.5 * config.height / math.tan(0.5 * math.radians(config.fov_deg))
    intrinsics = np.array(
        [[focal, 0.0, 0.5 * (config.width - 1)], [0.0, focal, 0.5 * (config.height - 1)], [0.0, 0.0, 1.0]]
    )
    forward = np.subtract(config.target, config.eye)
    forward /= length(forward)
    right = np.cross(forward, config.up)
    right /= length(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = config.eye
    x, y = right[:2] / length(right[:2])
    axes = np.array([[x, y], [-y, x]])
    return Calibration(intrinsics, pose, axes, config.depth_scale, pose if config.mounted else None)


class Camera(OwnProcess):
    """Camera that renders colour and depth of one PyBullet world in a single call of PyBullet's software renderer."""

    def __init__(self, config: CameraConfig, client: int) -> None:
        """Place the camera.

        Args:
            config: Pose and optics of the camera.
            client: PyBullet client id of the world that the camera looks at.
        """
        self._config = config
        self._client = client
        self._fixed = calibration(config)
        self._view = pybullet.computeViewMatrix(config.eye, config.target, config.up)
        # TinyRenderer samples pixels at their lower left corner. The frustum is shifted by half a pixel, so that the
        # optical axis goes through the middle of the picture: only then does rotating the picture rotate the workspace.
        size = 2.0 * config.near * math.tan(0.5 * math.radians(config.fov_deg)) / config.height
        left, bottom = -0.5 * (config.width - 1) * size, -0.5 * (config.height - 1) * size
        self._projection = pybullet.computeProjectionMatrix(
            left, left + config.width * size, bottom, bottom + config.height * size, config.near, config.far
        )

    @property
    def mounted(self) -> bool:
        """Whether the camera is mounted on the gripper."""
        return self._config.mounted

    def calibration(self, T_base_tcp: NDArray[np.float64] | None = None) -> Calibration:
        """Return the calibration of the camera.

        Args:
            T_base_tcp: Pose of the TCP now, shape (4, 4), which a camera on the gripper moves with. Not needed for a
                fixed camera.
        """
        if T_base_tcp is None or not self.mounted:
            return self._fixed
        pose = product(T_base_tcp, self._fixed.T_base_camera)
        right = pose[:2, 0] / length(pose[:2, 0])
        axes = np.array([[right[0], right[1]], [-right[1], right[0]]])
        return replace(self._fixed, T_base_camera=pose, image_axes=axes)

    def render(self, T_base_tcp: NDArray[np.float64] | None = None) -> Frame:
        """Render one image.

        Args:
            T_base_tcp: Pose of the TCP now, shape (4, 4), which a camera on the gripper moves with. Not needed for a
                fixed camera.

        Returns:
            Frame with the colour, (height, width, 3) uint8 RGB, and the depth along the optical axis, (height, width)
            uint16 in units of `CameraConfig.depth_scale`, which is 0 where nothing was seen; of a camera on the gripper
            also its pose.
        """
        self.check_process()
        c, view, pose = self._config, self._view, None
        if c.mounted:
            pose = self.calibration(T_base_tcp).T_base_camera
            view = pybullet.computeViewMatrix(pose[:3, 3], pose[:3, 3] + pose[:3, 2], -pose[:3, 1])
        _, _, rgba, buffer, _ = pybullet.getCameraImage(
            c.width,
            c.height,
            view,
            self._projection,
            shadow=0,  # shadows would double the cost
            lightDirection=(0.0, 0.0, 1.0),
            renderer=pybullet.ER_TINY_RENDERER,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            physicsClientId=self._client,
        )
        buffer = np.asarray(buffer, np.float64).reshape(c.height, c.width)
        # Inverse of the OpenGL perspective depth, with the buffer in [0, 1].
        depth = c.far * c.near / (c.far - (c.far - c.near) * buffer)
        units = np.where(depth < 0.999 * c.far, np.round(depth / c.depth_scale), 0.0)
        colour = np.asarray(rgba, np.uint8).reshape(c.height, c.width, 4)[:, :, :3]
        return Frame(np.ascontiguousarray(colour), units.astype(np.uint16), T_base_camera=pose)
