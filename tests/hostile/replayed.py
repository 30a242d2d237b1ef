"""Simulated episodes whose configuration says what no simulation can do, for ``svfl-collect replay``.

These are made of a dataset that the simulation has recorded (`tests.hostile.sound.simulated_dataset`).
"""

import json

from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add
from tests.hostile.making_episodes import reopened, text

DIFFERS = "another world is a difference, which the command is there to report; it may also be none"


def _config(change):
    """The configuration, changed; `change` may return another one."""

    def make(folder):
        with reopened(folder, libver="latest") as file:
            found = json.loads(file.attrs["config"])
            changed = change(found)
            text(file, "config", json.dumps(found if changed is None else changed))

    return make


def _at(path, value):
    def change(found):
        *way, last = path.split(".")
        for name in way:
            found = found[name]
        found[last] = value

    return _config(change)


def _every_number(value):
    def changed(found):
        if isinstance(found, dict):
            return {key: changed(item) for key, item in found.items()}
        if isinstance(found, list):
            return [changed(item) for item in found]
        return value if type(found) in (int, float) else found

    return _config(lambda found: {**found, "world": changed(found["world"])})


VALUES = {
    "text": "x", "null": None, "list": [], "object": {}, "huge": 10**12, "huge_integer": 10**400, "zero": 0,
    "negative": -1, "true": True, "escapes": HIDDEN, "nested": [[[[]]]],
}  # fmt: skip
for name, value in VALUES.items():
    add("replayed", f"world_{name}", "config", _at("world", value))
    add("replayed", f"attempt_{name}", "config", _at("attempt", value), legal="" if name != "zero" else DIFFERS)
    add("replayed", f"drawn_{name}", "config", _at("drawn", value))
    add("replayed", f"cameras_{name}", "config", _at("world.cameras", value), legal=DIFFERS if name == "object" else "")
    add("replayed", f"camera_{name}", "config", _at("world.cameras.front", value))
    add("replayed", f"camera_height_{name}", "config", _at("world.cameras.front.height", value))
    add("replayed", f"index_{name}", "config", _at("index", value), legal=DIFFERS if name in ("zero", "null") else "")
for name in ("zero", "negative", "huge"):
    add("replayed", f"every_number_{name}", "config", _every_number(VALUES[name]))
    add("replayed", f"every_number_{name}_as_float", "config", _every_number(float(VALUES[name])))
add("replayed", "every_number_tiny", "config", _every_number(1e-300))
add("replayed", "nothing", "config", _config(lambda found: {}))
add("replayed", "unknown_key", "config", _at("world.unknown", 7))
add("replayed", "thousand_cameras", "config", _config(
    lambda found: found["world"].update(
        cameras=dict.fromkeys(map(str, range(1000)), found["world"]["cameras"]["front"]))))  # fmt: skip
add("replayed", "camera_of_a_hundred_megapixels", "config", _config(
    lambda found: found["world"]["cameras"]["front"].update(height=10_000, width=10_000)))  # fmt: skip


def _task(name):
    def make(folder):
        with reopened(folder) as file:
            text(file, "task", name)

    return make


for name, task in {
    "unknown": "nothing",
    "centering": "centering",
    "path": "../../x",
    "module": "os",
    "escapes": HIDDEN,
}.items():
    add("replayed", f"task_{name}", "config", _task(task.replace("\x00", "")))


def _history(entries):
    def make(folder):
        with reopened(folder) as file:
            text(file, "history", json.dumps(entries))

    return make


for name, entries in {
    "numbers": [1, 2], "came_from_number": [{"came_from": 7}], "came_from_empty": [{"came_from": {}}],
    "came_from_text": [{"came_from": {"index": "x", "seed": []}}],
    "came_from_huge": [{"came_from": {"index": 10**400, "seed": 0, "dataset": "x"}}],
}.items():  # fmt: skip
    add("replayed", f"history_{name}", "config", _history(entries), legal=DIFFERS)


def _seed(value):
    def make(folder):
        with reopened(folder) as file:
            file.attrs["seed"] = value

    return make


for name, value in {"negative": -1, "largest": 2**63 - 1, "least": -(2**63)}.items():
    add("replayed", f"seed_{name}", "config", _seed(value))
