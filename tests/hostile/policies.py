"""Exported policies (``.pt2``) one of whose members is changed."""

import numpy as np

from tests.hostile.kind import payload
from tests.hostile.models import POLICY, UNREAD, edited_json, members_with, pickled, register, rezipped, torch_saved


def _program(part, change):
    """A policy one of whose JSON members, or other members, is changed."""

    def edit(name, content):
        return change(content) if part in name else content

    return lambda source, target, folder: rezipped(source, target, edit)


def _config(**values):
    def change(found):
        for entry in found["config"].values():
            entry.update(values)

    return change


def _sizes(size):
    def change(found):
        for entry in found["config"].values():
            entry["tensor_meta"]["sizes"] = [{"as_int": size}]

    return change


FLOATS = {"nan": float("nan"), "infinite": float("inf"), "zero": 0.0, "negative": -1.0}
ADD = b"torch.ops.aten.add.Tensor"
PROGRAM = {
    "facts_nan": ("svfl_policy", edited_json(lambda found: found.update(depth_scale=float("nan")))),
    "facts_zero": ("svfl_policy", edited_json(lambda found: found.update(depth_scale=0))),
    "facts_text": ("svfl_policy", edited_json(lambda found: found.update(depth_scale="x"))),
    "facts_list": ("svfl_policy", edited_json(lambda found: [])),
    "facts_missing": ("svfl_policy", lambda content: None),
    "facts_deep": ("svfl_policy", lambda content: b"[" * 10**5 + b"]" * 10**5),
    "facts_long": ("svfl_policy", lambda content: b" " * 10**8 + content),
    "facts_not_utf8": ("svfl_policy", lambda content: b"\xff\xfe"),
    "provenance_list": ("svfl_provenance", lambda content: b"[]"),
    "provenance_deep": ("svfl_provenance", lambda content: b"[" * 10**5 + b"]" * 10**5),
    "provenance_not_utf8": ("svfl_provenance", lambda content: b"\xff\xfe"),
    "provenance_long": ("svfl_provenance", lambda content: b" " * 10**8 + content),
    "provenance_escapes": ("svfl_provenance", lambda content: content.replace(b'"svfl-train', b'"\\u001b[31m\\n')),
    "graph_deep": ("model.json", lambda content: b'{"a":' * 10**5 + b"1" + b"}" * 10**5),
    "graph_list": ("model.json", lambda content: b"[]"),
    "graph_cut": ("model.json", lambda content: content[:1000]),
    "graph_calls_system": ("model.json", lambda content: content.replace(ADD, b"os.system")),
    "graph_calls_eval": ("model.json", lambda content: content.replace(ADD, b"builtins.eval")),
    "graph_opens_a_file": ("model.json", lambda content: content.replace(ADD, b"torch.ops.aten.from_file.default")),
    "graph_calls_unknown": ("model.json", lambda content: content.replace(b"ops.aten.add", b"ops.evil.add")),
    "graph_calls_escapes": ("model.json", lambda content: content.replace(ADD, b"\\u001b[31m\\n")),
    "weights_pickled": ("weights_config", edited_json(_config(use_pickle=True))),
    "weights_path": ("weights_config", edited_json(_config(path_name="../../../outside/secret"))),
    "weights_absolute": ("weights_config", edited_json(_config(path_name="/etc/passwd"))),
    "weights_huge": ("weights_config", edited_json(_sizes(10**11))),
    "weights_negative": ("weights_config", edited_json(_sizes(-1))),
    "weights_dtype": ("weights_config", lambda content: content.replace(b'"dtype": 7', b'"dtype": 999')),
    "weights_device": ("weights_config", lambda content: content.replace(b'"cpu"', b'"meta"')),
    "weights_short": ("data/weights/weight_", lambda content: content[:1]),
    "weights_nan": ("data/weights/weight_", lambda content: np.full(len(content) // 4, np.nan, "<f4").tobytes()),
    "weights_gone": ("data/weights/weight_1", lambda content: None),
    "constants_pickled": ("constants_config", edited_json(_config(use_pickle=True))),
    "constants_objects": ("constants_config", lambda content: content.replace(b"tensor_", b"custom_obj_")),
    "format_escapes": ("archive_format", lambda content: b"\x1b[31m"),
}  # fmt: skip
ELSEWHERE = "only svfl-train info reads it"
LAWFUL = {
    **{name: ELSEWHERE for name in PROGRAM if name.startswith("provenance")},
    "weights_device": "whoever loads a program chooses the device", "format_escapes": "this text is never read",
    "sample_inputs": UNREAD, "archive_format": "this text is never read",
    "weight_0": "its bytes are taken for numbers, whatever they are",
}  # fmt: skip
for name, (part, change) in PROGRAM.items():
    register(POLICY, name, _program(part, change), LAWFUL.get(name, ""))


def _with_pickled_weights(source, target, folder):
    """Says of every weight that it is a pickle, and each is one with a payload."""
    hostile = torch_saved("system", payload(folder))

    def edit(name, content):
        if "_config.json" in name:
            return edited_json(_config(use_pickle=True))(content)
        return hostile if "/data/weights/" in name or "/data/constants/" in name else content

    rezipped(source, target, edit)


register(POLICY, "weights_pickled_with_payload", _with_pickled_weights)
PARTS = (
    "model.json",
    "weights_config",
    "constants_config",
    "sample_inputs",
    "svfl_policy",
    "archive_format",
    "weight_0",
)
for part in PARTS:
    for form, packed in (("pickle", pickled), ("torch", torch_saved)):
        there = members_with("system", lambda member, part=part: part in member, packed)
        register(POLICY, f"payload_{form}_in_{part}".replace(".", "_"), there, LAWFUL.get(part, ""))
