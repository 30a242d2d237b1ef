"""Unfinished episodes in ``.inflight`` that no writer of ours has left; behind each of them waits a good one."""

import json
import os
import zlib

import numpy as np

from svfl_data.recording.journal import HEADER, MAGIC
from tests.helpers.builders import episode_arrays
from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add, outside

GOOD = 60
"""Number of the episode in the good journal."""


def record(label, content=b""):
    """A record of a journal, its checksum right."""
    words = label if isinstance(label, bytes) else json.dumps(label).encode()
    return HEADER.pack(MAGIC, len(words), len(content), zlib.crc32(content, zlib.crc32(words))) + words + content


def meta(index, /, **changes):
    """What a journal begins with."""
    found = {
        "task": "block_picking", "index": index, "seed": 0, "source": "robot", "success": True, "config": {},
        "software": {}, "transforms": [], "annotations": [], "history": [],
    }  # fmt: skip
    return found | changes


CONSTANT = ("tare", "depth_scale", "intrinsics", "T_base_camera", "image_axes", "workspace", "half_extents")


def records(index):
    """The records of a whole recording that was not ended, by path."""
    arrays = episode_arrays(np.random.default_rng([5, index]), size=76)
    arrays = {path: array for path, array in arrays.items() if not path.startswith("labels/")}
    found = {}
    for path, array in arrays.items():
        constant = path.rpartition("/")[2] in CONSTANT
        place = {"constant": True} if constant else {"start": 0}
        label = {"path": path, "dtype": array.dtype.str, "shape": list(array.shape), **place}
        found[path] = label, array.tobytes()
    return found


def journal(index, changed=None, first=None, tail=b""):
    """A whole journal; `changed` gives labels, or labels and contents, of some paths."""
    parts = [record({"meta": meta(index)}) if first is None else first]
    for path, (label, content) in records(index).items():
        change = (changed or {}).get(path, {})
        if isinstance(change, tuple):
            change, content = change
        parts.append(record(label | change, content))
    return b"".join(parts) + tail


def _with(content):
    """A hostile journal before a good one, as their names sort."""

    def make(folder):
        place = folder / ".inflight"
        place.mkdir(exist_ok=True)
        found = content(folder) if callable(content) else content
        if found is not None:
            (place / "episode_000050.journal").write_bytes(found)
        (place / f"episode_{GOOD:06d}.journal").write_bytes(journal(GOOD))

    return make


WRENCH, TIMES, TARE, ACTION = "streams/wrench/wrench", "streams/wrench/t_ns", "streams/wrench/tare", "actions/action"
LABELS = {
    "shape_huge": {WRENCH: {"shape": [10**15, 6]}},
    "shape_negative": {WRENCH: {"shape": [-1, 6]}},
    "shape_text": {WRENCH: {"shape": "ab"}},
    "shape_number": {WRENCH: {"shape": 7}},
    "shape_empty": {WRENCH: {"shape": []}},
    "shape_floats": {WRENCH: {"shape": [2.5, 6]}},
    "shape_null": {WRENCH: {"shape": None}},
    "shape_overflow": {WRENCH: {"shape": [2**63, 2**63]}},
    "shape_zero_rows": {WRENCH: {"shape": [10**12, 0]}},
    "start_negative": {WRENCH: {"start": -5}},
    "start_huge": {WRENCH: {"start": 10**18}},
    "start_text": {WRENCH: {"start": "0"}},
    "start_float": {WRENCH: {"start": 0.5}},
    "start_true": {WRENCH: {"start": True}},
    "start_hole": {WRENCH: {"start": 100}},
    "dtype_object": {WRENCH: {"dtype": "|O"}},
    "dtype_unknown": {WRENCH: {"dtype": "no type"}},
    "dtype_number": {WRENCH: {"dtype": 4}},
    "dtype_list": {WRENCH: {"dtype": [["a", "<f4"], ["b", "|O"]]}},
    "dtype_void": {WRENCH: {"dtype": "|V1000000000"}},
    "dtype_empty": {WRENCH: {"dtype": "|S0"}},
    "dtype_commas": {WRENCH: {"dtype": "f4," * 1000 + "f4"}},
    "constant_object": {TARE: {"dtype": "|O"}},
    "constant_shape": {TARE: {"shape": [-1]}},
    "constant_huge": {TARE: {"shape": [10**12]}},
    "constant_odd_bytes": {TARE: ({}, b"odd")},
    "constant_text": {TARE: {"constant": "no"}},
    "path_dots": {WRENCH: {"path": "../../outside/x"}},
    "path_absolute": {WRENCH: {"path": "/etc/passwd"}},
    "path_number": {WRENCH: {"path": 7}},
    "path_list": {WRENCH: {"path": ["a"]}},
    "path_null": {WRENCH: {"path": None}},
    "path_empty": {WRENCH: {"path": ""}},
    "path_escapes": {WRENCH: {"path": "extra/" + HIDDEN}},
    "path_under_another": {WRENCH: {"path": TIMES + "/x"}},
    "path_deep": {WRENCH: {"path": "extra/" + "g/" * 5000 + "x"}},
    "path_long": {WRENCH: {"path": "extra/" + "g" * 100_000}},
    "nan": {WRENCH: ({}, np.full((199, 6), np.nan, "f4").tobytes())},
    "meta_in_a_label": {WRENCH: {"meta": 7}},
    "end_in_a_label": {WRENCH: {"end": []}},
}


def _first(**changes):
    return lambda folder: journal(50, first=record({"meta": meta(50, **changes)}))


METAS = {
    "index_text": {"index": "x"}, "index_negative": {"index": -1}, "index_huge": {"index": 10**400},
    "index_other": {"index": 0}, "index_float": {"index": 0.5}, "index_list": {"index": []},
    "task_number": {"task": 7}, "task_escapes": {"task": HIDDEN}, "task_null": {"task": None},
    "task_other": {"task": "x"},
    "seed_text": {"seed": "x"}, "success_text": {"success": "x"}, "config_list": {"config": [1]},
    "history_text": {"history": "x"}, "history_numbers": {"history": [1]}, "annotations_object": {"annotations": {}},
    "source_surrogate": {"source": "\ud800"}, "more": {"more": 1}, "config_nan": {"config": {"a": float("nan")}},
}  # fmt: skip


MINE = "streams/mine/value"


def _meant(declaration, dtype="<f4", **texts):
    """What a journal says of an array that is not standard."""
    whole = declaration if isinstance(declaration, str) else json.dumps(declaration)
    return {"dtype": dtype, "unit": "-", "axes": "-", "about": "-", "doc": "", "declaration": whole} | texts


def _rows_of(path, shape, dtype="<f4", content=None, **label):
    """A record with rows of an array of one's own, and one with as many times."""
    size = np.dtype(dtype).itemsize * int(np.prod(shape, dtype=object))
    found = {"path": path, "dtype": dtype, "shape": shape, "start": 0} | label
    return record(found, bytes(size) if content is None else content)


def _times(rows):
    return _rows_of("streams/mine/t_ns", [rows], "<i8", np.arange(rows).tobytes())


T2, ENDLESS = {"shape": ["T", 2]}, {"shape": ["T", "K"]}
DECLARED = {  # what is declared, and records that follow the journal
    "list": ([], b""),
    "number": (7, b""),
    "null": (None, b""),
    "numbers": ({MINE: 7}, b""),
    "number_for_a_text": ({MINE: {"dtype": 7, "declaration": []}}, b""),
    "no_texts": ({MINE: {}}, b""),
    "no_dtype": ({MINE: {"unit": "-", "axes": "-", "about": "-", "doc": "", "declaration": "{}"}}, b""),
    "no_json": ({MINE: _meant("{")}, b""),
    "deep": ({MINE: _meant("[" * 60_000)}, b""),
    "long": ({MINE: _meant(T2, doc="d" * 3_000_000)}, b""),
    "many": ({f"labels/x{k}": _meant({"shape": []}) for k in range(20_000)}, b""),
    "hidden_path": ({"streams/mine/" + HIDDEN: _meant(T2)}, b""),
    "surrogate_path": ({"streams/mine/\ud800": _meant(T2)}, b""),
    "outside": ({"../../outside/x": _meant(T2)}, b""),
    "top": ({"x": _meant(T2)}, b""),
    "extra": ({"extra/x": _meant("{")}, b""),
    "standard": ({WRENCH: _meant({"shape": ["M", 7]})}, b""),
    "standard_assumed": ({WRENCH: _meant({"shape": ["M", 7], "assumed": ["unit"]})}, b""),
    "standard_dtype": ({ACTION: _meant({"shape": ["N", 5]}, "|S9")}, b""),
    "action_of_ten": ({ACTION: _meant({"shape": ["N", 10]})}, b""),
    "clock": ({MINE: _meant(T2), "streams/mine/t_ns": _meant({"shape": ["T"]}, "<f8")}, b""),
    "parts": ({MINE: _meant(T2 | {"parts": [["vector", [-1, 5]]]})}, b""),
    "bounds": ({MINE: _meant(T2 | {"bounds": [[1, 0], [1, 0]]})}, b""),
    "dtype_object": ({MINE: _meant(T2, "|O")}, b""),
    "dtype_unknown": ({MINE: _meant(T2, "no type")}, b""),
    "dtype_commas": ({MINE: _meant(T2, "f4," * 1000 + "f4")}, b""),
    "dtype_void": ({MINE: _meant(T2, "|V1000000000")}, b""),
    "dtype_bracket": ({MINE: _meant(T2, "(2,3")}, b""),
    "dtype_of_nothing": ({MINE: _meant(T2, "|S0")}, _rows_of(MINE, [2**47, 2], "|S0", b"") + _times(3)),
    "dtype_another": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 2], "<f8") + _times(3)),
    "rows_of_nothing": ({MINE: _meant(ENDLESS)}, _rows_of(MINE, [2**47, 0], content=b"") + _times(3)),
    "rows_of_nothing_declared": ({MINE: _meant({"shape": ["T", 0]})}, _rows_of(MINE, [2**47, 0], content=b"")),
    "constant_of_nothing": ({"labels/x": _meant({"shape": ["K", 0]})},
                            _rows_of("labels/x", [2**40, 0], content=b"", constant=True)),
    "constant_as_rows": ({"labels/x": _meant({"shape": [3]})}, _rows_of("labels/x", [3])),
    "rows_as_constant": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 2], constant=True) + _times(3)),
    "another_size": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 5]) + _times(3)),
    "without_clock": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 2])),
    "nan": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 2], content=np.full(6, np.nan, "f4").tobytes()) + _times(3)),
    "later": ({}, record({"declared": {MINE: _meant(T2)}}) + _rows_of(MINE, [3, 2]) + _times(3)),
    "again": ({MINE: _meant(T2)}, record({"meta": meta(50), "declared": {MINE: _meant({"shape": ["T", 3]})}})),
    "sound": ({MINE: _meant(T2)}, _rows_of(MINE, [3, 2]) + _times(3)),
}  # fmt: skip


def _declared(declared, more):
    return lambda folder: journal(50, first=record({"meta": meta(50), "declared": declared}), tail=more)


def _link(target):
    def make(folder):
        place = folder / ".inflight"
        place.mkdir(exist_ok=True)
        (place / "episode_000050.journal").symlink_to(target(folder))

    return make


def _pipe(folder):
    (folder / ".inflight" / "episode_000050.journal").unlink(missing_ok=True)
    os.mkfifo(folder / ".inflight" / "episode_000050.journal")


def _folder(folder):
    (folder / ".inflight" / "episode_000050.journal").mkdir(parents=True)


def _names(folder):
    place = folder / ".inflight"
    for name in (
        "episode_x.journal",
        "\x1b[31m.journal",
        "a\nb.journal",
        ".journal",
        "episode_" + "9" * 200 + ".journal",
    ):
        (place / name).write_bytes(journal(50))
    (place / "episode_000051.part").symlink_to(outside(folder))
    (place / f"episode_{GOOD:06d}.part").symlink_to(outside(folder))


BYTES = {"dtype": "|u1", "start": 0}
WHOLE = {
    "empty": b"",
    "zeros": bytes(10_000),
    "text": b"hello",
    "garbage": np.random.default_rng(2).bytes(100_000),
    "only_a_header": HEADER.pack(MAGIC, 2, 0, 0),
    "label_no_json": record(b"{"),
    "label_null": record(b"null") + record({"meta": meta(50)}),
    "label_list": record(b"[]"),
    "label_number": record(b"7"),
    "label_deep": record(b"[" * 200_000 + b"]" * 200_000),
    "label_deep_objects": record(b'{"meta":' * 100_000 + b"1" + b"}" * 100_000),
    "label_not_utf8": record(b'"\xff\xfe"'),
    "label_huge_integer": record(b'{"path": "x", "start": 1' + b"0" * 10_000 + b"}"),
    "label_empty_object": record({}) + record({"meta": meta(50)}),
    "label_says_gigabytes": HEADER.pack(MAGIC, 2**32 - 1, 2**63, 0),
    "content_says_more": HEADER.pack(MAGIC, 2, 2**64 - 1, 0) + b"{}",
    "meta_null": record({"meta": None}),
    "meta_list": record({"meta": []}) + record({"end": []}),
    "meta_only": record({"meta": meta(50)}),
    "meta_missing_keys": record({"meta": {"task": "x"}}),
    "no_meta": lambda folder: journal(50, first=b""),
    "meta_twice": lambda folder: journal(50, tail=record({"meta": meta(51)})),
    "end_list": lambda folder: journal(50, tail=record({"end": [1]})),
    "end_missing_keys": lambda folder: journal(50, tail=record({"end": {}})),
    "end_other": lambda folder: journal(50, tail=record({"end": meta(0, index="../../x")})),
    "end_escapes": lambda folder: journal(50, tail=record({"end": meta(50, task=HIDDEN)})),
    "truncated": lambda folder: journal(50)[:-5000],
    "tail_of_garbage": lambda folder: journal(50, tail=b"x" * 10_000),
    "sparse": None,
    "many_records": lambda folder: journal(50, tail=record(BYTES | {"path": "extra/x", "shape": [0]}) * 100_000),
    "many_paths": lambda folder: journal(
        50, tail=b"".join(record(BYTES | {"path": f"extra/x{k}", "shape": [1]}, b"x") for k in range(5000))
    ),
    "many_empty_metas": lambda folder: record({"meta": meta(50)}) * 50_000,
}  # fmt: skip


def _sparse(folder):
    """A journal of 100 GB of holes that its first record announces."""
    _with(None)(folder)
    with open(folder / ".inflight" / "episode_000050.journal", "wb") as file:
        file.write(HEADER.pack(MAGIC, 2, 100 * 2**30, 0) + b"{}")
        file.truncate(110 * 2**30)


def _both(make):
    def both(folder):
        _with(None)(folder)
        make(folder)

    return both


for name, labels in LABELS.items():
    add("journals", f"label_{name}", "journal", _with(lambda folder, labels=labels: journal(50, labels)))
for name, changes in METAS.items():
    add("journals", f"meta_{name}", "journal", _with(_first(**changes)))
for name, declared in DECLARED.items():
    add("journals", f"declared_{name}", "journal", _with(_declared(*declared)))
for name, content in WHOLE.items():
    if name != "sparse":
        add("journals", f"whole_{name}", "journal", _with(content), slow=name.startswith("many"))
add("journals", "whole_sparse", "journal", _sparse)
add("journals", "link_to_a_secret", "journal", _both(_link(outside)))
add("journals", "link_to_zeros", "journal", _both(_link(lambda folder: "/dev/zero")))
add("journals", "link_to_a_pipe", "journal", _both(_link(lambda folder: outside(folder, "pipe"))))
add("journals", "link_to_nowhere", "journal", _both(_link(lambda folder: outside(folder, "nothing"))))
add("journals", "pipe", "journal", _both(_pipe))
add("journals", "folder", "journal", _both(_folder))
add("journals", "names", "journal", _both(_names))
