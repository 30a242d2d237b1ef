"""Small episodes that are large: declared sizes, bombs, endless groups, names and attributes."""

import zlib

import h5py
import numpy as np

from tests.hostile.kind import add, hostile
from tests.hostile.making_episodes import bomb, reopened, replace, zeros_deflated

GIB = 2**30
UNASKED = "an attribute that nobody asks for is not read"


@hostile("episode")
def empty_chunks_in_extra(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(2 * 10**8,), chunks=(1,), dtype="u1", compression="gzip")


@hostile("episode")
def empty_chunks_in_fields(folder):
    with reopened(folder) as file:
        for path, row in (("streams/wrench/t_ns", ()), ("streams/wrench/wrench", (6,))):
            replace(file, path, shape=(2 * 10**8, *row), chunks=(1, *row), dtype=file[path].dtype, compression="gzip")


@hostile("episode")
def images_without_content(folder):
    with reopened(folder) as file:
        camera = file["cameras/front"]
        for name in ("t_ns", "color", "depth"):
            shape = (10**5, *camera[name].shape[1:])
            replace(file, f"cameras/front/{name}", shape=shape, dtype=camera[name].dtype)


@hostile("episode")
def one_huge_image(folder):
    with reopened(folder) as file:
        frames = len(file["cameras/front/t_ns"])
        replace(file, "cameras/front/color", shape=(frames, 2**15, 2**15, 3), chunks=(1, 2**10, 2**10, 3), dtype="u1")
        replace(file, "cameras/front/depth", shape=(frames, 2**15, 2**15), chunks=(1, 2**10, 2**10), dtype="u2")


@hostile("episode")
def contiguous_space_that_was_never_given(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(2**36,), dtype="f8")


@hostile("episode")
def size_beyond_every_integer(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(2**40, 2**40), chunks=(1, 1), dtype="u1")


@hostile("episode")
def many_dimensions(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(4,) * 16, chunks=(1,) * 16, dtype="u1")


@hostile("episode", legal="an extra array may be empty")
def rows_of_no_size(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(2**40, 0), dtype="f8")


@hostile("episode")
def unlimited_sizes(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(2**33,), maxshape=(None,), chunks=(2**20,), dtype="u1")


@hostile("episode")
def elements_of_a_gigabyte(folder):
    with reopened(folder) as file:
        file.create_dataset("extra/x", shape=(4,), dtype=f"V{GIB}")


@hostile("episode")
def bomb_in_an_image(folder):
    with reopened(folder) as file:
        frames = len(file["cameras/front/t_ns"])
        edge = 2**14
        shape = (frames, edge, edge, 3)
        bomb(file, "cameras/front/color", shape, (1, *shape[1:]), "u1", zeros_deflated(3 * edge**2), frames)
        bomb(file, "cameras/front/depth", shape[:3], (1, *shape[1:3]), "u2", zeros_deflated(2 * edge**2), frames)


@hostile("episode")
def bomb_in_the_wrench(folder):
    with reopened(folder) as file:
        readings = 3 * 2**26
        chunk = 2**22
        for path, row, size in (("streams/wrench/t_ns", (), 8), ("streams/wrench/wrench", (6,), 24)):
            dtype = file[path].dtype
            packed = zeros_deflated(chunk * size)
            bomb(file, path, (readings, *row), (chunk, *row), dtype, packed, readings // chunk)


@hostile("episode")
def bomb_in_extra(folder):
    with reopened(folder) as file:
        bomb(file, "extra/x", (4 * GIB,), (64 * 2**20,), "u1", zeros_deflated(64 * 2**20), 64)


@hostile("episode")
def bomb_in_one_chunk(folder):
    with reopened(folder) as file:
        bomb(file, "extra/x", (3 * GIB,), (3 * GIB,), "u1", zeros_deflated(3 * GIB))


@hostile("episode", legal="only who reads an extra array finds what its chunks are")
def chunk_larger_than_declared(folder):
    """Says 16 bytes and decompresses to a gigabyte."""
    with reopened(folder) as file:
        bomb(file, "extra/x", (16,), (16,), "u1", zeros_deflated(GIB))


@hostile("episode")
def image_chunk_larger_than_declared(folder):
    with reopened(folder) as file:
        color = file["cameras/front/color"]
        bomb(file, "cameras/front/color", color.shape, (1, *color.shape[1:]), "u1", zeros_deflated(GIB), len(color))


@hostile("episode")
def chunk_smaller_than_declared(folder):
    with reopened(folder) as file:
        color = file["cameras/front/color"]
        bomb(file, "cameras/front/color", color.shape, (1, *color.shape[1:]), "u1", zlib.compress(b"ab"), len(color))


@hostile("episode")
def chunk_that_is_no_zlib(folder):
    with reopened(folder) as file:
        color = file["cameras/front/color"]
        bomb(file, "cameras/front/color", color.shape, (1, *color.shape[1:]), "u1", b"not zlib" * 9, len(color))


@hostile("episode")
def uncompressed_chunk_of_another_size(folder):
    with reopened(folder) as file:
        color = file["cameras/front/color"]
        shape, attributes = color.shape, dict(color.attrs)
        del file["cameras/front/color"]
        made = file.create_dataset("cameras/front/color", shape=shape, chunks=(1, *shape[1:]), dtype="u1")
        for number in range(shape[0]):
            made.id.write_direct_chunk((number, 0, 0, 0), b"short")
        made.attrs.update(attributes)


@hostile("episode")
def missing_chunk_of_a_field(folder):
    """Of one frame there is no chunk: HDF5 invents zeros."""
    with reopened(folder) as file:
        color = file["cameras/front/color"][()]
        made = replace(file, "cameras/front/color", shape=color.shape, chunks=(1, *color.shape[1:]), dtype="u1")
        made[1:] = color[1:]


@hostile("episode")
def fill_value_of_a_field(folder):
    with reopened(folder) as file:
        wrench = file["streams/wrench/wrench"]
        shape = wrench.shape
        replace(file, "streams/wrench/wrench", shape=shape, chunks=(1, 6), dtype="f4", fillvalue=7.0)


@hostile("episode", slow=True)
def deep_groups(folder):
    with reopened(folder, libver="latest") as file:
        here = file.create_group("extra").id
        for _ in range(5000):
            here = h5py.h5g.create(here, b"g")


@hostile("episode", slow=True)
def wide_groups(folder):
    with reopened(folder, libver="latest") as file:
        group = file.create_group("extra")
        for number in range(30_000):
            h5py.h5g.create(group.id, b"%d" % number)


@hostile("episode", slow=True)
def many_names_of_one_array(folder):
    with reopened(folder, libver="latest") as file:
        group = file.create_group("extra")
        group.create_dataset("x", data=np.zeros(5 * 2**20, "u1"), compression="gzip")
        for number in range(100_000):
            group.id.links.create_hard(b"%d" % number, group.id, b"x")


@hostile("episode", legal="one array under two names is what HDF5 allows, and small")
def two_names_of_one_array(folder):
    with reopened(folder) as file:
        file["extra/x"] = np.arange(5)
        file["extra/y"] = file["extra/x"]


@hostile("episode")
def field_under_two_names(folder):
    with reopened(folder) as file:
        del file["streams/tags/pose"]
        file["streams/tags/pose"] = file["streams/object/pose"]


@hostile("episode", legal=UNASKED)
def huge_attribute(folder):
    with reopened(folder, libver="latest") as file:
        file["extra/x"] = np.arange(5)
        file["extra/x"].attrs["blob"] = np.zeros(2**26, "u1")


@hostile("episode", legal=UNASKED)
def huge_attribute_of_the_file(folder):
    with reopened(folder, libver="latest") as file:
        file.attrs["blob"] = "x" * 2**26


@hostile("episode", legal=UNASKED, slow=True)
def thousands_of_attributes(folder):
    with reopened(folder, libver="latest") as file:
        extra = file.create_dataset("extra/x", data=np.arange(5))
        for number in range(3000):
            extra.attrs[f"a{number}"] = number


@hostile("episode", legal=UNASKED)
def attribute_that_declares_more_than_it_has(folder):
    with reopened(folder) as file:
        text = h5py.h5t.py_create(h5py.string_dtype(), logical=True)
        h5py.h5a.create(file.id, b"blob", text, h5py.h5s.create_simple((1000, 1)))


@hostile("episode", legal=UNASKED)
def vlen_attribute(folder):
    with reopened(folder) as file:
        file.attrs.create("blob", np.array([np.arange(3), np.arange(5)], object), dtype=h5py.vlen_dtype("i4"))


def _shared_text(folder):
    """One text of 20 MB in the file's heap, a thousand elements that all are it."""
    with reopened(folder) as file:
        made = file.create_dataset("extra/x", shape=(1000,), dtype=h5py.string_dtype())
        made[:] = ["x" * 2**10] * 1000


add("hdf5_size", "texts_in_the_heap", "episode", _shared_text)
