"""Bodies in one PyBullet world, made of primitive shapes or loaded from URDF."""

import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from collectors.simulation.bounds import Vector3
from collectors.simulation.bullet import pybullet
from svfl_data.system.own_process import OwnProcess

Quaternion = tuple[float, float, float, float]
UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
RED: Vector3 = (0.8, 0.2, 0.2)
MAX_PARTS = 16  # MAX_COMPOUND_COLLISION_SHAPES of PyBullet 3.2.7, which ends by a segmentation fault with more parts


@dataclass(frozen=True)
class Box:
    """A box as part of a body.

    Attributes:
        half_extents: Half edge lengths along x, y and z of the box, [m].
        position: Centre of the box in the body's frame, (x, y, z), [m].
        yaw: Rotation of the box about z in the body's frame, [rad].
        color: RGB of the box, 0 to 1.
    """

    half_extents: Vector3
    position: Vector3 = (0.0, 0.0, 0.0)
    yaw: float = 0.0
    color: Vector3 = RED


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder as part of a body.

    Attributes:
        radius: Radius of the cylinder, [m].
        height: Height of the cylinder, [m].
        position: Centre of the cylinder in the body's frame, (x, y, z), [m].
        color: RGB of the cylinder, 0 to 1.
    """

    radius: float
    height: float
    position: Vector3 = (0.0, 0.0, 0.0)
    color: Vector3 = RED


Part = Box | Cylinder


def quat_from_yaw(yaw: float) -> Quaternion:
    """Return the rotation by `yaw` [rad] about z as quat_xyzw."""
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


class Bodies(OwnProcess):
    """Object that adds bodies to one PyBullet world."""

    def __init__(self, client: int) -> None:
        """Choose the world.

        Args:
            client: PyBullet client id of the world.
        """
        self._client = client

    def add(
        self,
        parts: Sequence[Part],
        position: Vector3,
        yaw: float = 0.0,
        mass: float = 0.0,
        friction: float = 0.5,
        collide: bool = True,
    ) -> int:
        """Add a rigid body of one or several parts.

        Args:
            parts: Shapes of the body, at most `MAX_PARTS`. The origin of the body's frame is its centre of mass.
            position: Origin of the body's frame in base, (x, y, z), [m].
            yaw: Rotation of the body about z, [rad].
            mass: Mass of the body, [kg]; 0 fixes the body in place.
            friction: Coulomb friction of the body; PyBullet multiplies it by the other body's.
            collide: Whether other bodies collide with the body; False makes a mark that can only be seen.

        Returns:
            The body id.
        """
        self.check_process()
        assert len(parts) <= MAX_PARTS, f"{len(parts)} parts"
        client = self._client
        visual = pybullet.createVisualShapeArray(**_arrays(parts, True), physicsClientId=client)
        shape = pybullet.createCollisionShapeArray(**_arrays(parts, False), physicsClientId=client) if collide else -1
        body: int = pybullet.createMultiBody(mass, shape, visual, position, quat_from_yaw(yaw), physicsClientId=client)
        self.set_dynamics(body, lateralFriction=friction)
        return body

    def add_urdf(
        self, urdf: Path | str, position: Vector3, quat_xyzw: Quaternion = UPRIGHT, fixed: bool = False,
        scale: float = 1.0,
    ) -> int:  # fmt: skip
        """Add a body from URDF.

        Args:
            urdf: A URDF file, or the text of a URDF, in which mesh paths must be absolute.
            position: Origin of the body's base link in base, (x, y, z), [m]. `World.pose` instead returns the pose of
                the body's centre of mass.
            quat_xyzw: Orientation of the body's base link in base.
            fixed: Whether the body's base link is fixed in place.
            scale: Factor on all lengths of the URDF.

        Returns:
            The body id. The body has the URDF's mass and friction until `set_dynamics` changes them.
        """
        self.check_process()
        if isinstance(urdf, str) and urdf.lstrip().startswith("<"):
            with tempfile.NamedTemporaryFile("w", suffix=".urdf") as file:
                file.write(urdf)
                file.flush()
                return self.add_urdf(Path(file.name), position, quat_xyzw, fixed, scale)
        body: int = pybullet.loadURDF(
            str(urdf), position, quat_xyzw, useFixedBase=fixed, globalScaling=scale, physicsClientId=self._client
        )
        return body

    def set_dynamics(self, body: int, link: int = -1, **values: float) -> None:
        """Set dynamics of a body's link, named as in ``pybullet.changeDynamics``.

        Args:
            body: Body id.
            link: Link index; -1 is the base link.
            values: Values by PyBullet's names, such as ``mass=0.1, lateralFriction=0.6``.
        """
        self.check_process()
        pybullet.changeDynamics(body, link, **values, physicsClientId=self._client)


def _arrays(parts: Sequence[Part], colored: bool) -> dict[str, list]:
    """Return PyBullet's arguments for an array of visual shapes, which have colours, or of collision shapes."""
    boxes = [isinstance(part, Box) for part in parts]
    prefix = "visual" if colored else "collision"
    return {
        "shapeTypes": [pybullet.GEOM_BOX if box else pybullet.GEOM_CYLINDER for box in boxes],
        "halfExtents": [part.half_extents if isinstance(part, Box) else (0.0, 0.0, 0.0) for part in parts],
        "radii": [part.radius if isinstance(part, Cylinder) else 0.0 for part in parts],
        "lengths": [part.height if isinstance(part, Cylinder) else 0.0 for part in parts],
        f"{prefix}FramePositions": [part.position for part in parts],
        f"{prefix}FrameOrientations": [quat_from_yaw(part.yaw if isinstance(part, Box) else 0.0) for part in parts],
    } | ({"rgbaColors": [(*part.color, 1.0) for part in parts]} if colored else {})
