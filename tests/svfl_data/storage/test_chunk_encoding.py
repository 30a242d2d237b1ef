"""Chunks that we encode are what HDF5's own filters read, whatever they hold, on any number of cores."""

import os
import zlib

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from svfl_data.schema.episode import Episode
from svfl_data.storage import store
from svfl_data.storage.chunk_encoding import LARGE, Encoding, stored
from svfl_data.storage.reader import EpisodeReader
from svfl_data.storage.store import episode_bytes, write_sealed
from tests.helpers.builders import episode_arrays, make_episode

KINDS = ["u1", "u2", "i2", "i4", "f4", "f8", "i8", "c8", "S3", "?"]


def read_by_hdf5(tmp_path, array: np.ndarray, chunk_rows: int) -> np.ndarray:
    encoding = Encoding(array.dtype, (chunk_rows, *array.shape[1:]))
    with h5py.File(tmp_path / "plain.hdf5", "w") as file:
        dataset = file.create_dataset(
            "x",
            shape=array.shape,
            dtype=array.dtype,
            chunks=encoding.chunk,
            compression="gzip",
            shuffle=encoding.shuffled,
        )
        for number, content in enumerate(encoding.encode(array)):
            dataset.id.write_direct_chunk((number * chunk_rows, *(0 for _ in array.shape[1:])), content)
    with h5py.File(tmp_path / "plain.hdf5", "r") as file:
        return file["x"][()]


@settings(deadline=None, max_examples=60)
@given(
    data=st.data(), kind=st.sampled_from(KINDS), shape=hnp.array_shapes(max_dims=3, max_side=9), rows=st.integers(1, 9)
)
def test_hdf5_reads_what_was_encoded(tmp_path_factory, data, kind, shape, rows):
    array = data.draw(hnp.arrays(kind, shape))
    read = read_by_hdf5(tmp_path_factory.mktemp("c"), array, min(rows, shape[0]))
    assert read.tobytes() == array.tobytes()


@pytest.mark.parametrize("kind", ["u1", "u2", "f4"])
@pytest.mark.parametrize("content", ["noise", "flat", "half"])
@pytest.mark.parametrize("size", [LARGE - 8, LARGE, 3 * LARGE + 40])
def test_large_chunks_too_whatever_is_chosen(tmp_path, kind, content, size):
    plain = np.random.default_rng(0).bytes(size)
    plain = (
        plain
        if content == "noise"
        else bytes(size)
        if content == "flat"
        else plain[: size // 2] + bytes(size - size // 2)
    )
    array = np.frombuffer(plain, kind).reshape(1, -1)
    assert read_by_hdf5(tmp_path, array, 1).tobytes() == plain


@settings(deadline=None)
@given(
    st.one_of(st.binary(max_size=300), st.integers(65_530, 140_000).map(lambda size: bytes(range(256)) * (size // 256)))
)
def test_stored_is_a_zlib_stream(plain):
    assert zlib.decompress(stored(np.frombuffer(plain, np.uint8))) == plain


def test_what_a_large_noisy_chunk_holds_is_not_compressed_and_what_a_flat_one_holds_is():
    noise = np.random.default_rng(0).integers(0, 256, (1, 300, 300), np.uint8)
    (stored_chunk,) = Encoding(noise.dtype, noise.shape).encode(noise)
    (packed,) = Encoding(noise.dtype, noise.shape).encode(np.zeros_like(noise))
    assert len(stored_chunk) > noise.nbytes
    assert len(packed) < noise.nbytes / 100


@pytest.mark.parametrize("cores", [1, 2, 16])
def test_the_bytes_do_not_depend_on_the_cores(tmp_path, monkeypatch, cores):
    meta = make_episode().meta
    arrays = episode_arrays(np.random.default_rng(0), steps=30, size=96)
    monkeypatch.setattr(os, "cpu_count", lambda: cores)
    monkeypatch.setattr(store, "THREADS", cores)
    monkeypatch.setattr(store, "BLOCK_BYTES", 2**15 * cores)
    path = tmp_path / "episode_000000.hdf5"
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT)
    write_sealed(descriptor, meta, arrays)
    os.close(descriptor)
    monkeypatch.undo()
    assert path.read_bytes() == episode_bytes(Episode(meta, arrays))
    np.testing.assert_array_equal(
        EpisodeReader.of_file(path)["cameras/front/color"][5:9], arrays["cameras/front/color"][5:9]
    )
