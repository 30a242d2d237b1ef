"""Saved replay buffers whose header or arrays are others."""

import io

import numpy as np

from tests.hostile.json_attributes import HIDDEN
from tests.hostile.models import BUFFER, each, edited_json, numpy_pickle, register, rezipped


def _replay(part, change):
    return lambda source, target, folder: rezipped(
        source, target, lambda name, content: change(content) if part in name else content
    )


def _header(change):
    return _replay("replay.json", edited_json(change))


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
    return _header(lambda found: each(found, lambda old: value if type(old) is int else old))


BUFFERS = {
    "header_list": _header(lambda found: []),
    "header_empty": _header(lambda found: {}),
    "header_deep": _replay("replay.json", lambda content: b"[" * 10**5 + b"]" * 10**5),
    "header_huge": _numbers(10**15),
    "header_huge_integers": _numbers(10**400),
    "header_negative": _numbers(-1),
    "header_texts": _header(lambda found: each(found, lambda old: HIDDEN)),
    "header_null": _header(lambda found: each(found, lambda old: None)),
    "header_version": _header(lambda found: found.update(format_version=[1])),
    "header_format_escapes": _header(lambda found: found.update(format=HIDDEN)),
    "arrays_objects": _replay(".npy", lambda content: numpy_pickle("/nowhere")),
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
    register(BUFFER, name, make)
