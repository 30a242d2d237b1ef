"""What is said about an episode: JSON attributes and plain ones, of any type, depth and size."""

import json

import h5py
import numpy as np

from tests.hostile.kind import add
from tests.hostile.making_episodes import reopened, text

LISTS = ("transforms", "annotations", "history")
ATTRIBUTES = ("config", "software", *LISTS)
HIDDEN = "\x1b]0;owned\x07\x1b[2J\x1b[31m\r\nsvfl-data: fine\u202e\u2066\u200b\ue000\x00\x9b"
FREE = "any two numbers are an interval, if an empty one, and who found it is free JSON"
NO_RATES = "what is no rate declares none"
OWN = "a config is the recorder's own"
SHOWN = "text is data, and shown harmlessly"

BROKEN = {
    "no_json": "{",
    "empty": "",
    "deep_lists": "[" * 100_000 + "]" * 100_000,
    "deep_objects": '{"a":' * 50_000 + "1" + "}" * 50_000,
    "other_container": None,
    "a_number": "3",
    "null": "null",
    "a_text": '"text"',
    "nan": '{"a": NaN}',
    "infinity": '[{"a": -Infinity}]',
    "trailing": "{} {}",
    "byte_order_mark": "\ufeff{}",
}


def _json(name, value):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            text(file, name, value)

    return make


for name in ATTRIBUTES:
    for variant, value in BROKEN.items():
        if variant == "other_container":
            value = "{}" if name in LISTS else "[]"
        add("json", f"{name}_{variant}", "episode", _json(name, value))

ODD = {  # attribute, value, why it may stand
    "config_deep_but_legal": ("config", {"a": json.loads("[" * 60 + "]" * 60)}, "as deep as people go"),
    "config_lone_surrogate": ("config", '{"a": "\\ud800", "\\udfff": 1}', ""),
    "config_huge_integer": ("config", '{"a": 1' + "0" * 5000 + "}", ""),
    "config_integer_beyond_64_bits": ("config", '{"a": 1' + "0" * 30 + "}", "numbers of a config are its own"),
    "config_huge_exponent": ("config", '{"a": 1e999999}', ""),
    "config_10_mb": ("config", {"a": "x" * 10**7}, "long, but text"),
    "config_100000_keys": ("config", {f"k{k}": k for k in range(100_000)}, "many, but keys"),
    "config_duplicate_keys": ("config", '{"a": 1, "a": 2}', "the last one counts, says Python"),
    "config_escapes": ("config", {HIDDEN: HIDDEN}, SHOWN),
    "config_rates": ("config", {"rates_hz": {"streams/wrench": "fast", "x": None, "observations": -1}}, NO_RATES),
    "config_rates_no_object": ("config", {"rates_hz": [1, 2]}, NO_RATES),
    "config_max_move": ("config", {"world": {"max_move": "far"}, "max_move": [None]}, OWN),
    "config_max_move_far": ("config", {"world": {"max_move": -1e308}, "max_move": 1e308}, OWN),
    "config_perturbations": ("config", {"perturbations": 7, "camera": [], "robot": {}}, OWN),
    "config_world_no_object": ("config", {"world": 3, "scene": [], "attempt": "x"}, OWN),
    "software_numbers": ("software", {"svfl": 1, "x": None, "y": [[]]}, ""),
    "software_escapes": ("software", {HIDDEN: HIDDEN, "svfl": HIDDEN}, SHOWN),
    "software_10_mb": ("software", {"svfl": "9" * 10**7}, "long, but text"),
    "software_surrogate": ("software", '{"svfl": "\\udc80"}', ""),
    "history_numbers": ("history", [1, None, "x", []], ""),
    "history_came_from": ("history", [{"came_from": 7}, {"came_from": {"index": "x"}}, {"tool": []}], ""),
    "history_escapes": ("history", [{"tool": HIDDEN, "came_from": {"dataset": HIDDEN, "index": 1, "seed": 0}}], SHOWN),
    "history_100000": ("history", [{"tool": "relabel"}] * 100_000, "long, but a history"),
    "history_salvaged": ("history", [{"salvaged": {"a": 1}, "rows": "x", "tool": 3}], ""),
    "annotations_numbers": ("annotations", [1, None, "x", [], {}], ""),
    "annotations_no_name": ("annotations", [{"start_ns": 0, "end_ns": 10}], ""),
    "annotations_types": ("annotations", [{"name": 7, "start_ns": "a", "end_ns": None, "by": 3}], ""),
    "annotations_by_list": ("annotations", [{"name": "contact", "start_ns": 0, "end_ns": 1, "by": [1]}], FREE),
    "annotations_floats": ("annotations", [{"name": "slip", "start_ns": 0.5, "end_ns": 1e300}], ""),
    "annotations_huge": ("annotations", '[{"name": "slip", "start_ns": 1' + "0" * 400 + ', "end_ns": 2}]', ""),
    "annotations_backward": ("annotations", [{"name": "slip", "start_ns": 10**9, "end_ns": -(10**18)}], FREE),
    "annotations_int64": ("annotations", [{"name": "s", "start_ns": -(2**63), "end_ns": 2**63 - 1}], FREE),
    "annotations_beyond_int64": ("annotations", [{"name": "s", "start_ns": 0, "end_ns": 2**70}], ""),
    "annotations_escapes": ("annotations", [{"name": HIDDEN, "start_ns": 0, "end_ns": 9, "by": {"a": HIDDEN}}], SHOWN),
    "annotations_dollar": ("annotations", [{"name": "$\\frac{", "start_ns": 0, "end_ns": 10**8}], SHOWN),
    "annotations_surrogate": ("annotations", '[{"name": "\\ud83d", "start_ns": 0, "end_ns": 10}]', ""),
    "annotations_long": ("annotations", [{"name": "n" * 10**6, "start_ns": 0, "end_ns": 10**8}], "long, but text"),
    "annotations_50000": ("annotations", [{"name": f"a{k}", "start_ns": k, "end_ns": k} for k in range(50_000)], OWN),
    "transforms_numbers": ("transforms", [1, None, "x"], ""),
    "transforms_unknown": ("transforms", [{"name": "rm -rf", "kind": "x"}], "what shows or copies it need not know it"),
    "transforms_low_pass_zero": ("transforms", [{"name": "low_pass", "cutoff_hz": 0}], ""),
    "transforms_low_pass_text": ("transforms", [{"name": "low_pass", "cutoff_hz": "x"}], ""),
    "transforms_low_pass_huge": ("transforms", [{"name": "low_pass", "cutoff_hz": 1e308}], "above every frequency"),
    "transforms_tare_short": ("transforms", [{"name": "tare", "offset": [1]}], ""),
    "transforms_gravity_missing": ("transforms", [{"name": "gravity"}], ""),
    "transforms_gravity_text": ("transforms", [{"name": "gravity", "mass_kg": "x", "centre_m": 3}], ""),
    "transforms_100000": ("transforms", [{"name": "tare"}] * 100_000, "many, but steps"),
}  # fmt: skip
for name, (attribute, value, legal) in ODD.items():
    whole = value if isinstance(value, str) else json.dumps(value)
    add("json", name, "episode", _json(attribute, whole), legal)

PLAIN = {
    "task_escapes": ("task", HIDDEN.replace("\x00", ""), SHOWN),
    "task_empty": ("task", "", "a name may be empty"),
    "task_10_mb": ("task", "t" * 10**7, "long, but text"),
    "task_path": ("task", "../../../outside/secret", "a name is no path"),
    "task_number": ("task", 7, ""),
    "task_bytes": ("task", np.bytes_(b"\xff\xfe\x80"), ""),
    "task_array": ("task", np.array(["a", "b"], dtype=object), ""),
    "task_empty_space": ("task", h5py.Empty("f8"), ""),
    "source_escapes": ("source", HIDDEN.replace("\x00", ""), SHOWN),
    "source_markup": ("source", "![x](http://example.org/x.png)<script>|", "shown as it is, escaped"),
    "source_dollar": ("source", "$\\frac{1}{", SHOWN),
    "source_number": ("source", 1.5, ""),
    "source_10_mb": ("source", "s" * 10**7, "long, but text"),
    "index_negative": ("index", -1, ""),
    "index_huge": ("index", np.uint64(2**64 - 1), ""),
    "index_other": ("index", 4, "the file's name says which one it is"),
    "index_float": ("index", 0.0, ""),
    "index_text": ("index", "0", ""),
    "index_array": ("index", np.zeros(3, int), ""),
    "index_one_element": ("index", np.zeros(1, int), "one number in a list of one"),
    "seed_negative": ("seed", -5, "a check may let it pass"),
    "seed_nan": ("seed", np.nan, ""),
    "seed_complex": ("seed", 1j, ""),
    "seed_large_array": ("seed", np.zeros(5000), ""),
    "success_number": ("success", 1, ""),
    "success_text": ("success", "yes", ""),
    "success_array": ("success", np.ones(3, bool), ""),
}  # fmt: skip


def _plain(name, value):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            del file.attrs[name]
            options = {"dtype": h5py.string_dtype()} if getattr(value, "dtype", None) == np.dtype(object) else {}
            file.attrs.create(name, value, **options)

    return make


def _absent(name):
    def make(folder):
        with reopened(folder) as file:
            del file.attrs[name]

    return make


for name, (attribute, value, legal) in PLAIN.items():
    add("attributes", name, "episode", _plain(attribute, value), legal)
for name in ("task", "index", "seed", "source", "success", *ATTRIBUTES):
    add("attributes", f"no_{name}", "episode", _absent(name))
