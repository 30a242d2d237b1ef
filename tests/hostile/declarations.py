"""Episodes whose declarations are none: not JSON, beyond every size, against the array, the place or each other."""

import json

import h5py
import numpy as np

from svfl_data.schema.action_fields import joint_action
from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add
from tests.hostile.making_episodes import reopened, replace, rows

ACTION, WRENCH, TIMES, COLOR = "actions/action", "streams/wrench/wrench", "observations/t_ns", "cameras/front/color"
OWN, CLOCK = "streams/mine/value", "streams/mine/t_ns"
FIELD = "a field of one's own may say so"
STEPS = 7
"""Readings of the stream of one's own."""


def declare(file, path, declaration, **texts):
    """Give an array the attributes of a declaration."""
    whole = declaration if isinstance(declaration, str | bytes) else json.dumps(declaration)
    said = {"unit": "-", "axes": "-", "about": "-", "doc": ""} | texts | {"declaration": whole}
    for name, text in said.items():
        if name in file[path].attrs:
            del file[path].attrs[name]
        if text is not None:
            file[path].attrs.create(name, text)


def own(value=None, declaration=None, path=OWN, clock=True, **texts):
    """An array of one's own; by default a stream of two components with its clock."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            file.create_dataset(path, data=np.zeros((STEPS, 2), "f4") if value is None else value)
            declare(file, path, {"shape": ["T", 2]} if declaration is None else declaration, **texts)
            if clock and path.startswith("streams/"):
                file[CLOCK] = np.arange(STEPS) * 10**7
                declare(file, CLOCK, {"shape": ["T"], "possible": [-(2**62) + 1, 2**62 - 1]}, unit="ns")

    return make


def said(path, **changes):
    """Another declaration of an array that is there."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            found = json.loads(file[path].attrs["declaration"])
            file[path].attrs["declaration"] = json.dumps(found | changes)

    return make


def raw(path, text):
    """Any text in the place of a declaration."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            del file[path].attrs["declaration"]
            if text is not None:
                file[path].attrs.create("declaration", text)

    return make


RAW = {
    "none": None,
    "empty": "",
    "no_json": "{",
    "null": "null",
    "number": "7",
    "list": "[]",
    "text": '"shape"',
    "object": "{}",
    "not_utf8": np.bytes_(b"\xff\xfe"),
    "an_array": np.zeros((3, 3)),
    "a_float": 7.5,
    "nothing": h5py.Empty("S1"),
    "deep_lists": "[" * 30_000 + "]" * 30_000,
    "deep_objects": '{"a":' * 10_000 + "1" + "}" * 10_000,
    "deep_unknown_key": '{"shape":["N",5],"x":' + "[" * 20_000 + "]" * 20_000 + "}",
    "8_mb": '{"shape":["N",5],"x":"' + "x" * (2**23 - 100) + '"}',
    "9_mb": '{"shape":["N",5],"x":"' + "x" * (9 * 2**20) + '"}',
    "surrogate": '{"shape":["N",5],"components":["\\ud800","b","c","d","e"]}',
    "duplicate_keys": '{"shape":["N",5],"shape":["N",-5]}',
    "huge_integer": '{"shape":["N",5' + "0" * 5000 + "]}",
    "infinity": '{"shape":["N",5],"bounds":[[-1e999,1e999],[0,1],[0,1],[0,1],[0,1]]}',
    "nan": '{"shape":["N",5],"bounds":[[NaN,1],[0,1],[0,1],[0,1],[0,1]]}',
}
for name, text in RAW.items():
    for where, path in (("action", ACTION), ("times", TIMES)):
        add("declarations", f"raw_{where}_{name}", "episode", raw(path, text))

ROW = [[0, 1]] * 5
OF_ACTION = {
    "shape_negative": {"shape": ["N", -5]},
    "shape_huge": {"shape": ["N", 10**30]},
    "shape_64_bits": {"shape": ["N", 2**62]},
    "shape_zero": {"shape": ["N", 0]},
    "shape_empty": {"shape": []},
    "shape_empty_symbol": {"shape": ["N", ""]},
    "shape_number_first": {"shape": [5, 5]},
    "shape_float": {"shape": ["N", 5.5]},
    "shape_true": {"shape": ["N", True]},
    "shape_null": {"shape": None},
    "shape_text": {"shape": "N5"},
    "shape_long": {"shape": ["N"] + [1] * 20_000},
    "shape_symbol_of_another": {"shape": ["N", "M"]},
    "shape_hidden_symbol": {"shape": ["N", HIDDEN]},
    "shape_long_symbol": {"shape": ["N", "n" * 60_000]},
    "parts_negative": {"parts": [["vector", [-1, -2]], ["invariant", [0, 1, 2]]]},
    "parts_huge": {"parts": [["invariant", [0, 1, 2, 3, 2**70]]]},
    "parts_twice": {"parts": [["vector", [1, 1]], ["invariant", [0, 3, 4]]]},
    "parts_short": {"parts": [["invariant", [0]]]},
    "parts_long": {"parts": [["invariant", list(range(9000))]]},
    "parts_none_in_one": {"parts": [["invariant", [0, 1, 2, 3, 4]], ["invariant", []]]},
    "parts_only_empty": {"parts": [["pseudoscalar", []]] * 3000},
    "parts_of_three": {"parts": [["vector", [0, 1, 2]], ["invariant", [3, 4]]]},
    "parts_unknown_kind": {"parts": [["spinor", [0, 1, 2, 3, 4]]]},
    "parts_kind_number": {"parts": [[7, [0]]]},
    "parts_object": {"parts": {"vector": [0, 1]}},
    "parts_floats": {"parts": [["invariant", [0.0, 1.0, 2.0, 3.0, 4.0]]]},
    "parts_and_shape_huge": {"shape": ["N", 2**40], "parts": [["invariant", [0]]], "components": [], "bounds": [],
                             "delta": []},
    "components_few": {"components": ["a"]},
    "components_many": {"components": ["a"] * 9000},
    "components_hidden": {"components": [HIDDEN, "b", "c", "d", "e"]},
    "components_newline": {"components": ["a\nsvfl-data: fine", "b", "c", "d", "e"]},
    "components_empty": {"components": ["", "b", "c", "d", "e"]},
    "components_long": {"components": ["a" * 10_000] * 5},
    "components_numbers": {"components": [1, 2, 3, 4, 5]},
    "bounds_reversed": {"bounds": [[1, 0]] * 5},
    "bounds_equal": {"bounds": [[1, 1]] * 5},
    "bounds_few": {"bounds": [[0, 1]]},
    "bounds_triples": {"bounds": [[0, 1, 2]] * 5},
    "bounds_huge": {"bounds": [[-1e308, 1e308]] * 5},
    "bounds_text": {"bounds": [["a", "b"]] * 5},
    "delta_few": {"delta": [True]},
    "delta_numbers": {"delta": [1, 0, 1, 0, 1]},
    "possible_reversed": {"possible": [5, -5]},
    "possible_huge": {"possible": [-(10**200), 10**200]},
    "possible_triple": {"possible": [0, 1, 2]},
    "assumed_unknown": {"assumed": ["everything"]},
    "assumed_hidden": {"assumed": [HIDDEN]},
    "assumed_shape": {"assumed": ["shape"]},
    "image": {"image": True},
    "image_number": {"image": 1},
}  # fmt: skip
for name, changes in OF_ACTION.items():
    add("declarations", f"action_{name}", "episode", said(ACTION, **changes))
LAWFUL = {
    "bounds_narrow": {"bounds": [[0, 1e-300]] * 5},
    "no_parts": {"parts": []},
    "no_bounds": {"bounds": [], "delta": []},
    "components_unicode": {"components": ["öffnung", "dx", "dy", "dz", "Δθ"]},
    "components_equal": {"components": ["a"] * 5},
    "components_markup": {"components": ["<b>", "|", "$\\frac{", "`", "![x](http:x)"]},
    "assumed": {"assumed": ["unit", "axes", "about", "components", "parts", "bounds", "delta"]},
    "more_keys": {"colour": [[]]},
}
for name, changes in LAWFUL.items():
    add("declarations", f"lawful_action_{name}", "episode", said(ACTION, **changes), legal=FIELD)

STANDARD = {
    "unit": lambda file: file[WRENCH].attrs.__setitem__("unit", "lb"),
    "axes": lambda file: file[WRENCH].attrs.__setitem__("axes", "sensor"),
    "shape": lambda file: declare(file, "labels/offset", {"shape": [3]}, unit="m", axes="base", about="TCP"),
    "another_shape_assumed": lambda file: declare(file, WRENCH, {"shape": ["M", 7], "assumed": ["unit"]}, unit="N"),
    "clock": lambda file: declare(file, "streams/wrench/t_ns", {"shape": ["M"]}, unit="s"),
    "image_no_image": lambda file: declare(file, COLOR, {"shape": ["F", "H", "W", 3], "assumed": ["unit"]}),
    "workspace_grows": lambda file: declare(file, "workspace", {"shape": ["N", 2], "assumed": ["axes"]}, unit="m"),
    "own_camera_of_nothing": lambda file: _put(file, "cameras/back/x", np.zeros(3), {"shape": [3]}),
    "undeclared": lambda file: file.create_dataset("streams/more/value", data=np.zeros(3)),
    "undeclared_top": lambda file: file.create_dataset("more", data=np.zeros(3)),
    "undeclared_no_doc": lambda file: _put(file, "labels/more", np.zeros(3), {"shape": [3]}, doc=None),
}


def _put(file, path, value, declaration, **texts):
    file[path] = value
    declare(file, path, declaration, **texts)


def _changed(change):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            change(file)

    return make


for name, change in STANDARD.items():
    add("declarations", f"standard_{name}", "episode", _changed(change))
add(
    "declarations", "standard_doc_8_mb", "episode",
    _changed(lambda file: file[WRENCH].attrs.__setitem__("doc", "d" * (2**23 - 1))),
    legal="the words of a standard field are not read",
)  # fmt: skip

PLACES = {
    "top": "mine", "two_deep": "streams/a/b/c", "stream_itself": "streams/mine_alone", "actions_deep": "actions/a/b",
    "groups": "groups/a/b", "splits": "splits/default", "camera_itself": "cameras/mine", "cameras_deep": "cameras/a/b",
    "format": "format/version", "clock_of_labels": "labels/t_ns", "clock_of_actions": "actions/t_ns",
    "hidden": "streams/mine/" + HIDDEN.replace("\x00", ""), "placeholder": "cameras/{camera}/more",
}  # fmt: skip
for name, path in PLACES.items():
    add("declarations", f"place_{name}", "episode", own(np.zeros(3), {"shape": [3]}, path, clock=False))


def steps(value):
    """A row for each action of the episode."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            count = len(file[ACTION])
            whole, declaration, texts = value(count)
            replace(file, ACTION, data=whole)
            declare(file, ACTION, declaration, **texts)

    return make


def _texts(field):
    found = dict(field.attributes)
    return found.pop("declaration"), found


ACTIONS = {
    "text": lambda n: (np.full((n, 5), b"left"), {"shape": ["N", 5]}, {}),
    "complex": lambda n: (np.full((n, 5), 1j, "c8"), {"shape": ["N", 5]}, {}),
    "bool": lambda n: (np.ones((n, 5), bool), {"shape": ["N", 5]}, {}),
    "float16": lambda n: (np.ones((n, 5), "f2"), {"shape": ["N", 5]}, {}),
    "float64": lambda n: (np.ones((n, 5)), {"shape": ["N", 5]}, {}),
    "int64": lambda n: (np.ones((n, 5), np.int64), {"shape": ["N", 5]}, {}),
    "flat": lambda n: (np.ones(n, "f4"), {"shape": ["N"]}, {}),
    "deep": lambda n: (np.ones((n, 2, 2, 2), "f4"), {"shape": ["N", 2, 2, 2]}, {}),
    "image": lambda n: (np.ones((n, 8, 8), "u1"), {"shape": ["N", 8, 8], "image": True}, {}),
    "1000": lambda n: (np.ones((n, 1000), "f4"), {"shape": ["N", 1000]}, {}),
    "symbol": lambda n: (np.ones((n, 9), "f4"), {"shape": ["N", "K"]}, {}),
    "joints": lambda n: (np.ones((n, 3), "f4"), *_texts(joint_action([(-2, 2)] * 3, ["a", "b", "c"]))),
}
NO_ACTIONS = ("text", "complex", "bool", "flat", "deep", "image", "symbol")
for name, value in ACTIONS.items():
    legal = "" if name in NO_ACTIONS else "each robot has its own action"
    add("declarations", f"action_of_{name}", "episode", steps(value), legal)

T2 = {"shape": ["T", 2]}
OWNS = {  # value, declaration, legal
    "sound": (np.zeros((STEPS, 2), "f4"), T2, FIELD),
    "text": (np.full((STEPS, 2), b"x" * 9), T2, FIELD),
    "complex": (np.full((STEPS, 2), 1 + 1j), T2, FIELD),
    "bool": (np.ones((STEPS, 2), bool), T2, FIELD),
    "float16": (np.full((STEPS, 2), 6e4, "f2"), T2, FIELD),
    "uint64": (np.full((STEPS, 2), 2**62, "u8"), T2 | {"possible": [0, 2**62]}, FIELD),
    "large_rows": (np.zeros((STEPS, 300, 300), "f4"), {"shape": ["T", 300, 300]}, FIELD),
    "large_symbol": (np.zeros((STEPS, 50_000), "f4"), {"shape": ["T", "K"]}, FIELD),
    "vector_of_deep": (np.ones((STEPS, 3, 2), "f4"), {"shape": ["T", 3, 2], "parts": [["vector", [0, 1]]]}, FIELD),
    "hidden_texts": (None, T2, FIELD),
    "far": (np.full((STEPS, 2), 1e18, "f4"), T2 | {"possible": [-(2.0**62), 2.0**62]}, FIELD),
    "farther": (np.full((STEPS, 2), 3e38, "f4"), T2 | {"possible": [-1e300, 1e300]}, ""),
    "complex_nan": (np.full((STEPS, 2), complex(0, np.nan)), T2, ""),
    "complex_huge": (np.full((STEPS, 2), 1e308 + 1e308j), T2, ""),
    "float16_infinite": (np.full((STEPS, 2), np.inf, "f2"), T2, ""),
    "big_endian": (np.zeros((STEPS, 2), ">f4"), T2, ""),
    "long_double": (np.zeros((STEPS, 2), np.longdouble), T2, ""),
    "nan": (np.full((STEPS, 2), np.nan, "f4"), T2, ""),
    "no_size": (np.zeros((STEPS, 0), "f4"), {"shape": ["T", 0]}, ""),
    "no_size_of_a_symbol": (np.zeros((STEPS, 0), "f4"), {"shape": ["T", "K"]}, ""),
    "another_size": (np.zeros((STEPS, 3), "f4"), T2, ""),
    "another_dimension": (np.zeros(STEPS, "f4"), T2, ""),
    "rows_of_another": (np.zeros((STEPS + 1, 2), "f4"), T2, ""),
    "number_of_rows": (np.zeros((STEPS, 2), "f4"), {"shape": [STEPS, 3]}, ""),
    "scalar_with_parts": (np.float32(1), {"shape": [], "parts": [["invariant", [0]]]}, ""),
    "scalar_with_components": (np.float32(1), {"shape": [], "components": ["a"]}, ""),
    "image_flat": (np.zeros(STEPS, "u1"), {"shape": ["T"], "image": True}, ""),
    "image_of_five": (np.zeros((STEPS, 2, 2, 2, 2), "u1"), {"shape": ["T", 2, 2, 2, 2], "image": True}, ""),
    "image_that_stands": (np.zeros((2, 2, 2), "u1"), {"shape": [2, 2, 2], "image": True}, ""),
    "image_with_parts": (np.zeros((STEPS, 2, 2), "u1"),
                         {"shape": ["T", 2, 2], "image": True, "parts": [["vector", [0, 1]]]}, ""),
    "image": (np.zeros((STEPS, 4, 4), "u1"), {"shape": ["T", 4, 4], "image": True}, FIELD),
    "image_nan": (np.full((STEPS, 4, 4), np.nan, "f4"), {"shape": ["T", 4, 4], "image": True}, ""),
}  # fmt: skip
for name, (value, declaration, legal) in OWNS.items():
    texts = dict.fromkeys(("unit", "axes", "about", "doc"), HIDDEN.replace("\x00", "")) if "hidden" in name else {}
    add("declarations", f"own_{name}", "episode", own(value, declaration, **texts), legal)
add("declarations", "own_label_scalar_parts", "episode",
    own(np.float32(1), {"shape": [], "parts": [["invariant", [0]]]}, "labels/mine"))  # fmt: skip
add("declarations", "own_without_clock", "episode", own(clock=False))


def _rows_of_nothing(path, declaration):
    """An array that claims 2^47 rows of no bytes."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            file.create_dataset(path, shape=(2**47, 0), dtype="f4")
            declare(file, path, declaration)

    return make


add("declarations", "own_endless_rows", "episode", _rows_of_nothing("streams/mine/value", {"shape": ["T", "K"]}))
add("declarations", "own_endless_rows_zero", "episode", _rows_of_nothing("streams/mine/value", {"shape": ["T", 0]}))

CLOCKS = {
    "int32": (np.arange(STEPS, dtype="i4"), {"shape": ["T"]}, "ns"),
    "float": (np.arange(STEPS, dtype="f8"), {"shape": ["T"]}, "ns"),
    "text": (np.full(STEPS, b"now"), {"shape": ["T"]}, "ns"),
    "of_two": (np.zeros((STEPS, 2), np.int64), {"shape": ["T", 2]}, "ns"),
    "unit": (np.arange(STEPS), {"shape": ["T"], "possible": [-(2**62) + 1, 2**62 - 1]}, "s"),
    "wide": (np.arange(STEPS), {"shape": ["T"], "possible": [-(2**63), 2**63 - 1]}, "ns"),
    "scalar": (np.int64(3), {"shape": []}, "ns"),
    "undeclared": (np.arange(STEPS), None, "ns"),
    "least": (np.full(STEPS, -(2**63)), {"shape": ["T"], "possible": [-(2**62) + 1, 2**62 - 1]}, "ns"),
}


def _clocked(value, declaration, unit):
    def make(folder):
        own(clock=False)(folder)
        with reopened(folder, libver="latest") as file:
            file[CLOCK] = value
            if declaration is not None:
                declare(file, CLOCK, declaration, unit=unit)

    return make


for name, clock in CLOCKS.items():
    add("declarations", f"clock_{name}", "episode", _clocked(*clock))
add("declarations", "clock_alone", "episode", own(np.arange(3), {"shape": ["T"]}, CLOCK, clock=False, unit="ns"))
BACKWARD = np.arange(STEPS)[::-1] * 10**7
add("declarations", "clock_backward", "order_aside",
    _clocked(BACKWARD, {"shape": ["T"], "possible": [-(2**62) + 1, 2**62 - 1]}, "ns"),
    legal="a finding of the stream of one's own")  # fmt: skip


def _of_camera(name, value, declaration):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            frames = len(file["cameras/front/t_ns"])
            file[f"cameras/front/{name}"] = value(frames)
            declare(file, f"cameras/front/{name}", declaration)

    return make


CAMERA = {
    "exposure": (lambda f: np.ones(f, "f4"), {"shape": ["F"]}, FIELD),
    "thermal": (lambda f: np.ones((f, 76, 76), "f4"), {"shape": ["F", "H", "W"], "image": True}, FIELD),
    "seven_channels": (lambda f: np.ones((f, 8, 8, 7), "u1"), {"shape": ["F", 8, 8, 7], "image": True}, FIELD),
    "a_first_image": (lambda f: np.ones((f, 8, 9), "u1"), {"shape": ["F", 8, 9], "image": True}, FIELD),
    "image_of_bytes": (lambda f: np.full((f, 8, 8), b"x"), {"shape": ["F", 8, 8], "image": True}, ""),
    "distortion": (lambda f: np.ones(5), {"shape": [5]}, FIELD),
    "another_size": (lambda f: np.ones((f, 8, 8), "u1"), {"shape": ["F", "H", "W"], "image": True}, ""),
    "another_count": (lambda f: np.ones((f + 1, 2), "u1"), {"shape": ["F", 2]}, ""),
}
for name, (value, declaration, legal) in CAMERA.items():
    add("declarations", f"camera_{name}", "episode", _of_camera(name, value, declaration), legal)


def _only_own_images(folder):
    with reopened(folder, libver="latest") as file:
        frames = len(file["cameras/front/t_ns"])
        for name in ("color", "depth", "depth_scale"):
            del file[f"cameras/front/{name}"]
        file["cameras/front/mine"] = np.ones((frames, 76, 76), "u1")
        declare(file, "cameras/front/mine", {"shape": ["F", "H", "W"], "image": True})


add("declarations", "camera_of_own_images_only", "episode", _only_own_images, legal=FIELD)


def _many(number, doc):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            for k in range(number):
                file[f"observations/mine_{k}"] = np.zeros((len(file[TIMES]), 2), "f4")
                declare(file, f"observations/mine_{k}", {"shape": ["N+1", 2], "components": ["a", "b"]}, doc=doc)

    return make


add("declarations", "own_300", "episode", _many(300, ""), legal=FIELD)
add("declarations", "own_240_long", "episode", _many(240, "d" * 60_000), legal=FIELD)
add("declarations", "own_300_too_long", "episode", _many(300, "d" * 60_000))
add("declarations", "own_doc_8_mb", "episode", own(doc="d" * (2**23 - 1)))
add("declarations", "own_2000", "episode", _many(2000, ""))


def _long_lines(folder):
    with reopened(folder, libver="latest") as file:
        for k in range(200):
            file[f"labels/mine_{k}"] = np.zeros(600)
            declare(file, f"labels/mine_{k}", {"shape": [600], "components": ["c" * 90] * 600})


add("declarations", "own_texts_of_12_mb", "episode", _long_lines, legal=FIELD)


def _wrench_tare(folder):
    """A tare that its readings do not have the shape of."""
    with reopened(folder, libver="latest") as file:
        _put(file, OWN, np.ones((STEPS, 6), "f4"), {"shape": ["T", 6]})
        _put(file, "streams/mine/tare", np.ones(5), {"shape": [5]})
        _put(file, CLOCK, np.arange(STEPS), {"shape": ["T"], "possible": [-(2**62) + 1, 2**62 - 1]}, unit="ns")


add("declarations", "own_tare_of_five", "episode", _wrench_tare, legal=FIELD)
add("declarations", "texts_as_bytes", "episode", own(unit=np.bytes_(b"m")), legal="bytes that are text say the same")
add("declarations", "unit_number", "episode", own(unit=7))
add("declarations", "unit_array", "episode", own(unit=np.arange(3)))
add("declarations", "unit_65_kb", "episode", own(unit="u" * 65_537))
add("declarations", "bounds_of_the_action_are_crossed", "episode", lambda folder: (
    said(ACTION, bounds=[[5, 6]] * 5)(folder), rows(folder, ACTION, lambda old: old * 0)),
    legal="what is commanded beyond the bounds is a finding")  # fmt: skip
