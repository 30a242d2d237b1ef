"""What is valid, however odd, every tool shows or refuses in one line; what is invalid, all refuse alike."""

from dataclasses import replace

import numpy as np
import pytest

from tests.helpers.builders import episode_arrays
from tests.helpers.sealed import META, dataset_of
from tests.helpers.spoiled import INVALID, put, without

pytestmark = pytest.mark.slow

CAMERA = "cameras/front"


def rows(count, *groups):
    """Leave only the first rows of groups."""

    def change(arrays):
        for path in arrays:
            if path.rpartition("/")[0] in groups and arrays[path].shape[:1] > (count,) and path.rpartition("/")[2] in (
                "t_ns", "color", "depth", "wrench", "pose", "position", "action", "expert_action", "proprio",
            ):  # fmt: skip
                arrays[path] = arrays[path][:count]

    return change


def clocks(change):
    """Change all time stamps."""

    def changed(arrays):
        for path in arrays:
            if path.endswith("/t_ns"):
                arrays[path] = change(arrays[path])

    return changed


def no_steps(arrays):
    rows(0, "actions")(arrays)
    rows(1, "observations")(arrays)


def ends_of_time(arrays):
    for path in arrays:
        if path.endswith("/t_ns"):
            arrays[path] = arrays[path].copy()
            arrays[path][[0, -1]] = 1 - 2**62, 2**62 - 1


def user_arrays(arrays):
    arrays["extra/x/y"] = np.array([np.nan, np.inf, 1])
    arrays["extra/state/achieved"] = np.full((5, 3), np.nan)
    arrays["extra/nothing"] = np.array(np.nan)


def all_huge(arrays):
    arrays["observations/proprio"][:, 1:4] = 1e6
    arrays["streams/wrench/wrench"][:] = 1e6
    arrays["streams/joints/position"][:] = 1e6
    arrays["labels/offset"][:] = 1e6
    arrays["workspace"][:] = [[-1e6, 1e6]] * 3


def no_camera(arrays):
    for path in [path for path in arrays if path.startswith("cameras/")]:
        del arrays[path]


def one_pixel(arrays):
    for name in ("color", "depth"):
        arrays[f"{CAMERA}/{name}"] = np.ascontiguousarray(arrays[f"{CAMERA}/{name}"][:, :1, :1])


def nothing(arrays):
    pass


ODD = {
    "all times equal": clocks(np.zeros_like),
    "times from the end": clocks(lambda t_ns: t_ns[::-1].copy()),
    "times of all of time": ends_of_time,
    "no frames": rows(0, CAMERA),
    "one frame": rows(1, CAMERA),
    "no readings": rows(0, "streams/wrench", "streams/joints", "streams/object"),
    "one reading": rows(1, "streams/wrench", "streams/joints"),
    "no steps": no_steps,
    "the user's NaN": user_arrays,
    "no offset": without("labels/offset"),
    "no direction": without("labels/direction"),
    "everything huge": all_huge,
    "a workspace of a millimetre": put("workspace", slice(None), [0, 1e-3]),
    "focal lengths of a pixel": put(f"{CAMERA}/intrinsics", [0, 1], [0, 1], 1.0),
    "the smallest unit of depth": put(f"{CAMERA}/depth_scale", 1e-6),
    "the largest unit of depth": put(f"{CAMERA}/depth_scale", 1.0),
    "a camera on the table": put(f"{CAMERA}/T_base_camera", slice(0, 3), 3, 0.0),
    "a camera far away": put(f"{CAMERA}/T_base_camera", slice(0, 3), 3, 1e6),
    "no camera": no_camera,
    "a pixel": one_pixel,
    "no depth": put(f"{CAMERA}/depth", slice(None), 0),
}
METAS = {
    "a gap": {"annotations": [{"name": "gap", "stream": "streams/wrench", "start_ns": 250, "end_ns": 300}]},
    "strange rates": {"config": {"rates_hz": {"streams/wrench": "fast", "cameras/front": -1, "observations": True}}},
    "rates that are none": {"config": {"rates_hz": [500]}},
    "a filter without end": {"transforms": [{"name": "low_pass", "cutoff_hz": 1e-300}]},
    "a gripper of a thousand tons": {"transforms": [{"name": "gravity", "mass_kg": 1e6, "centre_m": [1e6, 0, 0]}]},
    "bounds that are none": {"config": {"max_move": "far", "max_turn": True}},
}
TOOLS = (
    ("validate",), ("info",), ("info", "--episode", "0"), ("plot", "--episode", "0", "--out", "p.png"),
    ("topdown", "--episode", "0", "--out", "t.png"), ("card", "--out", "card.md"),
    ("view", "--episode", "0", "--out", "v.rrd"),
)  # fmt: skip


def use_all(command, folder, tmp_path):
    """What each tool says: code and standard error."""
    said = {}
    for name, *options in TOOLS:
        words = [str(tmp_path / word) if "." in word else word for word in options]
        code, _, err = command(name, folder, *words)
        assert "Traceback" not in err
        assert code == 0 or len(err.strip().splitlines()) == 1, err
        said[(name, *options)] = code, err
    return said


@pytest.mark.parametrize("name", [*ODD, *METAS])
def test_what_is_valid_ends_no_tool(name, command, tmp_path, recwarn):
    arrays = episode_arrays(np.random.default_rng(0), steps=4)
    ODD.get(name, nothing)(arrays)
    folder = dataset_of(tmp_path / "d", arrays, replace(META, **METAS.get(name, {})))
    said = use_all(command, folder, tmp_path)
    assert said["info",][0] == 0
    assert not [str(one.message) for one in recwarn if issubclass(one.category, RuntimeWarning)]


@pytest.mark.parametrize("name", ["depth scale 0", "intrinsics zero", "wrench 3e38", "no pixels", "direction 7"])
def test_what_is_invalid_is_refused_alike_by_every_tool(name, command, tmp_path):
    spoil, field, words = INVALID[name]
    arrays = episode_arrays(np.random.default_rng(0), steps=20)
    spoil(arrays)
    folder = dataset_of(tmp_path / "d", arrays)
    said = use_all(command, folder, tmp_path)
    for tool, (code, err) in said.items():
        if tool not in (("validate",), ("info",)):  # these tell what they find on standard output
            assert code == 1
            assert "episode_000000.hdf5" in err
            assert field in err
            assert words in err
    assert said["validate",][0] == 1
