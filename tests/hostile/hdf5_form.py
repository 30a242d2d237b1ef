"""Episodes of another form: other types, filters, names, headers, bytes."""

import io

import h5py
import numpy as np

from svfl_data.storage.seal import seal
from tests.hostile.kind import add, content_of, episode_file, hostile, write_resealed
from tests.hostile.making_episodes import reopened, replace

COLOR = "cameras/front/color"
TRICKS = {
    "escape": b"\x1b]0;owned\x07\x1b[31mred",
    "newline": b"a\nsvfl-data: everything is fine",
    "carriage": b"a\rsvfl-data: fine",
    "bidi": "a\u202eb\u2066c".encode(),
    "dots": b"..",
    "backslash": b"..\\..\\x",
    "not_utf8": b"\xff\xfe\x80",
    "long": b"n" * 60_000,
    "private": "\ue000\U000e0001".encode(),
    "markup": b"<img src=x onerror=alert(1)>|![](http:x)",
    "dollar": b"$\\frac{1}{0}$",
    "brace": b"{camera}",
    "empty_like": "\u200b".encode(),
}


def _named(name, parent):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            group = file.require_group(parent)
            space = h5py.h5s.create_simple((3,))
            plan = h5py.h5p.create(h5py.h5p.LINK_CREATE)
            made = h5py.h5d.create(group.id, None, h5py.h5t.STD_U8LE, space)
            h5py.h5o.link(made, group.id, TRICKS[name], lcpl=plan)

    return make


def _camera(name):
    def make(folder):
        with reopened(folder, libver="latest") as file:
            cameras = file["cameras"]
            cameras.id.links.move(b"front", cameras.id, TRICKS[name])

    return make


for trick in TRICKS:
    add("names", f"extra_{trick}", "episode", _named(trick, "extra"), legal="names below extra/ are the user's own")
    add("names", f"camera_{trick}", "episode", _camera(trick), legal="a camera may be called nearly anything")
    add("names", f"unknown_{trick}", "episode", _named(trick, "streams"), legal="a later minor version may add streams")


FIELDS = {"proprio": "observations/proprio", "color": COLOR, "wrench": "streams/wrench/wrench",
          "t_ns": "observations/t_ns",
          "tare": "streams/wrench/tare", "workspace": "workspace"}  # fmt: skip
TYPES = {
    "object": lambda old: np.array(["x"] * max(1, old.size), dtype=object).reshape(old.shape),
    "complex": lambda old: old.astype("c8"),
    "big_endian": lambda old: old.astype(old.dtype.newbyteorder(">")),
    "float16": lambda old: old.astype("f2"),
    "bool": lambda old: old.astype(bool),
    "text": lambda old: old.astype("S8"),
    "compound": lambda old: np.zeros(old.shape, [("a", "f4"), ("b", "i4")]),
    "int8": lambda old: old.astype("i1"),
    "scalar": lambda old: old.reshape(-1)[0],
    "flat": lambda old: old.reshape(-1),
    "deeper": lambda old: old[..., None],
    "no_rows": lambda old: old[:0],
    "one_row_less": lambda old: old[:-1],
    "one_column_less": lambda old: old[..., :-1],
    "transposed": lambda old: np.ascontiguousarray(old.T),
}


def _retyped(path, change):
    def make(folder):
        with reopened(folder) as file:
            value = change(file[path][()])
            options = {"dtype": h5py.string_dtype()} if value.dtype == object else {}
            replace(file, path, data=value, **options)

    return make


def _same(field, name):
    """What would change nothing: the transpose of a vector, the byte order of single bytes."""
    return (field in ("t_ns", "tare") and name in ("flat", "transposed")) or (field, name) == ("color", "big_endian")


for field, path in FIELDS.items():
    for name, change in TYPES.items():
        if not _same(field, name):
            add("types", f"{field}_{name}", "episode", _retyped(path, change))


def _missing(path):
    def make(folder):
        with reopened(folder) as file:
            del file[path]

    return make


for path in ("observations", "observations/t_ns", "actions", "streams/object/t_ns", "streams/joints/t_ns"):
    add("missing", path.replace("/", "_"), "episode", _missing(path))
for path in ("streams", "streams/wrench/tare", "cameras/front/color", "cameras/front/intrinsics",
             "cameras/front/T_base_camera", "cameras/front/image_axes", "workspace"):  # fmt: skip
    add("missing", path.replace("/", "_"), "episode", _missing(path), "an episode may be recorded without it")


@hostile("episode")
def empty_camera(folder):
    with reopened(folder) as file:
        del file["cameras"]
        file.create_group("cameras/front")


EXOTIC = {
    "vlen_text": lambda file: file.create_dataset("extra/x", data=["a", "b"], dtype=h5py.string_dtype()),
    "vlen_array": lambda file: file.create_dataset("extra/x", shape=(3,), dtype=h5py.vlen_dtype("f8")),
    "compound_of_texts": lambda file: file.create_dataset(
        "extra/x", shape=(3,), dtype=np.dtype([("a", h5py.string_dtype()), ("b", "f8")])
    ),
    "enum": lambda file: file.create_dataset("extra/x", shape=(3,), dtype=h5py.enum_dtype({"A": 1, "B": 2})),
    "opaque": lambda file: file.create_dataset("extra/x", data=np.zeros(3, "V7")),
    "opaque_time": lambda file: file.create_dataset(
        "extra/x", data=np.zeros(3, "M8[ns]").astype(h5py.opaque_dtype("M8[ns]"))
    ),
    "empty": lambda file: file.create_dataset("extra/x", data=h5py.Empty("f8")),
    "array_type": lambda file: file.create_dataset("extra/x", shape=(3,), dtype=np.dtype(("f8", (2, 2)))),
    "long_double": lambda file: file.create_dataset("extra/x", shape=(3,), dtype=np.longdouble),
    "bits": lambda file: file.create_dataset("extra/x", shape=(3,), dtype=bool),
}


def _exotic(make_dataset):
    def make(folder):
        with reopened(folder) as file:
            make_dataset(file)

    return make


for name, make_dataset in EXOTIC.items():
    add(
        "exotic",
        name,
        "episode",
        _exotic(make_dataset),
        legal="what stands below extra/ may be of any type, or refused",
    )


def _filtered(**options):
    def make(folder):
        with reopened(folder) as file:
            replace(file, "streams/wrench/t_ns", chunks=True, **options)

    return make


add("filters", "lzf", "episode", _filtered(compression="lzf"))
add("filters", "scale_offset", "episode", _filtered(scaleoffset=0))


def _foreign(code, applied):
    def make(folder):
        with reopened(folder) as file:
            old = file["streams/wrench/t_ns"]
            attributes, values = dict(old.attrs), old[()]
            del file["streams/wrench/t_ns"]
            plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
            plan.set_chunk((len(values),))
            plan.set_filter(code, h5py.h5z.FLAG_OPTIONAL, (1, 2, 3))
            space = h5py.h5s.create_simple(values.shape)
            made = h5py.h5d.create(file.id, b"streams/wrench/t_ns", h5py.h5t.STD_I64LE, space, plan)
            made.write_direct_chunk((0,), values.tobytes(), 0 if applied else 1)
            file["streams/wrench/t_ns"].attrs.update(attributes)

    return make


add("filters", "zstandard", "episode", _foreign(32015, True))
add("filters", "blosc", "episode", _foreign(32001, True))
add("filters", "unknown", "episode", _foreign(65000, True))
add("filters", "unknown_but_skipped", "episode", _foreign(65000, False))
add("filters", "nbit", "episode", _foreign(h5py.h5z.FILTER_NBIT, False))
add("filters", "szip", "episode", _foreign(h5py.h5z.FILTER_SZIP, False))


@hostile("episode")
def filter_twice(folder):
    with reopened(folder) as file:
        old = file["streams/wrench/t_ns"]
        attributes, values = dict(old.attrs), old[()]
        del file["streams/wrench/t_ns"]
        plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        plan.set_chunk((len(values),))
        for _ in range(20):
            plan.set_deflate(9)
        space = h5py.h5s.create_simple(values.shape)
        made = h5py.h5d.create(file.id, b"streams/wrench/t_ns", h5py.h5t.STD_I64LE, space, plan)
        h5py.Dataset(made)[:] = values
        file["streams/wrench/t_ns"].attrs.update(attributes)


def _bytes(change, legal=""):
    def make(folder):
        path = episode_file(folder)
        path.write_bytes(change(path.read_bytes()))

    return make


RAW = {
    "empty": lambda sealed: b"",
    "one_byte": lambda sealed: b"\x89",
    "truncated": lambda sealed: sealed[: len(sealed) // 2],
    "no_seal": lambda sealed: sealed[:-78],
    "half_a_seal": lambda sealed: sealed[:-30],
    "only_a_seal": lambda sealed: seal(b""),
    "zeros": lambda sealed: bytes(len(sealed)),
    "random": lambda sealed: np.random.default_rng(0).bytes(len(sealed)),
    "seal_of_another": lambda sealed: sealed[:-78] + seal(b"something else"),
    "seal_twice": lambda sealed: sealed + seal(sealed)[:10],
    "upper_case_seal": lambda sealed: sealed[:-65] + sealed[-65:].upper(),
    "a_zip": lambda sealed: b"PK\x03\x04" + sealed,
    "text": lambda sealed: b"hello\n" * 100,
}  # fmt: skip
RESEALED = {
    "nothing": lambda content: b"",
    "zeros": lambda content: bytes(len(content)),
    "random": lambda content: np.random.default_rng(1).bytes(len(content)),
    "only_the_magic": lambda content: content[:8],
    "truncated": lambda content: content[: len(content) * 2 // 3],
    "truncated_head": lambda content: content[:600],
    "other_magic": lambda content: b"\x89XDF\r\n\x1a\n" + content[8:],
    "old_superblock": lambda content: content[:8] + b"\x09" + content[9:],
    "end_beyond_the_file": lambda content: content[:40] + b"\xff" * 7 + b"\x00" + content[48:],
    "root_elsewhere": lambda content: content[:64] + (2**62).to_bytes(8, "little") + content[72:],
    "zeroed_heap": lambda content: content.replace(b"HEAP", b"PEAH"),
    "zeroed_trees": lambda content: content.replace(b"TREE", b"EERT"),
    "appended": lambda content: content + b"svfl" * 1000,
}


def _resealed(change):
    def make(folder):
        path = episode_file(folder)
        write_resealed(path, change(content_of(path)))

    return make


for name, change in RAW.items():
    add("raw", name, "damage", _bytes(change))
for name, change in RESEALED.items():
    legal = "HDF5 allows content behind its end" if name == "appended" else ""
    add("resealed", name, "episode", _resealed(change), legal)


def _mutated(number):
    def change(content):
        rng = np.random.default_rng([13, number])
        spoilt = bytearray(content)
        heads = [at for mark in (b"HEAP", b"TREE", b"SNOD", b"\x89HDF") for at in _all(content, mark)]
        for _ in range(1 + number % 4):
            at = int(rng.integers(0, 96)) + int(heads[rng.integers(len(heads))])
            spoilt[min(at, len(spoilt) - 1)] = int(rng.integers(256)) if number % 3 else 0xFF
        return bytes(spoilt)

    return change


def _all(content, mark):
    at = content.find(mark)
    while at >= 0:
        yield at
        at = content.find(mark, at + 1)


for number in range(48):
    add("mutated", f"{number:02d}", "episode", _resealed(_mutated(number)), legal="a changed byte may mean nothing")


def _reheaded(change):
    def make(folder):
        with reopened(folder) as file:
            change(file.attrs)

    return make


def _attribute(name, value):
    def change(attributes):
        del attributes[name]
        if value is not None:
            attributes[name] = value

    return _reheaded(change)


VERSIONS = {"next": "3.0", "none": None, "number": 1.0, "array": np.zeros((3, 3)), "empty": "", "text": "one",
            "escape": "2\x1b[31m", "bytes": np.bytes_(b"2.0"), "long": "9" * 10**6, "nothing": h5py.Empty("S1"),
            "newline": "2.0\nsvfl-data: fine"}  # fmt: skip
for name, value in VERSIONS.items():
    legal = "bytes that say 2.0 say so" if name == "bytes" else ""
    add("version", name, "episode", _attribute("format_version", value), legal)
for name, value in {"other": "mcap", "none": None, "number": 7, "array": np.arange(4), "escape": "\x1b[31m",
                    "long": "f" * 10**6}.items():  # fmt: skip
    add("format", name, "episode", _attribute("format", value))


@hostile("episode")
def user_block(folder):
    path = episode_file(folder)
    content = content_of(path)
    buffer = io.BytesIO()
    with h5py.File(io.BytesIO(content), "r") as old, h5py.File(buffer, "w", userblock_size=1024) as new:
        for name in old:
            old.copy(name, new)
        for name, value in old.attrs.items():
            new.attrs[name] = value
    write_resealed(path, b"#!/bin/sh\n" + buffer.getvalue()[10:])


def _units(name, value):
    def make(folder):
        with reopened(folder) as file:
            file["streams/wrench/wrench"].attrs[name] = value

    return make


for name, value in {"other": "lb", "array": np.arange(3), "escape": "\x1b[31m", "long": "u" * 10**6}.items():
    add("unit", name, "episode", _units("unit", value))
