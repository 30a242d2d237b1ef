"""Episodes of the right form whose numbers are none: what a check of types and shapes lets through."""

import numpy as np

from tests.hostile.kind import add, hostile
from tests.hostile.making_episodes import put, reopened, replace, rows

CAMERA = "cameras/front"
CONSTANTS = ("tare", "intrinsics", "T_base_camera", "image_axes", "half_extents")
INT64 = np.iinfo(np.int64)


def _rotation(*diagonal):
    pose = np.eye(4)
    pose[:3, :3] = np.diag(diagonal)
    return pose


def _with(value, index, number):
    changed = np.array(value)
    changed[index] = number
    return changed


CHANGED = {
    "depth_scale_zero": (f"{CAMERA}/depth_scale", lambda old: np.zeros_like(old)),
    "depth_scale_negative": (f"{CAMERA}/depth_scale", lambda old: -old),
    "depth_scale_nan": (f"{CAMERA}/depth_scale", lambda old: old * np.nan),
    "depth_scale_infinite": (f"{CAMERA}/depth_scale", lambda old: old * np.inf),
    "depth_scale_huge": (f"{CAMERA}/depth_scale", lambda old: old * 0 + 1e300),
    "depth_scale_tiny": (f"{CAMERA}/depth_scale", lambda old: old * 0 + 5e-324),
    "intrinsics_zero": (f"{CAMERA}/intrinsics", np.zeros_like),
    "intrinsics_singular": (f"{CAMERA}/intrinsics", np.ones_like),
    "intrinsics_negative_focus": (f"{CAMERA}/intrinsics", lambda old: _with(old, (0, 0), -70.0)),
    "intrinsics_no_focus": (f"{CAMERA}/intrinsics", lambda old: _with(old, (1, 1), 0.0)),
    "intrinsics_last_row": (f"{CAMERA}/intrinsics", lambda old: _with(old, (2, 2), 0.0)),
    "intrinsics_nan": (f"{CAMERA}/intrinsics", lambda old: old * np.nan),
    "intrinsics_huge": (f"{CAMERA}/intrinsics", lambda old: old * 1e300),
    "axes_zero": (f"{CAMERA}/image_axes", np.zeros_like),
    "axes_not_orthogonal": (f"{CAMERA}/image_axes", lambda old: np.array([[1.0, 1.0], [0.0, 1.0]])),
    "axes_scaled": (f"{CAMERA}/image_axes", lambda old: 2 * old),
    "pose_zero": (f"{CAMERA}/T_base_camera", np.zeros_like),
    "pose_no_rotation": (f"{CAMERA}/T_base_camera", lambda old: _rotation(2.0, 1.0, 1.0)),
    "pose_mirror": (f"{CAMERA}/T_base_camera", lambda old: _rotation(1.0, 1.0, -1.0)),
    "pose_last_row": (f"{CAMERA}/T_base_camera", lambda old: _with(old, 3, 1.0)),
    "pose_nan": (f"{CAMERA}/T_base_camera", lambda old: old * np.nan),
    "pose_infinite": (f"{CAMERA}/T_base_camera", lambda old: _with(old, (0, 3), np.inf)),
    "workspace_inverted": ("workspace", lambda old: old[:, ::-1].copy()),
    "workspace_flat": ("workspace", np.zeros_like),
    "workspace_huge": ("workspace", lambda old: old * 1e308),
    "times_constant": ("observations/t_ns", lambda old: old * 0 + old[0]),
    "times_backward": ("observations/t_ns", lambda old: old[::-1].copy()),
    "times_repeated": ("observations/t_ns", lambda old: _with(old, 1, old[0])),
    "times_least": ("observations/t_ns", lambda old: _with(old, 0, INT64.min)),
    "times_most": ("observations/t_ns", lambda old: _with(old, -1, INT64.max)),
    "times_overflow": ("observations/t_ns", lambda old: _with(_with(old, 0, INT64.min), -1, INT64.max)),
    "times_all_least": ("observations/t_ns", lambda old: INT64.min + np.arange(len(old))),
    "wrench_times_constant": ("streams/wrench/t_ns", lambda old: old * 0 + old[0]),
    "wrench_times_backward": ("streams/wrench/t_ns", lambda old: old[::-1].copy()),
    "wrench_times_overflow": ("streams/wrench/t_ns", lambda old: _with(_with(old, 0, INT64.min), -1, INT64.max)),
    "camera_times_constant": (f"{CAMERA}/t_ns", lambda old: old * 0 + old[0]),
    "camera_times_backward": (f"{CAMERA}/t_ns", lambda old: old[::-1].copy()),
    "object_times_backward": ("streams/object/t_ns", lambda old: old[::-1].copy()),
    "joints_times_constant": ("streams/joints/t_ns", lambda old: old * 0 + old[0]),
    "direction_7": ("labels/direction", lambda old: np.asarray(7, old.dtype)),
    "direction_negative": ("labels/direction", lambda old: np.asarray(-1, old.dtype)),
    "direction_huge": ("labels/direction", lambda old: np.asarray(INT64.max, old.dtype)),
    "offset_nan": ("labels/offset", lambda old: old * np.nan),
    "offset_huge": ("labels/offset", lambda old: old * 0 + 1e308),
    "wrench_3e38": ("streams/wrench/wrench", lambda old: np.full_like(old, 3e38)),
    "wrench_one_3e38": ("streams/wrench/wrench", lambda old: _with(old, (3, 2), 3e38)),
    "wrench_nan": ("streams/wrench/wrench", lambda old: _with(old, (3, 2), np.nan)),
    "wrench_infinite": ("streams/wrench/wrench", lambda old: _with(old, (-1, 0), -np.inf)),
    "tare_1e308": ("streams/wrench/tare", lambda old: old * 0 + 1e308),
    "proprio_huge": ("observations/proprio", lambda old: np.full_like(old, 3e38)),
    "proprio_nan": ("observations/proprio", lambda old: _with(old, (0, 0), np.nan)),
    "action_huge": ("actions/action", lambda old: np.full_like(old, -3e38)),
    "action_infinite": ("actions/action", lambda old: _with(old, (0, 3), np.inf)),
    "joints_huge": ("streams/joints/position", lambda old: np.full_like(old, 3e38)),
    "object_quaternion_zero": ("streams/object/pose", lambda old: old * 0),
    "object_quaternion_long": ("streams/object/pose", lambda old: old * 1e300),
    "tags_quaternion_zero": ("streams/tags/pose", lambda old: old * 0),
    "tags_age_negative": ("streams/tags/age", lambda old: old - 1e300),
    "tags_count_negative": ("streams/tags/count", lambda old: old * 0 + INT64.min),
    "half_extents_zero": ("streams/object/half_extents", lambda old: old * 0),
    "half_extents_huge": ("streams/object/half_extents", lambda old: old * 0 + 1e308),
}  # fmt: skip
LAWFUL = {
    "proprio_huge": "a check may call it a warning", "action_huge": "a check may call it a warning",
    "joints_huge": "other joints have other limits",
    "tags_age_negative": "a warning", "tags_count_negative": "a warning",
    "offset_huge": "a warning", "half_extents_huge": "a warning",
    "tare_1e308": "a warning", "half_extents_zero": "a warning",
    "depth_scale_huge": "a warning", "depth_scale_tiny": "a warning", "workspace_huge": "a warning",
    "intrinsics_huge": "a warning", "camera_times_constant": "two frames of one time are a warning",
    "times_most": "a gap of centuries is a warning", "times_least": "a gap of centuries is a warning",
    "times_all_least": "the episode clock begins where it likes",
    "joints_times_constant": "a warning", "object_quaternion_long": "a warning",
}  # fmt: skip
"""Where a warning of validate will do; that no command fails over them remains the law."""

OUT_OF_ORDER = dict.fromkeys(
    ("times_constant", "times_backward", "times_repeated", "wrench_times_constant", "wrench_times_backward",
     "camera_times_backward"), "order",
) | {"object_times_backward": "order_aside"}  # fmt: skip
"""What can be looked at, but is unfit for training; of the object, no training reads the times."""

for name, (path, change) in CHANGED.items():
    add(
        "values",
        name,
        OUT_OF_ORDER.get(name, "episode"),
        lambda folder, path=path, change=change: rows(folder, path, change),
        LAWFUL.get(name, ""),
    )


def _cut(folder, steps):
    """The episode's first steps only."""
    with reopened(folder) as file:
        for path in list(_paths(file)):
            keep = {"observations": steps + 1, "actions": steps}.get(path.split("/")[0])
            if keep is not None:
                replace(file, path, data=file[path][:keep])


def _paths(file):
    found = []
    file.visititems(lambda path, item: found.append(path) if hasattr(item, "shape") else None)
    return found


@hostile("episode", legal="an episode in which nothing was done is one")
def no_steps(folder):
    _cut(folder, 0)


@hostile("episode", legal="one step is an episode")
def one_step(folder):
    _cut(folder, 1)


@hostile("episode")
def no_observation(folder):
    rows(folder, "observations/t_ns", lambda old: old[:0])


@hostile("episode")
def nothing_at_all(folder):
    with reopened(folder) as file:
        for path in _paths(file):
            grows = path.startswith(("observations", "actions", "streams", "cameras")) and file[path].ndim
            if grows and path.rpartition("/")[2] not in CONSTANTS:
                replace(file, path, data=file[path][:0])


@hostile("episode", legal="a sensor that gave nothing is a warning")
def no_readings(folder):
    with reopened(folder) as file:
        for name in ("t_ns", "wrench"):
            replace(file, f"streams/wrench/{name}", data=file[f"streams/wrench/{name}"][:0])


@hostile("episode", legal="one reading is a stream")
def one_reading(folder):
    with reopened(folder) as file:
        for name in ("t_ns", "wrench"):
            replace(file, f"streams/wrench/{name}", data=file[f"streams/wrench/{name}"][:1])


@hostile("episode", legal="a camera that gave nothing is a warning")
def no_frames(folder):
    with reopened(folder) as file:
        for name in ("t_ns", "color", "depth"):
            replace(file, f"{CAMERA}/{name}", data=file[f"{CAMERA}/{name}"][:0])


def _pictures(height, width):
    def make(folder):
        with reopened(folder) as file:
            frames = len(file[f"{CAMERA}/t_ns"])
            replace(file, f"{CAMERA}/color", data=np.zeros((frames, height, width, 3), "u1"))
            replace(file, f"{CAMERA}/depth", data=np.zeros((frames, height, width), "u2"))

    return make


add("values", "pictures_0x0", "episode", _pictures(0, 0))
add("values", "pictures_0x64", "episode", _pictures(0, 64))
add("values", "pictures_1x1", "episode", _pictures(1, 1), legal="one pixel is a picture")
add("values", "pictures_1x4096", "episode", _pictures(1, 4096), legal="a line is a picture")
add("values", "pictures_of_another_size", "episode", _pictures(48, 80), legal="one episode alone may have any size")


@hostile("episode", legal="what stands in extra/ is the user's own")
def extra_nan(folder):
    put(folder, "extra/x", np.full((5, 3), np.nan))


@hostile("episode", legal="what stands in extra/ is the user's own")
def extra_clock_backward(folder):
    with reopened(folder) as file:
        file["extra/mine/t_ns"] = np.arange(9, dtype=np.int64)[::-1].copy()
        file["extra/mine/value"] = np.zeros(3)


@hostile("episode", legal="what stands in extra/ is the user's own")
def extra_called_like_fields(folder):
    with reopened(folder) as file:
        for path in ("cameras/front/color", "streams/wrench/t_ns", "observations/t_ns", "labels/direction"):
            file[f"extra/{path}"] = np.array(["x"] * 3, dtype="S1")


@hostile("episode")
def depth_without_scale(folder):
    with reopened(folder) as file:
        del file[f"{CAMERA}/depth_scale"]


@hostile("episode")
def color_without_clock(folder):
    with reopened(folder) as file:
        del file[f"{CAMERA}/t_ns"]


@hostile("episode", legal="a thousand cameras are many, but cameras")
def thousand_cameras(folder):
    with reopened(folder, libver="latest") as file:
        for number in range(300):
            file.copy("cameras/front", f"cameras/c{number}")


@hostile("episode", legal="a camera of the same name as a stream")
def camera_called_like_a_stream(folder):
    with reopened(folder) as file:
        file.move("cameras/front", "cameras/t_ns")
