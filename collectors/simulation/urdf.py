"""Text of a URDF that is made of cylinders and boxes, which are both drawn and collided with."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from collectors.simulation.bounds import Vector3

QUARTER = 0.5 * math.pi
TURNS = {"x": (0.0, QUARTER, 0.0), "y": (-QUARTER, 0.0, 0.0), "z": (0.0, 0.0, 0.0)}
"""Roll, pitch and yaw, [rad], that turn the z axis of a cylinder to an axis of its link."""


@dataclass(frozen=True)
class UrdfBox:
    """Box in a link.

    Attributes:
        size: Edge lengths along x, y and z of the link, [m].
        centre: Centre of the box in the link, (x, y, z), [m].
    """

    size: Vector3
    centre: Vector3 = (0.0, 0.0, 0.0)

    @property
    def text(self) -> str:
        """Origin and geometry of the box."""
        return f'{_origin(self.centre)}<geometry><box size="{_numbers(self.size)}"/></geometry>'

    def inertia(self, mass: float) -> Vector3:
        """Return the moments of inertia about x, y and z through the centre of a uniform box, [kg m^2]."""
        x, y, z = (size * size * mass / 12.0 for size in self.size)
        return y + z, x + z, x + y


@dataclass(frozen=True)
class UrdfCylinder:
    """Cylinder in a link.

    Attributes:
        radius: Radius of the cylinder, [m].
        length: Length of the cylinder, [m].
        axis: Axis of the link along which the cylinder lies: x, y or z.
        centre: Centre of the cylinder in the link, (x, y, z), [m].
    """

    radius: float
    length: float
    axis: str
    centre: Vector3 = (0.0, 0.0, 0.0)

    @property
    def text(self) -> str:
        """Origin and geometry of the cylinder."""
        shape = f'<geometry><cylinder radius="{self.radius}" length="{self.length}"/></geometry>'
        return _origin(self.centre, TURNS[self.axis]) + shape

    def inertia(self, mass: float) -> Vector3:
        """Return the moments of inertia about x, y and z through the centre of a uniform cylinder, [kg m^2]."""
        along = 0.5 * mass * self.radius**2
        across = mass * (3.0 * self.radius**2 + self.length**2) / 12.0
        x, y, z = (along if axis == self.axis else across for axis in "xyz")
        return x, y, z


Solid = UrdfBox | UrdfCylinder


def link(
    name: str,
    mass: float,
    centre: Vector3,
    inertia: Vector3,
    solids: Sequence[Solid],
    color: Vector3,
    sticky: bool = False,
) -> str:
    """Return a link.

    Args:
        name: Name of the link.
        mass: Mass of the link, [kg].
        centre: Centre of mass in the link, (x, y, z), [m].
        inertia: Moments of inertia about axes through the centre of mass along x, y and z of the link, [kg m^2].
        solids: Shapes of the link.
        color: RGB of the link, 0 to 1.
        sticky: Whether PyBullet keeps the places of contact (friction anchors). Without them, what is held between
            compliant pads creeps: a bar of 0.2 kg, held 3 cm off its centre, turned by 0.4 degrees per second.
    """
    xx, yy, zz = inertia
    moments = f'<inertia ixx="{xx}" ixy="0" ixz="0" iyy="{yy}" iyz="0" izz="{zz}"/>'
    rgba = _numbers((*color, 1.0))
    material = f'<material name="{rgba}"><color rgba="{rgba}"/></material>'
    shapes = "".join(f"<visual>{solid.text}{material}</visual><collision>{solid.text}</collision>" for solid in solids)
    inertial = f'<inertial>{_origin(centre)}<mass value="{mass}"/>{moments}</inertial>'
    contact = "<contact><friction_anchor/></contact>" if sticky else ""
    return f'<link name="{name}">{contact}{inertial}{shapes}</link>\n'


def joint(
    kind: str,
    parent: str,
    child: str,
    at: Vector3,
    turn: Vector3 = (0.0, 0.0, 0.0),
    axis: Vector3 = (0.0, 0.0, 1.0),
    limits: tuple[float, float] = (-2.0 * math.pi, 2.0 * math.pi),
) -> str:
    """Return a joint, which has the name of its child with ``_joint`` behind it.

    Args:
        kind: ``fixed``, ``revolute`` or ``prismatic``.
        parent: Name of the parent link.
        child: Name of the child link.
        at: Origin of the child's frame in the parent's, (x, y, z), [m].
        turn: Roll, pitch and yaw of the child's frame in the parent's, [rad].
        axis: Axis of the joint in the child's frame.
        limits: Lowest and highest position of the joint, [rad] or [m].
    """
    moves = f'<axis xyz="{_numbers(axis)}"/><limit lower="{limits[0]}" upper="{limits[1]}" effort="100" velocity="10"/>'
    links = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{child}_joint" type="{kind}">{_origin(at, turn)}{links}{moves}</joint>\n'


def _origin(xyz: Vector3, rpy: Vector3 = (0.0, 0.0, 0.0)) -> str:
    return f'<origin xyz="{_numbers(xyz)}" rpy="{_numbers(rpy)}"/>'


def _numbers(values: Sequence[float]) -> str:
    return " ".join(map(str, values))
