"""Files that hold networks or buffers, made by somebody who wants their code run, their numbers believed, memory taken.

The sound ones are copied beside the dataset as ``models/NAME`` before a kind is made; a kind writes ``NAME``.
"""

import io
import json
import os
import pickle
import zipfile
from pathlib import Path

import numpy as np

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


def pickled(name, marker):
    return pickle.dumps(PAYLOADS[name](marker), protocol=2)


def torch_saved(name, marker):
    import torch

    buffer = io.BytesIO()
    torch.save(PAYLOADS[name](marker), buffer)
    return buffer.getvalue()


def rezipped(source: Path, target: Path, change, compression=zipfile.ZIP_STORED) -> None:
    """A copy of an archive; `change` gets each member's name and content and gives its content, or None for none."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w", compression) as new:
        for info in old.infolist():
            content = change(info.filename, old.read(info))
            if content is not None:
                new.writestr(zipfile.ZipInfo(info.filename, (1980, 1, 1, 0, 0, 0)), content, compression)


def edited_json(change):
    def edit(content):
        found = json.loads(content)
        changed = change(found)
        return json.dumps(found if changed is None else changed).encode()

    return edit


def each(value, change):
    """Every leaf of nested dictionaries, changed."""
    return {key: each(item, change) if isinstance(item, dict) else change(item) for key, item in value.items()}


def register(file, name, make, legal=""):
    def spoil(folder):
        make(folder.parent / "models" / file, folder.parent / file, folder)

    add("models", f"{file.replace('.', '_')}_{name}", file, spoil, legal)


def members_with(payload_name, select, packed):
    def make(source, target, folder):
        hostile = packed(payload_name, payload(folder))
        rezipped(source, target, lambda name, content: hostile if select(name) else content)

    return make


def whole(content):
    return lambda source, target, folder: target.write_bytes(content(source.read_bytes(), folder))


WHOLE = {
    "empty": lambda sound, folder: b"",
    "zeros": lambda sound, folder: bytes(len(sound)),
    "random": lambda sound, folder: np.random.default_rng(0).bytes(10_000),
    "text": lambda sound, folder: b"hello\n",
    "truncated": lambda sound, folder: sound[: len(sound) // 2],
    "no_directory": lambda sound, folder: sound[:-200],
    "plain_pickle": lambda sound, folder: pickled("system", payload(folder)),
    "pickle_protocol_5": lambda sound, folder: pickle.dumps(PAYLOADS["system"](payload(folder)), protocol=5),
    "torch_saved_payload": lambda sound, folder: torch_saved("system", payload(folder)),
    "old_torch_format": lambda sound, folder: _old_torch(payload(folder)),
    "empty_zip": lambda sound, folder: _zip({}),
    "zip_of_pickles": lambda sound, folder: _zip(
        {f"archive/{n}": pickled("system", payload(folder)) for n in ("data.pkl", "constants.pkl", "code/x.py")}
    ),
    "episode": lambda sound, folder: (folder / "episode_000001.hdf5").read_bytes(),
    "zip_bomb": lambda sound, folder: _bomb(sound),
    "numpy_pickle": lambda sound, folder: numpy_pickle(payload(folder)),
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


def numpy_pickle(marker):
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
        register(file, name, whole(made))
    for name, make in INSTEAD.items():
        register(file, name, lambda source, target, folder, make=make: make(target, folder))
    register(file, "compressed", lambda source, target, folder: rezipped(
        source, target, lambda name, content: content, zipfile.ZIP_DEFLATED), "the same content, packed")  # fmt: skip
    for name in PAYLOADS:
        register(file, f"payload_{name}_in_pickles", members_with(
            name, lambda member: member.endswith((".pkl", ".pt", ".npy")), pickled if file != POLICY else torch_saved
        ), legal=UNREAD if file == POLICY else "")  # fmt: skip
    register(file, "payload_in_every_member", members_with("system", lambda member: True, pickled))
    register(file, "payload_in_every_member_as_torch_does", members_with("system", lambda member: True, torch_saved))
