"""The standard fields: names and meaning of the arrays that tools of this package use.

An episode may hold further arrays, each declared with the same class (`svfl_data.schema.declarations`). To add a
standard field to the format, one adds an entry to `FIELDS`.
"""

from collections.abc import Iterable

from svfl_data.schema.action_fields import expert, planar_action
from svfl_data.schema.field import LARGEST, Field
from svfl_data.symmetry import DIRECTIONS, OFFSET_PARTS, PROPRIO_PARTS, WRENCH_PARTS

CAMERA = "{camera}"
"""Placeholder in a path for the name of a camera, of which an episode may have any number."""
EXTRA = "extra/"
"""Group of the user's own arrays, which may have any name and shape and are kept by every tool."""
PLAIN_KINDS = "biufcS"
"""NumPy kinds of the types that the user's own arrays may have. Other types have no bytes of their own, or none that
all software can read."""
PATH_LENGTH, PATH_PARTS = 1000, 16
"""Largest number of characters, and of parts, of a dataset path."""
FARTHEST_NS = 2**62 - 1
"""Largest magnitude of every time stamp, [ns], which is 146 years. The difference of two such time stamps fits into
int64, and Unix time stays within this bound until 2116."""


TIME = (-FARTHEST_NS, FARTHEST_NS)
POSITIVE = (0.0, LARGEST)
DEPTH_SCALE = (1e-6, 1.0)
"""Bounds of the depth scale, from a micrometre to a metre per unit. The largest depth in uint16 is then between 65 mm
and 65 km."""

FIELDS = (
    Field(
        path="observations/t_ns", name="t_ns", dtype="int64", shape=("N+1",), unit="ns",
        doc="Time of each observation, episode clock.",
        possible=TIME,
    ),
    Field(
        path="observations/proprio", name="proprio", dtype="float32", shape=("N+1", 5), unit="-, m, m, m, rad",
        doc="Gripper opening (0 closed, 1 open), TCP position, yaw of the gripper about base z "
        "(0 when the fingers open along base y).",
        axes="base", about="base origin", components=("opening", "x", "y", "z", "theta"), parts=PROPRIO_PARTS,
    ),
    planar_action(),
    expert(planar_action()),
    Field(
        path="streams/wrench/t_ns", name="wrench_t_ns", dtype="int64", shape=("M",), unit="ns",
        doc="Time of each wrench reading, episode clock.",
        possible=TIME,
    ),
    Field(
        path="streams/wrench/wrench", name="wrench", dtype="float32", shape=("M", 6), unit="N, N, N, N m, N m, N m",
        doc="Raw load that the environment put on the gripper (gravity of the gripper included), native rate.",
        axes="base", about="sensor origin", components=("fx", "fy", "fz", "mx", "my", "mz"), parts=WRENCH_PARTS,
    ),
    Field(
        path="streams/wrench/tare", name="tare", dtype="float64", shape=(6,), unit="N, N, N, N m, N m, N m",
        doc="Offset to subtract from `wrench`, read after the arm is home.",
        axes="base", about="sensor origin", components=("fx", "fy", "fz", "mx", "my", "mz"), parts=WRENCH_PARTS,
    ),
    Field(
        path="streams/joints/t_ns", name="joints_t_ns", dtype="int64", shape=("L",), unit="ns",
        doc="Time of each joint reading, episode clock.",
        possible=TIME,
    ),
    Field(
        path="streams/joints/position", name="joints", dtype="float32", shape=("L", "J"), unit="rad, m",
        doc="Measured joint positions in the order of the arm's URDF (arm, then fingers).",
    ),
    Field(
        path="streams/joints/velocity", name="joints_velocity", dtype="float32", shape=("L", "J"), unit="rad/s, m/s",
        doc="Measured joint velocities, in the order of `position`.",
    ),
    Field(
        path="streams/joints/torque", name="joints_torque", dtype="float32", shape=("L", "J"), unit="N m, N",
        doc="Measured joint torques, in the order of `position`.",
    ),
    Field(
        path="streams/tcp/t_ns", name="tcp_t_ns", dtype="int64", shape=("K",), unit="ns",
        doc="Time of each TCP pose, episode clock.",
        possible=TIME,
    ),
    Field(
        path="streams/tcp/pose", name="tcp_pose", dtype="float64", shape=("K", 7), unit="m, -",
        doc="Measured pose of the TCP: position, then quat_xyzw.",
        axes="base", about="base origin", components=("x", "y", "z", "qx", "qy", "qz", "qw"),
    ),
    Field(
        path="streams/object/t_ns", name="object_t_ns", dtype="int64", shape=("P",), unit="ns",
        doc="Time of each object pose, episode clock.",
        possible=TIME,
    ),
    Field(
        path="streams/object/pose", name="object_pose", dtype="float64", shape=("P", 7), unit="m, -",
        doc="Pose of the task's object: position, then quat_xyzw (simulation or tracked).",
        axes="base", about="base origin", components=("x", "y", "z", "qx", "qy", "qz", "qw"),
    ),
    Field(
        path="streams/object/half_extents", name="object_half", dtype="float64", shape=(3,), unit="m",
        doc="Half the edges of the task's object, a box.",
        axes="object", possible=POSITIVE,
    ),
    Field(
        path="streams/tags/t_ns", name="tags_t_ns", dtype="int64", shape=("Q",), unit="ns",
        doc="Time of each look of the tag cameras from the first sighting on, episode clock.",
        possible=TIME,
    ),
    Field(
        path="streams/tags/pose", name="tags_pose", dtype="float64", shape=("Q", 7), unit="m, -",
        doc="Last pose of the task's object that its fiducial tags gave: position, then quat_xyzw.",
        axes="base", about="base origin", components=("x", "y", "z", "qx", "qy", "qz", "qw"),
    ),
    Field(
        path="streams/tags/age", name="tags_age", dtype="float64", shape=("Q",), unit="s",
        doc="Time since the object was seen at `pose`; 0 where it was seen now, larger while it is hidden.",
        possible=POSITIVE,
    ),
    Field(
        path="streams/tags/error", name="tags_error", dtype="float64", shape=("Q",), unit="px",
        doc="Root mean square reprojection error of the edges of its tags.",
        possible=POSITIVE,
    ),
    Field(
        path="streams/tags/margin", name="tags_margin", dtype="float64", shape=("Q",), unit="grey levels",
        doc="Smallest decision margin of its tags.",
    ),
    Field(
        path="streams/tags/count", name="tags_count", dtype="int64", shape=("Q",), unit="-",
        doc="Number of tags that gave it.",
        possible=POSITIVE,
    ),
    Field(
        path="cameras/{camera}/t_ns", name="t_ns", dtype="int64", shape=("F",), unit="ns",
        doc="Time of each frame, episode clock.",
        possible=TIME,
    ),
    Field(
        path="cameras/{camera}/color", name="color", dtype="uint8", shape=("F", "H", "W", 3), unit="-",
        doc="Colour image, sRGB, rows run downwards.",
        components=("red", "green", "blue"), image=True,
    ),
    Field(
        path="cameras/{camera}/grey", name="grey", dtype="uint8", shape=("F", "H", "W"), unit="-",
        doc="Grey image, rows run downwards.",
        image=True,
    ),
    Field(
        path="cameras/{camera}/grey16", name="grey16", dtype="uint16", shape=("F", "H", "W"), unit="-",
        doc="Grey image of 16 bits, such as infrared, rows run downwards.",
        image=True,
    ),
    Field(
        path="cameras/{camera}/depth", name="depth", dtype="uint16", shape=("F", "H", "W"), unit="depth_scale m",
        doc="Distance along the camera's viewing axis; 0 where there is no measurement.",
        image=True,
    ),
    Field(
        path="cameras/{camera}/depth_scale", name="depth_scale", dtype="float64", shape=(), unit="m",
        doc="Metres per unit of `depth`.",
        possible=DEPTH_SCALE,
    ),
    Field(
        path="cameras/{camera}/intrinsics", name="intrinsics", dtype="float64", shape=(3, 3), unit="px",
        doc="Pinhole matrix K; the centre of the top left pixel is (0, 0).",
    ),
    Field(
        path="cameras/{camera}/T_base_camera", name="T_base_camera", dtype="float64", shape=(4, 4), unit="m",
        doc="Pose of the camera; camera axes: x right, y down, z forward.",
        axes="base", about="base origin",
    ),
    Field(
        path="cameras/{camera}/T_base_camera_per_frame", name="T_base_camera_per_frame", dtype="float64",
        shape=("F", 4, 4), unit="m",
        doc="Pose of a camera that moves, at each frame.",
        axes="base", about="base origin",
    ),
    Field(
        path="cameras/{camera}/T_tcp_camera", name="T_tcp_camera", dtype="float64", shape=(4, 4), unit="m",
        doc="Pose of a camera that is mounted on the gripper, relative to the TCP, whose pose is `streams/tcp/pose`.",
        axes="tcp", about="TCP",
    ),
    Field(
        path="cameras/{camera}/image_axes", name="image_axes", dtype="float64", shape=(2, 2), unit="-",
        doc="Orthogonal matrix that takes base (x, y) to image-aligned (right, up).",
    ),
    Field(
        path="workspace", name="workspace", dtype="float64", shape=(3, 2), unit="m",
        doc="Lower and upper bound of TCP x, y, z; its (x, y) centre is the centre of symmetry.",
        axes="base", about="base origin",
    ),
    Field(
        path="labels/offset", name="label_offset", dtype="float64", shape=(2,), unit="m",
        doc="Block centre minus TCP: the displacement that would centre the gripper over the block.",
        axes="base", about="TCP", components=("dx", "dy"), parts=OFFSET_PARTS,
    ),
    Field(
        path="labels/direction", name="label_direction", dtype="int64", shape=(), unit="-",
        doc="Nearest image-aligned direction to `labels/offset`: 0 right, 1 up, 2 left, 3 down.",
        possible=(0, len(DIRECTIONS) - 1),
    ),
)  # fmt: skip


def camera_names(paths: Iterable[str]) -> list[str]:
    """Return the names of the cameras that occur in dataset paths, sorted."""
    return sorted({path.split("/")[1] for path in paths if path.startswith("cameras/")})


def harmless(path: str) -> bool:
    """Return whether a dataset path is allowed as the name of an array.

    A path must be printable, must not exceed `PATH_LENGTH` and `PATH_PARTS`, and none of its parts may be empty, ``.``
    or ``..``.
    """
    parts = path.split("/")
    whole = all(part not in ("", ".", "..") for part in parts)
    return whole and len(path) <= PATH_LENGTH and len(parts) <= PATH_PARTS and path.isprintable()


def markdown_table() -> str:
    """Return the Markdown table of all standard fields for ``data/README.md``."""
    lines = [
        "| dataset | shape | dtype | unit | axes | about | rotates | meaning |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for field in FIELDS:
        names = f" Components: {', '.join(field.components)}." if field.components and not field.image else ""
        lines.append(
            f"| `{field.path}` | {field.shape_words} | {field.dtype} | {field.unit} | {field.axes} | {field.about} "
            f"| {field.rotates} | {field.doc}{names} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown_table())
