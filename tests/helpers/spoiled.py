"""Episodes in which one thing is wrong: for each kind of fault a function that makes it and says how it is named."""

import numpy as np

from tests.helpers.builders import episode_arrays

WRENCH_T, WRENCH, TARE = "streams/wrench/t_ns", "streams/wrench/wrench", "streams/wrench/tare"
FRAMES, COLOR, DEPTH = "cameras/front/t_ns", "cameras/front/color", "cameras/front/depth"


def fresh(steps=20, **kwargs):
    """Arrays of an episode without a fault, whose gripper moves."""
    arrays = episode_arrays(np.random.default_rng(0), steps=steps, **kwargs)
    arrays["observations/proprio"][:, 1] = np.linspace(0.4, 0.6, steps + 1)
    return arrays


# Each spoils one thing and returns the field, index, severity and words of the finding.


def duplicate_time(arrays):
    arrays[WRENCH_T][77] = arrays[WRENCH_T][76]
    return WRENCH_T, 77, "error", "duplicate timestamps at row 77 (0.154 s)"


def constant_time(arrays):
    arrays["observations/t_ns"][:] = arrays["observations/t_ns"][0]
    return "observations/t_ns", 1, "error", "duplicate timestamps at rows 1 (0.200 s), 2 (0.200 s)"


def milliseconds(arrays):
    arrays["observations/t_ns"] //= 1_000_000
    return "observations/t_ns", None, "error", "they must be nanoseconds, not microseconds or milliseconds"


def backward_time(arrays):
    arrays[WRENCH_T][[80, 81]] = arrays[WRENCH_T][[81, 80]]
    return WRENCH_T, 81, "error", "backward timestamps (out of order) at row 81 (0.162 s)"


def clock_set_back(arrays):
    arrays[WRENCH_T][300:] -= 100_500_000
    return WRENCH_T, 300, "error", "stepped clock: set by -100.5 ms at row 300 (0.501 s)"


def clock_set_forward(arrays):
    arrays[WRENCH_T][300:] += 1_000_000_000
    return WRENCH_T, 300, "error", "stepped clock: set by +1000.0 ms at row 300 (1.602 s)"


def camera_clock_set_forward(arrays):
    arrays[FRAMES][7:] += 500_000_000
    return FRAMES, 7, "error", "stepped clock: set by +500.0 ms at row 7 (1.050 s)"


def gap(arrays):
    arrays[WRENCH_T] = np.delete(arrays[WRENCH_T], slice(100, 105))
    arrays[WRENCH] = np.delete(arrays[WRENCH], slice(100, 105), axis=0)
    return WRENCH_T, 100, "warning", "gaps before row 100 (0.212 s); the widest is 12.0 ms, 6.0 periods of 2 ms"


def jitter(arrays):
    shake = np.random.default_rng(0).integers(-900_000, 900_000, len(arrays[WRENCH_T]))
    shake[[0, -1]] = 0
    arrays[WRENCH_T] = arrays[WRENCH_T] + shake
    return WRENCH_T, None, "warning", "jitter: intervals vary by"


def drop_outs(arrays):
    kept = np.arange(len(arrays[WRENCH_T])) % 20 != 7
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][kept], arrays[WRENCH][kept]
    return WRENCH_T, None, "warning", "(475.0 Hz by mean interval, 500.0 Hz by median)"


def foreign_clock(arrays):
    for path in arrays:
        if path.endswith("t_ns"):
            arrays[path] = arrays[path] + 86_400 * 10**9
    return "observations/t_ns", 0, "warning", "the clock does not start with the episode"


def clock_of_the_epoch(arrays):
    arrays["observations/t_ns"] = arrays["observations/t_ns"] + 1_700_000_000 * 10**9
    return "observations/t_ns", None, "error", "has time stamps 19676 days from the episode's beginning"


def late_start(arrays):
    arrays[FRAMES] = arrays[FRAMES] + 10_000_000
    return FRAMES, 0, "warning", "nothing at or before the first observation (0.200 s): starts at 0.210 s"


def early_end(arrays):
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][:400], arrays[WRENCH][:400]
    return WRENCH_T, 399, "warning", "ends at 0.800 s, the last observation is at 1.200 s"


def empty_stream(arrays):
    arrays[WRENCH_T], arrays[WRENCH] = arrays[WRENCH_T][:0], arrays[WRENCH][:0]
    return WRENCH_T, None, "warning", "the stream is empty"


def saturation(arrays):
    push = 60 * np.sin(np.linspace(0, np.pi, 200))
    arrays[WRENCH][200:400, 0] += np.minimum(push, 50).astype(np.float32)
    clipped = arrays[WRENCH][200:400, 0]
    arrays[WRENCH][200:400, 0] = np.where(push > 50, 50.0, clipped)
    return WRENCH, 200 + int((push > 50).argmax()), "error", "fx is saturated"


def stuck(arrays):
    arrays[WRENCH][250:350] = arrays[WRENCH][250]
    return WRENCH, 250, "error", "stuck sensor: 100 identical readings in a row from 0.502 s to 0.700 s"


def no_sensor(arrays):
    arrays[WRENCH][:] = 0
    return WRENCH, None, "warning", "every reading is zero"


def tare_missing(arrays):
    arrays[TARE][:] = 0
    return TARE, 2, "warning", "the tare is missing (all zero): fz reads -8 N on average"


def tare_of_another_day(arrays):
    arrays[TARE][4] += 0.5
    return TARE, 4, "warning", "the tare does not fit: my reads 0.02"


def black_image(arrays):
    arrays[COLOR][5:8] = 0
    return COLOR, 5, "error", "3 of 21 images are all black: rows 5 (0.450 s), 6 (0.500 s), 7 (0.550 s)"


def grey_image(arrays):
    arrays[COLOR][5] = 128
    return COLOR, 5, "error", "1 of 21 images are of one grey: row 5 (0.450 s)"


def frozen_picture(arrays):
    arrays[COLOR][4:14] = arrays[COLOR][4]
    return COLOR, 4, "warning", "frozen picture: 10 identical images from 0.400 s to 0.850 s"


def depth_holes(arrays):
    arrays[DEPTH][3, :12] = 0
    return DEPTH, 3, "warning", "depth holes: 1 of 21 images lack more than 50% of their pixels, row 3 (0.350 s)"


def no_depth(arrays):
    arrays[DEPTH][:] = 0
    return DEPTH, 0, "error", "no measurement in any depth image"


def constant_depth(arrays):
    arrays[DEPTH][9] = 5000
    return DEPTH, 9, "error", "1 of 21 depth images are constant"


def action_too_large(arrays):
    arrays["actions/action"][6, 2] = 0.026
    return "actions/action", 6, "error", "dy is 0.026 m, outside -0.025 to 0.025 m (declared bounds)"


def opening_too_large(arrays):
    arrays["actions/action"][6, 0] = 1.2
    return "actions/action", 6, "error", "opening is 1.2, outside"


def turn_too_large(arrays):
    arrays["actions/action"][0, 4] = -0.3
    return "actions/action", 0, "error", "dtheta is -0.3 rad"


def gripper_far_away(arrays):
    arrays["observations/proprio"][9, 3] = 0.5
    return "observations/proprio", 9, "warning", "TCP z = 0.500 m is 250 mm outside the workspace"


def gripper_opening_in_metres(arrays):
    arrays["observations/proprio"][2:, 0] = 80
    return "observations/proprio", 2, "warning", "gripper opening 80 is not within 0 to 1"


def label_missing(arrays):
    del arrays["labels/direction"]
    return "labels", None, "warning", "label missing: direction"


def label_inconsistent(arrays):
    arrays["labels/direction"] = (arrays["labels/direction"] + 1) % 4
    return "labels/direction", None, "error", "label inconsistent: direction"


SPOILERS = [
    duplicate_time, constant_time, backward_time, clock_set_back, clock_set_forward, camera_clock_set_forward, gap,
    jitter, drop_outs, milliseconds, foreign_clock, clock_of_the_epoch, late_start, early_end, empty_stream,
    saturation, stuck, no_sensor,
    tare_missing, tare_of_another_day, black_image, grey_image, frozen_picture, depth_holes, no_depth, constant_depth,
    action_too_large, opening_too_large, turn_too_large, gripper_far_away, gripper_opening_in_metres, label_missing,
    label_inconsistent,
]  # fmt: skip


# What makes an episode invalid: path and words. Each gives a function that changes arrays.


def put(path, *index_and_value):
    """Put a number into an array."""
    *index, value = index_and_value

    def spoil(arrays):
        arrays[path] = arrays[path].copy()
        arrays[path][tuple(index)] = value

    return spoil


def without(*paths):
    """Leave arrays out."""

    def spoil(arrays):
        for path in paths:
            del arrays[path]

    return spoil


def without_pixels(arrays):
    """Images of no height."""
    for path in (COLOR, DEPTH):
        arrays[path] = arrays[path][:, :0]


def mirrored(arrays):
    """A camera that no lens makes."""
    arrays["cameras/front/T_base_camera"][:3, 0] *= -1


def upside_down(arrays):
    """A workspace whose top is below its bottom."""
    arrays["workspace"][2] = arrays["workspace"][2, ::-1].copy()


CAMERA = "cameras/front"
INVALID = {
    "depth scale 0": (put(f"{CAMERA}/depth_scale", 0.0), f"{CAMERA}/depth_scale", "holds 0; possible are 1e-06 to 1"),
    "depth scale negative": (put(f"{CAMERA}/depth_scale", -1e-4), f"{CAMERA}/depth_scale", "holds -0.0001"),
    "depth scale tiny": (put(f"{CAMERA}/depth_scale", 1e-300), f"{CAMERA}/depth_scale", "holds 1e-300"),
    "depth without unit": (
        without(f"{CAMERA}/depth_scale"),
        f"{CAMERA}/depth_scale",
        "is missing, so the depth",
    ),
    "intrinsics zero": (put(f"{CAMERA}/intrinsics", 0.0), f"{CAMERA}/intrinsics", "has focal lengths [0.0, 0.0] px"),
    "intrinsics one": (put(f"{CAMERA}/intrinsics", 1.0), f"{CAMERA}/intrinsics", "is not a pinhole matrix"),
    "focal length tiny": (put(f"{CAMERA}/intrinsics", 0, 0, 1e-9), f"{CAMERA}/intrinsics", "has focal lengths"),
    "pose stretched": (put(f"{CAMERA}/T_base_camera", 0, 0, 0.5), f"{CAMERA}/T_base_camera", "is not a pose"),
    "pose mirrored": (mirrored, f"{CAMERA}/T_base_camera", "is not a pose"),
    "pose zero": (put(f"{CAMERA}/T_base_camera", 0.0), f"{CAMERA}/T_base_camera", "is not a pose"),
    "axes stretched": (put(f"{CAMERA}/image_axes", 0, 1, 2.0), f"{CAMERA}/image_axes", "is not an orthogonal matrix"),
    "axes zero": (put(f"{CAMERA}/image_axes", 0.0), f"{CAMERA}/image_axes", "is not an orthogonal matrix"),
    "rotation of no length": (put("streams/object/pose", 4, slice(3, 7), 0.0), "streams/object/pose", "of norm 0 at"),
    "tags' rotation": (put("streams/tags/pose", 4, 6, 1.1), "streams/tags/pose", "of norm 1.1 at index (4,)"),
    "workspace inverted": (upside_down, "workspace", "at index (2,): the lower bound must be below"),
    "workspace flat": (put("workspace", 0, 0.1), "workspace", "at index (0,): the lower bound must be below"),
    "direction 7": (put("labels/direction", 7), "labels/direction", "holds 7; possible are 0 to 3"),
    "direction -1": (put("labels/direction", -1), "labels/direction", "holds -1; possible are 0 to 3"),
    "wrench 3e38": (put(WRENCH, 7, 2, 3e38), WRENCH, "holds 3e+38 at index (7, 2); possible are -1e+06 to 1e+06"),
    "wrench NaN": (put(WRENCH, 7, 2, np.nan), WRENCH, "holds nan at index (7, 2); only finite numbers"),
    "offset infinite": (put("labels/offset", 1, np.inf), "labels/offset", "holds inf at index (1,)"),
    "time at the end of int64": (put(WRENCH_T, -1, 2**63 - 1), WRENCH_T, "holds 9.22337e+18 at index (599,)"),
    "time at its beginning": (put("observations/t_ns", 0, -(2**63)), "observations/t_ns", "holds -9.22337e+18 at"),
    "no pixels": (without_pixels, COLOR, "H in (F, H, W, 3) must be at least 1"),
    "no times": (without("streams/joints/t_ns"), "streams/joints/t_ns", "is missing, so streams/joints/position has"),
    "age negative": (put("streams/tags/age", 3, -1.0), "streams/tags/age", "holds -1 at index (3,)"),
}
"""By name: what spoils an episode, the field that is to blame, and what is said of it."""
