"""The only declaration of every array in an episode file.

Writing, checking, the tables of ``data/README.md``, normalisation, augmentation and the input types of the networks all
derive from `FIELDS`. To add a stream to the format, one adds an entry to `FIELDS`.
"""

from collections.abc import Iterable
from dataclasses import dataclass

from svfl_data.symmetry import ACTION_PARTS, DIRECTIONS, OFFSET_PARTS, PROPRIO_PARTS, WRENCH_PARTS, Part, parts_named

Size = int | str
CAMERA = "{camera}"
"""Placeholder in a path for the name of a camera, of which an episode may have any number."""
EXTRA = "extra/"
"""Group of the user's own arrays, which may have any name and shape and are kept by every tool."""
PLAIN_KINDS = "biufcS"
"""NumPy kinds of the types that the user's own arrays may have. Other types have no bytes of their own, or none that
all software can read."""
PATH_LENGTH, PATH_PARTS = 1000, 16
"""Largest number of characters, and of parts, of a dataset path."""
LARGEST = 1e6
"""Largest magnitude of every declared number, in its unit, except where its field declares other bounds. No arm, sensor
or camera comes near it (the largest six-axis sensors measure 4e4 N), and the sum of a thousand million squares of it
is still finite in float32."""
FARTHEST_NS = 2**62 - 1
"""Largest magnitude of every time stamp, [ns], which is 146 years. The difference of two such time stamps fits into
int64, and Unix time stays within this bound until 2116."""


@dataclass(frozen=True)
class Field:
    """Declaration of one array of an episode.

    Attributes:
        path: Path of the dataset in the HDF5 file, which may contain `CAMERA`.
        name: Name of the array as an attribute of `svfl_data.schema.episode.Episode`, or of its `Camera` if the path
            contains `CAMERA`.
        dtype: NumPy dtype of the array on disk and in memory.
        shape: Sizes of the array. Equal symbols (``"N+1"``, ``"M"``) must have equal sizes in all fields of an episode,
            or of a camera.
        unit: Unit of the stored numbers; ``-`` if there is none.
        doc: Description of the array.
        axes: Axes in which vectors are expressed; ``-`` if there are none.
        about: Point about which torques are taken, or from which positions are measured; ``-`` if there is none.
        components: Names of the components along the last axis; empty if they have no names.
        parts: Parts of the last axis with the way in which they transform under planar rotations and reflections; empty
            if the array does not transform.
        image: Whether rows and columns of the array are pixels, which move under rotations.
        optional: Whether an episode (or camera) may lack the array.
        bounds: Smallest and largest number that is possible at all. What a robot can do is far within these bounds.

    Example:
        >>> field = next(one for one in FIELDS if one.path == "streams/wrench/wrench")
        >>> field.axes, field.shape
        ('base', ('M', 6))
    """

    path: str
    name: str
    dtype: str
    shape: tuple[Size, ...]
    unit: str
    doc: str
    axes: str = "-"
    about: str = "-"
    components: tuple[str, ...] = ()
    parts: tuple[Part, ...] = ()
    image: bool = False
    optional: bool = False
    bounds: tuple[float, float] = (-LARGEST, LARGEST)

    @property
    def rotates(self) -> str:
        """Transformation of the field under planar rotations and reflections, in words; ``-`` if there is none."""
        if self.image:
            return "pixels move"
        return parts_named(self.parts, self.components) if self.parts else "-"


TIME = (-FARTHEST_NS, FARTHEST_NS)
POSITIVE = (0.0, LARGEST)
DEPTH_SCALE = (1e-6, 1.0)
"""Bounds of the depth scale, from a micrometre to a metre per unit. The largest depth in uint16 is then between 65 mm
and 65 km."""

FIELDS = (
    Field(
        "observations/t_ns", "t_ns", "int64", ("N+1",), "ns", "Time of each observation, episode clock.", bounds=TIME,
    ),
    Field(
        "observations/proprio", "proprio", "float32", ("N+1", 5), "-, m, m, m, rad",
        "Gripper opening (0 closed, 1 open), TCP position, yaw of the gripper about base z "
        "(0 when the fingers open along base y).",
        axes="base", about="base origin", components=("opening", "x", "y", "z", "theta"), parts=PROPRIO_PARTS,
    ),
    Field(
        "actions/action", "action", "float32", ("N", 5), "-, m, m, m, rad",
        "Commanded after observation t: gripper opening, then TCP displacement and yaw change.",
        axes="base", components=("opening", "dx", "dy", "dz", "dtheta"), parts=ACTION_PARTS,
    ),
    Field(
        "actions/expert_action", "expert_action", "float32", ("N", 5), "-, m, m, m, rad",
        "What an expert meant when its gripper was pushed off its way now and then; `action` is what was commanded.",
        axes="base", components=("opening", "dx", "dy", "dz", "dtheta"), parts=ACTION_PARTS, optional=True,
    ),
    Field(
        "streams/wrench/t_ns", "wrench_t_ns", "int64", ("M",), "ns", "Time of each wrench reading, episode clock.",
        bounds=TIME,
    ),
    Field(
        "streams/wrench/wrench", "wrench", "float32", ("M", 6), "N, N, N, N m, N m, N m",
        "Raw load that the environment put on the gripper (gravity of the gripper included), native rate.",
        axes="base", about="sensor origin", components=("fx", "fy", "fz", "mx", "my", "mz"), parts=WRENCH_PARTS,
    ),
    Field(
        "streams/wrench/tare", "tare", "float64", (6,), "N, N, N, N m, N m, N m",
        "Offset to subtract from `wrench`, read after the arm is home.",
        axes="base", about="sensor origin", components=("fx", "fy", "fz", "mx", "my", "mz"), parts=WRENCH_PARTS,
    ),
    Field(
        "streams/joints/t_ns", "joints_t_ns", "int64", ("L",), "ns", "Time of each joint reading, episode clock.",
        optional=True, bounds=TIME,
    ),
    Field(
        "streams/joints/position", "joints", "float32", ("L", "J"), "rad, m",
        "Measured joint positions in the order of the arm's URDF (arm, then fingers).", optional=True,
    ),
    Field(
        "streams/object/t_ns", "object_t_ns", "int64", ("P",), "ns", "Time of each object pose, episode clock.",
        optional=True, bounds=TIME,
    ),
    Field(
        "streams/object/pose", "object_pose", "float64", ("P", 7), "m, -",
        "Pose of the task's object: position, then quat_xyzw (simulation or tracked).",
        axes="base", about="base origin", components=("x", "y", "z", "qx", "qy", "qz", "qw"), optional=True,
    ),
    Field(
        "streams/object/half_extents", "object_half", "float64", (3,), "m",
        "Half the edges of the task's object, a box.", axes="object", optional=True, bounds=POSITIVE,
    ),
    Field(
        "streams/tags/t_ns", "tags_t_ns", "int64", ("Q",), "ns",
        "Time of each look of the tag cameras from the first sighting on, episode clock.", optional=True, bounds=TIME,
    ),
    Field(
        "streams/tags/pose", "tags_pose", "float64", ("Q", 7), "m, -",
        "Last pose of the task's object that its fiducial tags gave: position, then quat_xyzw.",
        axes="base", about="base origin", components=("x", "y", "z", "qx", "qy", "qz", "qw"), optional=True,
    ),
    Field(
        "streams/tags/age", "tags_age", "float64", ("Q",), "s",
        "Time since the object was seen at `pose`; 0 where it was seen now, larger while it is hidden.", optional=True,
        bounds=POSITIVE,
    ),
    Field(
        "streams/tags/error", "tags_error", "float64", ("Q",), "px",
        "Root mean square reprojection error of the edges of its tags.", optional=True, bounds=POSITIVE,
    ),
    Field(
        "streams/tags/margin", "tags_margin", "float64", ("Q",), "grey levels",
        "Smallest decision margin of its tags.", optional=True,
    ),
    Field(
        "streams/tags/count", "tags_count", "int64", ("Q",), "-", "Number of tags that gave it.", optional=True,
        bounds=POSITIVE,
    ),
    Field(
        "cameras/{camera}/t_ns", "t_ns", "int64", ("F",), "ns", "Time of each frame, episode clock.", bounds=TIME,
    ),
    Field(
        "cameras/{camera}/color", "color", "uint8", ("F", "H", "W", 3), "-",
        "Colour image, sRGB, rows run downwards.", components=("red", "green", "blue"), image=True,
    ),
    Field(
        "cameras/{camera}/depth", "depth", "uint16", ("F", "H", "W"), "depth_scale m",
        "Distance along the camera's viewing axis; 0 where there is no measurement.", image=True, optional=True,
    ),
    Field(
        "cameras/{camera}/depth_scale", "depth_scale", "float64", (), "m", "Metres per unit of `depth`.",
        optional=True, bounds=DEPTH_SCALE,
    ),
    Field(
        "cameras/{camera}/intrinsics", "intrinsics", "float64", (3, 3), "px",
        "Pinhole matrix K; the centre of the top left pixel is (0, 0).",
    ),
    Field(
        "cameras/{camera}/T_base_camera", "T_base_camera", "float64", (4, 4), "m",
        "Pose of the camera; camera axes: x right, y down, z forward.",
        axes="base", about="base origin",
    ),
    Field(
        "cameras/{camera}/image_axes", "image_axes", "float64", (2, 2), "-",
        "Orthogonal matrix that takes base (x, y) to image-aligned (right, up).",
    ),
    Field(
        "workspace", "workspace", "float64", (3, 2), "m",
        "Lower and upper bound of TCP x, y, z; its (x, y) centre is the centre of symmetry.",
        axes="base", about="base origin",
    ),
    Field(
        "labels/offset", "label_offset", "float64", (2,), "m",
        "Block centre minus TCP: the displacement that would centre the gripper over the block.",
        axes="base", about="TCP", components=("dx", "dy"), parts=OFFSET_PARTS, optional=True,
    ),
    Field(
        "labels/direction", "label_direction", "int64", (), "-",
        "Nearest image-aligned direction to `labels/offset`: 0 right, 1 up, 2 left, 3 down.", optional=True,
        bounds=(0, len(DIRECTIONS) - 1),
    ),
)  # fmt: skip

OF_EPISODE = {field.name: field for field in FIELDS if CAMERA not in field.path}
OF_CAMERA = {field.name: field for field in FIELDS if CAMERA in field.path}
_BY_PATH = {field.path: field for field in FIELDS}


def field_at(path: str) -> Field | None:
    """Return the declaration of a dataset, or None for `EXTRA` arrays and unknown paths.

    Args:
        path: Dataset path, with the name of the camera in place of `CAMERA`.
    """
    group, _, rest = path.partition("/")
    if group == "cameras":
        _, _, leaf = rest.partition("/")
        path = f"cameras/{CAMERA}/{leaf}"
    return _BY_PATH.get(path)


def is_image(path: str) -> bool:
    """Return whether a dataset path is declared to hold images."""
    field = field_at(path)
    return field is not None and field.image


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


def shape_words(field: Field) -> str:
    """Return the shape of a field as the documentation writes it, e.g. ``(N+1, 5)``."""
    return "(" + ", ".join(map(str, field.shape)) + ("," if len(field.shape) == 1 else "") + ")"


def markdown_table() -> str:
    """Return the Markdown table of all fields for ``data/README.md``."""
    lines = [
        "| dataset | shape | dtype | unit | axes | about | rotates | meaning |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for field in FIELDS:
        optional = " *Optional.*" if field.optional else ""
        names = f" Components: {', '.join(field.components)}." if field.components and not field.image else ""
        lines.append(
            f"| `{field.path}` | {shape_words(field)} | {field.dtype} | {field.unit} | {field.axes} | {field.about} "
            f"| {field.rotates} | {field.doc}{names}{optional} |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown_table())
