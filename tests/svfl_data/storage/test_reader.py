"""Lazy reading gives what whole reading gives, to the bit, and never reads what is not what was sealed."""

import os
import pickle
from concurrent.futures import ThreadPoolExecutor

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FieldError, FormatError
from svfl_data.schema.episode import Episode
from svfl_data.storage.chunks import Extent
from svfl_data.storage.header import forget
from svfl_data.storage.reader import EpisodeReader
from svfl_data.storage.seal import seal
from svfl_data.storage.store import episode_bytes, read_episode, write_episode
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.child import in_child


@pytest.fixture
def file(tmp_path):
    write_episode(make_episode(), tmp_path / "episode_000000.hdf5")
    return tmp_path / "episode_000000.hdf5"


def assert_same(one: Episode, other: Episode) -> None:
    assert one.meta == other.meta
    assert one.arrays.keys() == other.arrays.keys()
    for path, array in one.arrays.items():
        assert array.dtype == other.arrays[path].dtype, path
        np.testing.assert_array_equal(array, other.arrays[path], err_msg=path)


def test_a_reader_loads_what_was_written(file):
    reader = EpisodeReader.of_file(file)
    assert_same(reader.load(), read_episode(file))
    assert len(reader) == len(make_episode())
    assert reader.cameras == ["front"]
    assert reader.rates["streams/wrench/t_ns"] == pytest.approx(500)
    assert reader.rates["cameras/front/t_ns"] == pytest.approx(20)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    own=st.dictionaries(
        st.sampled_from(["a", "b/c", "größe", "d"]),
        hnp.arrays(
            st.sampled_from(["u1", "i2", "<u4", "f4", "f8", "c8", "?"]),
            hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=5),
        ),
        max_size=3,
    ),
    rows=st.integers(0, 2500),
    data=st.data(),
)
def test_any_rows_of_any_array_are_those_that_were_written(tmp_path_factory, own, rows, data):
    """Streams of several chunks, empty ones, and the user's own arrays of any shape and type."""
    file = tmp_path_factory.mktemp("any") / "e.hdf5"
    rng = np.random.default_rng(rows)
    arrays = episode_arrays(rng) | {f"extra/{name}": array for name, array in own.items()}
    arrays["streams/wrench/t_ns"] = np.cumsum(rng.integers(0, 4_000_000, rows))
    arrays["streams/wrench/wrench"] = rng.normal(size=(rows, 6)).astype(np.float32)
    write_episode(Episode(make_episode().meta, arrays), file)
    reader = EpisodeReader.of_file(file)
    assert set(reader.paths) == set(arrays)
    for path, array in arrays.items():
        assert (reader[path].shape, reader[path].dtype) == (array.shape, array.dtype)
        np.testing.assert_array_equal(reader[path][()], array, err_msg=path)
        if array.ndim:
            wanted = data.draw(st.slices(len(array) + 2))
            np.testing.assert_array_equal(reader[path][wanted], array[wanted], err_msg=f"{path} {wanted}")
            if len(array):
                row = data.draw(st.integers(-len(array), len(array) - 1))
                np.testing.assert_array_equal(reader[path][row], array[row])


def test_rows_beyond_an_array_are_refused(file):
    color = EpisodeReader.of_file(file)["cameras/front/color"]
    with pytest.raises(IndexError, match=r"cameras/front/color.*\brow 5\b.*\bhas 5\b"):
        color[5]
    with pytest.raises(FieldError, match=r"cameras/wrist/color.*cameras/front/color"):
        EpisodeReader.of_file(file)["cameras/wrist/color"]


def test_repr_says_shapes_units_and_rates(file):
    text = repr(EpisodeReader.of_file(file))
    assert "4 steps, 0.20 s" in text
    assert "streams/wrench/wrench float32 (200, 6) [N, N, N, N m, N m, N m] at 500.0 Hz" in text
    assert "cameras/front/color uint8 (5, 16, 16, 3) at 20.0 Hz" in text


def test_readers_survive_pickling_forking_and_threads(file):
    reader = EpisodeReader.of_file(file)
    frames = make_episode().arrays["cameras/front/color"]
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(reader))["cameras/front/color"][2], frames[2])
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(reader["cameras/front/color"]))[2], frames[2])
    with ThreadPoolExecutor(4) as pool:
        for row, frame in enumerate(pool.map(reader["cameras/front/color"].__getitem__, list(range(5)) * 20)):
            np.testing.assert_array_equal(frame, frames[row % 5])
    assert in_child(lambda: 0 if np.array_equal(reader["cameras/front/color"][3], frames[3]) else 1) == 0


def test_no_damage_is_read(tmp_path):
    """Neither a cut nor a flipped bit anywhere in the file."""
    whole = episode_bytes(make_episode())
    rng = np.random.default_rng(0)
    for number in range(120):
        bad = bytearray(whole)
        if number % 2:
            bad[rng.integers(len(bad))] ^= 1 << rng.integers(8)
        else:
            del bad[rng.integers(len(bad)) :]
        file = tmp_path / f"bad_{number}.hdf5"
        file.write_bytes(bad)
        with pytest.raises(FormatError, match=file.name):
            EpisodeReader.of_file(file).load()
    with pytest.raises(FormatError, match=r"absent\.hdf5"):
        EpisodeReader.of_file(tmp_path / "absent.hdf5")


def test_a_file_that_changes_while_it_is_read_is_refused(file):
    reader = EpisodeReader.of_file(file)
    color = reader["cameras/front/color"]
    color[0]
    write_episode(make_episode(1), file)
    with pytest.raises(FormatError, match=f"{file.name}.*changed"):
        color[1]
    assert EpisodeReader.of_file(file).meta.index == 1


def test_damage_after_opening_is_found_or_harmless(file):
    """The seal is checked once; afterwards zlib's own checksum still guards what is read."""
    reader = EpisodeReader.of_file(file)
    frames, before = reader["cameras/front/depth"], os.stat(file)
    content = bytearray(file.read_bytes())
    offset, size, _ = frames.placement.chunks[2]
    content[offset + size // 2] ^= 8
    with open(file, "r+b") as same:
        same.write(content)
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(FormatError, match=rf"{file.name}.*\bbyte {offset}\b"):
        frames[2]


def test_the_seal_is_checked_once_per_process(file, monkeypatch):
    forget()
    reads = []
    original = Extent.blocks
    monkeypatch.setattr(Extent, "blocks", lambda self: reads.append(self) or original(self))
    for _ in range(3):
        EpisodeReader.of_file(file).load()
    assert len(reads) == 1


def test_the_same_errors_lazily_and_whole(tmp_path):
    """A sealed file that breaks its declaration is refused whichever way it is opened."""
    arrays = make_episode().arrays
    for number, (path, value) in enumerate(
        (("streams/wrench/wrench", np.zeros((3, 6), np.float32)), ("workspace", np.zeros((3, 2), np.float32)))
    ):
        episode = make_episode()
        object.__setattr__(episode, "arrays", arrays | {path: value})
        file = tmp_path / f"{number}.hdf5"
        write_episode(episode, file)
        with pytest.raises(FieldError, match=rf"{number}\.hdf5.*{path}"):
            read_episode(file)
        with pytest.raises(FieldError, match=rf"{number}\.hdf5.*{path}"):
            EpisodeReader.of_file(file)["observations/proprio"]


@pytest.mark.parametrize(
    ("change", "error", "facts"),
    [
        (lambda file: file["workspace"].attrs.modify("unit", "mm"), FieldError, "workspace.*unit.*'mm'.*'m'"),
        (
            lambda file: file["streams/wrench/wrench"].attrs.modify("axes", "tool"),
            FieldError,
            "streams/wrench/wrench.*axes.*'tool'.*'base'",
        ),
        (
            lambda file: file["streams/wrench/tare"].attrs.__delitem__("about"),
            FieldError,
            "streams/wrench/tare.*about.*None.*'sensor origin'",
        ),
        (lambda file: file.attrs.__delitem__("task"), FormatError, "task.*missing"),
        (lambda file: file.attrs.create("index", "three"), FormatError, r"\bint\b.*\bstr\b.*\bindex\b"),
        (lambda file: file.attrs.modify("config", "{"), FormatError, "config.*JSON"),
        (lambda file: file.attrs.modify("format", "other"), FormatError, "format.*'other'.*'svfl-episode'"),
        (lambda file: file.attrs.modify("format_version", "3.0"), FormatError, r"\b3\.0\b.*\b2\.x"),
    ],
)
def test_what_is_sealed_but_wrong_is_refused_by_both(file, change, error, facts):
    with h5py.File(file, "a") as content:
        change(content)
    whole = file.read_bytes()
    content = whole[: whole.rindex(b"\nsvfl-sha256:")] if whole.count(b"\nsvfl-sha256:") else whole
    file.write_bytes(content + seal(content))
    with pytest.raises(error, match=f"{file.name}.*{facts}"):
        read_episode(file)
    with pytest.raises(error, match=f"{file.name}.*{facts}"):
        EpisodeReader.of_file(file).load()


def test_a_dataset_says_what_its_episodes_hold(tmp_path, file):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    assert repr(dataset) == f"Dataset({dataset.path}: centering, 0 episodes, seed 0)"
    file.rename(dataset.episode_path(0))
    assert_same(dataset.episode(0).load(), dataset.read(0))
    assert "1 episodes" in repr(dataset)
    assert "streams/wrench/wrench float32 (200, 6) [N, N, N, N m, N m, N m] at 500.0 Hz" in repr(dataset)
    dataset.episode_path(0).write_bytes(b"damaged")
    assert "episode_000000.hdf5: not an episode file (no HDF5 file, 7 bytes)" in repr(dataset)
