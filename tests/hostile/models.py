"""Files that hold networks or buffers, made by somebody who wants their code run, their numbers believed, memory taken.

The sound ones are copied beside the dataset as ``models/NAME`` before a kind is made; a kind writes ``NAME``.
"""

import io
import json
import os
import pickle
import shutil
import zipfile
from pathlib import Path

import numpy as np

from tests.hostile.json_attributes import HIDDEN
from tests.hostile.kind import add, outside, payload
from tests.hostile.making_episodes import zeros_deflated

CHECKPOINTS = ("centering.ckpt", "bc.ckpt", "latent.ckpt")
POLICY, BUFFER = "policy.pt2", "buffer.replay"
UNREAD = "the inputs that a program was exported with are never read"
FILES = (*CHECKPOINTS, POLICY, BUFFER)


class Calls:
    """Pickled, it calls a function when it is read."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


def _nested(marker):
    """A pickle inside a pickle, opened by a function that a list of allowed ones may have forgotten."""
    import torch

    buffer = io.BytesIO()
    torch.save(Calls(os.system, f"touch {marker}"), buffer)
    return Calls(torch.storage._load_from_bytes, buffer.getvalue())


PAYLOADS = {
    "system": lambda marker: Calls(os.system, f"touch {marker}"),
    "exec": lambda marker: Calls(exec, f"open({str(marker)!r}, 'w')"),
    "eval": lambda marker: Calls(eval, f"open({str(marker)!r}, 'w')"),
    "open": lambda marker: Calls(open, str(marker), "w"),
    "path": lambda marker: Calls(Path.touch, marker),
    "loads": lambda marker: Calls(pickle.loads, pickle.dumps(Calls(os.system, f"touch {marker}"))),
    "nested": _nested,
}


def _pickled(name, marker):
    return pickle.dumps(PAYLOADS[name](marker), protocol=2)


def _torch_saved(name, marker):
    import torch

    buffer = io.BytesIO()
    torch.save(PAYLOADS[name](marker), buffer)
    return buffer.getvalue()


def _rezipped(source: Path, target: Path, change, compression=zipfile.ZIP_STORED) -> None:
    """A copy of an archive; `change` gets each member's name and content and gives its content, or None for none."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w", compression) as new:
        for info in old.infolist():
            content = change(info.filename, old.read(info))
            if content is not None:
                new.writestr(zipfile.ZipInfo(info.filename, (1980, 1, 1, 0, 0, 0)), content, compression)


def _kind(file, name, make, legal=""):
    def spoil(folder):
        make(folder.parent / "models" / file, folder.parent / file, folder)

    add("models", f"{file.replace('.', '_')}_{name}", file, spoil, legal)


def _members(payload_name, select, pickled):
    def make(source, target, folder):
        hostile = pickled(payload_name, payload(folder))
        _rezipped(source, target, lambda name, content: hostile if select(name) else content)

    return make


def _whole(content):
    return lambda source, target, folder: target.write_bytes(content(source.read_bytes(), folder))


WHOLE = {
    "empty": lambda sound, folder: b"",
    "zeros": lambda sound, folder: bytes(len(sound)),
    "random": lambda sound, folder: np.random.default_rng(0).bytes(10_000),
    "text": lambda sound, folder: b"hello\n",
    "truncated": lambda sound, folder: sound[: len(sound) // 2],
    "no_directory": lambda sound, folder: sound[:-200],
    "plain_pickle": lambda sound, folder: _pickled("system", payload(folder)),
    "pickle_protocol_5": lambda sound, folder: pickle.dumps(PAYLOADS["system"](payload(folder)), protocol=5),
    "torch_saved_payload": lambda sound, folder: _torch_saved("system", payload(folder)),
    "old_torch_format": lambda sound, folder: _old_torch(payload(folder)),
    "empty_zip": lambda sound, folder: _zip({}),
    "zip_of_pickles": lambda sound, folder: _zip(
        {f"archive/{n}": _pickled("system", payload(folder)) for n in ("data.pkl", "constants.pkl", "code/x.py")}
    ),
    "episode": lambda sound, folder: (folder / "episode_000001.hdf5").read_bytes(),
    "zip_bomb": lambda sound, folder: _bomb(sound),
    "numpy_pickle": lambda sound, folder: _numpy(payload(folder)),
    "joblib": lambda sound, folder: _joblib(payload(folder)),
}  # fmt: skip


def _old_torch(marker):
    import torch

    buffer = io.BytesIO()
    torch.save(Calls(os.system, f"touch {marker}"), buffer, _use_new_zipfile_serialization=False)
    return buffer.getvalue()


def _zip(members):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def _numpy(marker):
    buffer = io.BytesIO()
    np.save(buffer, np.array([Calls(os.system, f"touch {marker}")], dtype=object), allow_pickle=True)
    return buffer.getvalue()


def _joblib(marker):
    import joblib

    buffer = io.BytesIO()
    joblib.dump(Calls(os.system, f"touch {marker}"), buffer)
    return buffer.getvalue()


def _bomb(sound):
    """Every member three gigabytes of zeros, packed."""
    packed = zeros_deflated(3 * 2**30)[2:-4]
    with zipfile.ZipFile(io.BytesIO(sound)) as archive:
        names = archive.namelist()[:3]
    local, central = b"", b""
    import struct

    for name in names:
        encoded = name.encode()
        sizes = len(packed), 3 * 2**30, len(encoded)
        central += struct.pack("<4s6H3I5H2I", b"PK\1\2", 20, 20, 0, 8, 0, 33, 0, *sizes, 0, 0, 0, 0, 0, len(local))
        central += encoded
        local += struct.pack("<4s5H3I2H", b"PK\3\4", 20, 0, 8, 0, 33, 0, len(packed), 3 * 2**30, len(encoded), 0)
        local += encoded + packed
    return local + central + struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, 3, 3, len(central), len(local), 0)


INSTEAD = {
    "missing": lambda target, folder: None,
    "folder": lambda target, folder: target.mkdir(),
    "pipe": lambda target, folder: os.mkfifo(target),
    "link_to_a_secret": lambda target, folder: target.symlink_to(outside(folder)),
    "link_to_zeros": lambda target, folder: target.symlink_to("/dev/zero"),
    "link_to_a_pipe": lambda target, folder: target.symlink_to(outside(folder, "pipe")),
}
for file in FILES:
    for name, made in WHOLE.items():
        _kind(file, name, _whole(made))
    for name, make in INSTEAD.items():
        _kind(file, name, lambda source, target, folder, make=make: make(target, folder))
    _kind(file, "compressed", lambda source, target, folder: _rezipped(
        source, target, lambda name, content: content, zipfile.ZIP_DEFLATED), "the same content, packed")  # fmt: skip
    for name in PAYLOADS:
        _kind(file, f"payload_{name}_in_pickles", _members(
            name, lambda member: member.endswith((".pkl", ".pt", ".npy")), _pickled if file != POLICY else _torch_saved
        ), legal=UNREAD if file == POLICY else "")  # fmt: skip
    _kind(file, "payload_in_every_member", _members("system", lambda member: True, _pickled))
    _kind(file, "payload_in_every_member_as_torch_does", _members("system", lambda member: True, _torch_saved))
for part in (
    "model.json",
    "weights_config",
    "constants_config",
    "sample_inputs",
    "svfl_policy",
    "archive_format",
    "weight_0",
):
    for form, pickled in (("pickle", _pickled), ("torch", _torch_saved)):
        there = _members("system", lambda member, part=part: part in member, pickled)
        legal = UNREAD if part == "sample_inputs" else ""
        _kind(POLICY, f"payload_{form}_in_{part}".replace(".", "_"), there, legal)


def _checkpoint(change):
    """A checkpoint as a program of ours could have written it, but for one change."""

    def make(source, target, folder):
        import torch

        found = torch.load(source, weights_only=True)
        changed = change(found)
        torch.save(found if changed is None else changed, target)

    return make


def _weights(change):
    def changed(found):
        for name, weight in found["state_dict"].items():
            if weight.is_floating_point() and weight.numel():
                found["state_dict"][name] = change(weight)

    return _checkpoint(changed)


def _one_weight(change):
    def changed(found):
        name = next(
            name for name, weight in found["state_dict"].items() if weight.is_floating_point() and weight.ndim > 1
        )
        found["state_dict"][name] = change(found["state_dict"][name])

    return _checkpoint(changed)


def _endless(weight):
    import torch

    return torch.zeros(1).expand(10**11)


def _sparse(weight):
    import torch

    return torch.sparse_coo_tensor(torch.zeros((1, 1), dtype=torch.int64), torch.ones(1), (10**11,))


CHANGES = {
    "weights_nan": _weights(lambda weight: weight * float("nan")),
    "weights_one_nan": _one_weight(lambda weight: weight * float("nan")),
    "weights_infinite": _weights(lambda weight: weight + float("inf")),
    "weights_complex": _one_weight(lambda weight: weight.to(dtype=__import__("torch").complex64)),
    "weights_flat": _one_weight(lambda weight: weight.reshape(-1)),
    "weights_empty": _one_weight(lambda weight: weight[:0]),
    "weights_endless": _one_weight(_endless),
    "weights_sparse": _one_weight(_sparse),
    "weights_text": _checkpoint(lambda found: found["state_dict"].update({next(iter(found["state_dict"])): "x"})),
    "weights_missing": _checkpoint(lambda found: found.pop("state_dict") and None),
    "weights_list": _checkpoint(lambda found: found.update(state_dict=[1, 2])),
    "weights_more": _checkpoint(lambda found: found["state_dict"].update({HIDDEN: found["state_dict"].popitem()[1]})),
    "a_list": _checkpoint(lambda found: [found]),
    "a_tensor": _checkpoint(lambda found: found["state_dict"].popitem()[1]),
    "mark_missing": _checkpoint(lambda found: found.pop("svfl") and None),
    "mark_list": _checkpoint(lambda found: found.update(svfl=[1])),
    "mark_escapes": _checkpoint(lambda found: found["svfl"].update(format=HIDDEN)),
    "mark_number": _checkpoint(lambda found: found["svfl"].update(format=7)),
    "version_escapes": _checkpoint(lambda found: found["svfl"].update(format_version="9\x1b[31m")),
    "version_list": _checkpoint(lambda found: found["svfl"].update(format_version=[])),
    "parameters_missing": _checkpoint(lambda found: found.pop("hyper_parameters") and None),
    "parameters_list": _checkpoint(lambda found: found.update(hyper_parameters=[1])),
    "parameters_empty": _checkpoint(lambda found: found.update(hyper_parameters={})),
    "parameters_text": _checkpoint(lambda found: found.update(hyper_parameters={1: HIDDEN})),
}


def _each(value, change):
    """Every leaf of nested dictionaries, changed."""
    return {key: _each(item, change) if isinstance(item, dict) else change(item) for key, item in value.items()}


def _leaves(change):
    return _checkpoint(lambda found: found.update(hyper_parameters=_each(found["hyper_parameters"], change)))


CHANGES |= {
    "parameters_all_huge": _leaves(lambda old: 10**9 if type(old) is int else old),
    "parameters_all_negative": _leaves(lambda old: -1 if type(old) is int else old),
    "parameters_all_texts": _leaves(lambda old: "x"),
    "parameters_all_null": _leaves(lambda old: None),
    "parameters_all_lists": _leaves(lambda old: [old] * 3),
    "parameters_all_nan": _leaves(lambda old: float("nan") if isinstance(old, float) else old),
    "parameters_escapes": _leaves(lambda old: HIDDEN if isinstance(old, str) else old),
}
LAWFUL = {"parameters_all_nan": "where nothing is a float nothing changes"}
for file in CHECKPOINTS:
    for name, make in CHANGES.items():
        _kind(file, name, make, LAWFUL.get(name, ""))


def _program(part, change):
    """A policy one of whose JSON members, or other members, is changed."""

    def edit(name, content):
        return change(content) if part in name else content

    return lambda source, target, folder: _rezipped(source, target, edit)


def _json(change):
    def edit(content):
        found = json.loads(content)
        changed = change(found)
        return json.dumps(found if changed is None else changed).encode()

    return edit


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
    "facts_nan": ("svfl_policy", _json(lambda found: found.update(depth_scale=float("nan")))),
    "facts_zero": ("svfl_policy", _json(lambda found: found.update(depth_scale=0))),
    "facts_text": ("svfl_policy", _json(lambda found: found.update(depth_scale="x"))),
    "facts_list": ("svfl_policy", _json(lambda found: [])),
    "facts_missing": ("svfl_policy", lambda content: None),
    "facts_deep": ("svfl_policy", lambda content: b"[" * 10**5 + b"]" * 10**5),
    "facts_long": ("svfl_policy", lambda content: b" " * 10**8 + content),
    "facts_not_utf8": ("svfl_policy", lambda content: b"\xff\xfe"),
    "graph_deep": ("model.json", lambda content: b'{"a":' * 10**5 + b"1" + b"}" * 10**5),
    "graph_list": ("model.json", lambda content: b"[]"),
    "graph_cut": ("model.json", lambda content: content[:1000]),
    "graph_calls_system": ("model.json", lambda content: content.replace(ADD, b"os.system")),
    "graph_calls_eval": ("model.json", lambda content: content.replace(ADD, b"builtins.eval")),
    "graph_calls_unknown": ("model.json", lambda content: content.replace(b"ops.aten.add", b"ops.evil.add")),
    "graph_calls_escapes": ("model.json", lambda content: content.replace(ADD, b"\\u001b[31m\\n")),
    "weights_pickled": ("weights_config", _json(_config(use_pickle=True))),
    "weights_path": ("weights_config", _json(_config(path_name="../../../outside/secret"))),
    "weights_absolute": ("weights_config", _json(_config(path_name="/etc/passwd"))),
    "weights_huge": ("weights_config", _json(_sizes(10**11))),
    "weights_negative": ("weights_config", _json(_sizes(-1))),
    "weights_dtype": ("weights_config", lambda content: content.replace(b'"dtype": 7', b'"dtype": 999')),
    "weights_device": ("weights_config", lambda content: content.replace(b'"cpu"', b'"meta"')),
    "weights_short": ("data/weights/weight_", lambda content: content[:1]),
    "weights_nan": ("data/weights/weight_", lambda content: np.full(len(content) // 4, np.nan, "<f4").tobytes()),
    "weights_gone": ("data/weights/weight_1", lambda content: None),
    "constants_pickled": ("constants_config", _json(_config(use_pickle=True))),
    "constants_objects": ("constants_config", lambda content: content.replace(b"tensor_", b"custom_obj_")),
    "format_escapes": ("archive_format", lambda content: b"\x1b[31m"),
}  # fmt: skip
for name, (part, change) in PROGRAM.items():
    _kind(POLICY, name, _program(part, change))


def _with_pickled_weights(source, target, folder):
    """Says of every weight that it is a pickle, and each is one with a payload."""
    hostile = _torch_saved("system", payload(folder))

    def edit(name, content):
        if "_config.json" in name:
            return _json(_config(use_pickle=True))(content)
        return hostile if "/data/weights/" in name or "/data/constants/" in name else content

    _rezipped(source, target, edit)


def _reads_a_file(source, target, folder):
    """A whole program of the right form whose graph opens a file of the user's, which it may also create and extend."""
    import torch

    from svfl_models import exported_policy

    class Reader(torch.nn.Module):
        def forward(self, image, wrench, proprio):
            found = torch.from_file(str(outside(folder)), shared=False, size=5, dtype=torch.float32)
            return proprio + 0 * found + 0 * image.mean() + 0 * wrench.mean()

    exported_policy.save(Reader(), target, (76, 76))


_kind(POLICY, "weights_pickled_with_payload", _with_pickled_weights)
_kind(POLICY, "program_opens_a_file", _reads_a_file)


def _replay(part, change):
    return lambda source, target, folder: _rezipped(
        source, target, lambda name, content: change(content) if part in name else content
    )


def _header(change):
    return _replay("replay.json", _json(change))


def _array(array):
    def change(content):
        buffer = io.BytesIO()
        old = np.load(io.BytesIO(content))
        np.save(buffer, array(old))
        return buffer.getvalue()

    return _replay(".npy", change)


def _declares(shape):
    """An array's header that promises more than follows."""

    def change(content):
        buffer = io.BytesIO()
        np.lib.format.write_array_header_1_0(buffer, {"descr": "|u1", "fortran_order": False, "shape": shape})
        return buffer.getvalue() + b"x"

    return _replay(".npy", change)


def _numbers(value):
    return _header(lambda found: _each(found, lambda old: value if type(old) is int else old))


BUFFERS = {
    "header_list": _header(lambda found: []),
    "header_empty": _header(lambda found: {}),
    "header_deep": _replay("replay.json", lambda content: b"[" * 10**5 + b"]" * 10**5),
    "header_huge": _numbers(10**15),
    "header_huge_integers": _numbers(10**400),
    "header_negative": _numbers(-1),
    "header_texts": _header(lambda found: _each(found, lambda old: HIDDEN)),
    "header_null": _header(lambda found: _each(found, lambda old: None)),
    "header_version": _header(lambda found: found.update(format_version=[1])),
    "header_format_escapes": _header(lambda found: found.update(format=HIDDEN)),
    "arrays_objects": _replay(".npy", lambda content: _numpy("/nowhere")),
    "arrays_nan": _array(lambda old: old * np.nan if old.dtype.kind == "f" else old),
    "arrays_short": _array(lambda old: old[:1] if old.ndim else old),
    "arrays_complex": _array(lambda old: old.astype("c8")),
    "arrays_huge": _declares((10**13,)),
    "arrays_many_dimensions": _declares((1,) * 40),
    "arrays_empty": _declares((0,)),
    "arrays_overflow": _declares((2**62, 2**62)),
    "arrays_gone": _replay(".npy", lambda content: None),
}
for name, make in BUFFERS.items():
    _kind(BUFFER, name, make)


def _resumed(file, name, make):
    """A training's folder, as an interrupted one leaves it, but for its checkpoint."""

    def spoil(folder):
        made = folder.parent / "out" / "made"
        shutil.copytree(folder.parent / "models" / file.replace(".ckpt", "_run"), made)
        make(folder.parent / "models" / file, made / "checkpoint.ckpt", folder)

    add("resumed", f"{file.partition('.')[0]}_{name}", f"{file}_run", spoil)


for file in ("bc.ckpt", "latent.ckpt"):
    for name in ("empty", "text", "truncated", "plain_pickle", "torch_saved_payload", "zip_of_pickles"):
        _resumed(file, name, _whole(WHOLE[name]))
    for name in ("weights_nan", "weights_missing", "parameters_missing", "a_list", "weights_flat", "mark_missing"):
        _resumed(file, name, CHANGES[name])


def _run_file(file, name, member, content):
    def spoil(folder):
        made = folder.parent / "out" / "made"
        shutil.copytree(folder.parent / "models" / file.replace(".ckpt", "_run"), made)
        (made / member).write_bytes(content)

    add("resumed", f"{file.partition('.')[0]}_{member.partition('.')[0]}_{name}", f"{file}_run", spoil,
        legal="only what is read again must be right")  # fmt: skip


CONTENTS = {
    "empty": b"", "deep": b"[" * 10**5 + b"]" * 10**5, "binary": b"\xff" * 99, "list": b"[]", "null": b"null",
    "escapes": json.dumps({HIDDEN: HIDDEN}).encode(),
}  # fmt: skip
for file in ("bc.ckpt", "latent.ckpt"):
    for member in ("config.json", "metrics.csv", "result.json"):
        for name, content in CONTENTS.items():
            _run_file(file, name, member, content)
