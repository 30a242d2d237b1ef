"""The robot arm, drawn from its URDF and moved by the recorded joint positions."""

import importlib.util
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import rerun as rr
from rerun.urdf import UrdfJoint, UrdfTree

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.viewer.entities.names import SCENE, send
from svfl_data.viewer.entities.urdf import mesh_file, numbers, read_urdf

FRAMES = ("parent_frame", "child_frame")  # Rerun's own link frames, left out because the entity tree gives the parents
SHADE = (0.78, 0.78, 0.80, 0.4)


@dataclass(frozen=True, eq=False)
class Robot:
    """Robot arm from a URDF.

    Attributes:
        file: URDF file of the arm.
        joints: Joints of the arm, in the order of the file.
        meshes: For each mesh its link, its file and its pose on the link: (x, y, z) [m] and (roll, pitch, yaw) [rad].
    """

    file: Path
    joints: tuple[UrdfJoint, ...]
    meshes: tuple[tuple[str, Path, tuple[float, ...], tuple[float, ...]], ...]

    @classmethod
    def of_file(cls, file: Path) -> "Robot":
        """Read a robot arm from a URDF.

        Args:
            file: URDF file.

        Raises:
            FormatError: If the file is not a URDF.
        """
        links = read_urdf(file).iterfind("link")
        try:
            joints = tuple(UrdfTree.from_file_path(file).joints())
            return cls(file, joints, tuple(mesh for link in links for mesh in _meshes(file, link)))
        except (OSError, RuntimeError, ValueError) as error:
            raise FormatError(f"{file}: not a URDF ({printable(' '.join(str(error).split()), 200)})") from error

    @property
    def moving(self) -> list[UrdfJoint]:
        """Joints that move and so have a recorded position, in the order of the columns of the positions."""
        return [joint for joint in self.joints if joint.joint_type != "fixed"]

    def entities(self, root: str) -> dict[str, str]:
        """Return the entity path of every link by the name of the link; each is below the entity of its parent link.

        Args:
            root: Prefix of the episode's entities.
        """
        paths = {joint.child_link: "" for joint in self.joints}
        base = next((joint.parent_link for joint in self.joints if joint.parent_link not in paths), "base")
        paths = {base: f"{root}{SCENE}/robot/{base}"}
        waiting = list(self.joints)
        while waiting:
            placed = [joint for joint in waiting if joint.parent_link in paths]
            for joint in placed:
                paths[joint.child_link] = f"{paths[joint.parent_link]}/{joint.child_link}"
            waiting = [joint for joint in waiting if joint not in placed] if placed else []
        return paths

    def log(self, recording: rr.RecordingStream, root: str) -> None:
        """Log the parts of the arm that never change: the meshes, and the poses of links on fixed joints.

        Args:
            recording: Recording to log to.
            root: Prefix of the episode's entities.
        """
        paths = self.entities(root)
        for number, (link, mesh, xyz, rpy) in enumerate(self.meshes):
            entity = f"{paths.get(link, root + SCENE)}/mesh_{number}"
            recording.log(entity, rr.Asset3D(path=mesh, albedo_factor=SHADE), static=True)
            recording.log(entity, rr.InstancePoses3D(translations=[xyz], quaternions=[_quaternion(rpy)]), static=True)
        for joint in self.joints:
            if joint.joint_type == "fixed":
                columns = _without_frames(joint, np.zeros(1))
                recording.send_columns(paths[joint.child_link], [], columns)

    def send(self, recording: rr.RecordingStream, root: str, t_ns: np.ndarray, positions: np.ndarray) -> None:
        """Log the movement of the arm.

        Args:
            recording: Recording to log to.
            root: Prefix of the episode's entities.
            t_ns: Timestamps of the joint positions, shape (L,), [ns].
            positions: Joint positions, one column for each moving joint, shape (L, J), [rad] and [m].
        """
        paths = self.entities(root)
        for joint, values in zip(self.moving, positions.T, strict=True):
            send(recording, paths[joint.child_link], t_ns, _without_frames(joint, values))


@cache
def panda() -> Robot | None:
    """Return the Panda of the simulation with its coarse meshes; None if pybullet, which contains it, is missing."""
    found = importlib.util.find_spec("pybullet_data")
    for folder in (found and found.submodule_search_locations) or ():
        file = Path(folder) / "franka_panda" / "panda.urdf"
        if file.is_file():
            return Robot.of_file(file)
    return None


def robot_for(joints: int, urdf: Path | None = None) -> Robot | None:
    """Return the robot whose joints were recorded, or None if there is no matching robot to draw.

    Args:
        joints: Number of columns of the recorded joint positions.
        urdf: URDF of the robot. None for the Panda of the simulation.

    Raises:
        FormatError: If the given file is not a URDF, or has another number of moving joints.
    """
    robot = Robot.of_file(urdf) if urdf else panda()
    if robot is None or len(robot.moving) == joints:
        return robot
    if urdf:
        raise FormatError(f"{urdf}: {len(robot.moving)} moving joints; the episode has {joints}")
    return None


def _without_frames(joint: UrdfJoint, values: np.ndarray) -> list[rr.ComponentColumn]:
    columns = joint.compute_transform_columns(values.astype(np.float64).tolist(), clamp=False)
    return [column for column in columns if not str(column.component_descriptor()).endswith(FRAMES)]


def _meshes(file: Path, link: ElementTree.Element) -> list[tuple[str, Path, tuple[float, ...], tuple[float, ...]]]:
    """Return the meshes of a link that exist, preferring coarse collision meshes, which look the same in the viewer."""
    found = []
    for visual in link.iterfind("visual"):
        mesh, origin = visual.find("geometry/mesh"), visual.find("origin")
        name = "" if mesh is None else mesh.get("filename", "")
        path = mesh_file(file, name.replace("visual", "collision")) or mesh_file(file, name)
        if path and name:
            at = [numbers(origin.get(key) if origin is not None else None) for key in ("xyz", "rpy")]
            found.append((link.get("name", ""), path, at[0], at[1]))
    return found


def _quaternion(rpy: tuple[float, ...]) -> np.ndarray:
    """Convert roll, pitch and yaw about fixed axes x, y, z (the convention of URDF), [rad], into quat_xyzw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.divide(rpy, 2)), np.sin(np.divide(rpy, 2))
    return np.array([
        sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy,
    ])  # fmt: skip
