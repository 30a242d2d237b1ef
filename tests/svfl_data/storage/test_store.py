"""An episode file gives back exactly what was written, or says what is wrong with it."""

import errno
import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rerun.chunk import IndexColumn
from rerun.experimental import Hdf5Reader

from svfl_data.errors import FieldError, FormatError, StorageError
from svfl_data.schema.declarations import Declarations
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.field import Field
from svfl_data.schema.fields import CAMERA, FIELDS
from svfl_data.storage.seal import seal
from svfl_data.storage.store import episode_bytes, read_episode, write_episode
from svfl_data.system.atomic_io import write_atomically
from tests.helpers.builders import episode_arrays, make_episode
from tests.helpers.child import in_child

TEMPERATURE = Field(path="streams/temperature/celsius", dtype="float64", shape=("K",), unit="degrees Celsius")


def needs(path, name):
    """Whether an array means nothing without another one: its times, or the unit of its depth."""
    group, _, leaf = name.rpartition("/")
    same = path.startswith(f"{group}/")
    return same and ((leaf == "t_ns" and path != f"{group}/half_extents") or name == path + "_scale")


OPTIONAL = [
    field.path.replace(CAMERA, "front") for field in FIELDS if field.path not in ("observations/t_ns", "actions/action")
]


def assert_equal(a: Episode, b: Episode) -> None:
    assert a.meta == b.meta
    assert a.arrays.keys() == b.arrays.keys()
    for name, array in a.arrays.items():
        assert array.dtype == b.arrays[name].dtype
        np.testing.assert_array_equal(array, b.arrays[name])


@pytest.mark.slow
@settings(deadline=None, max_examples=25)
@given(
    steps=st.integers(1, 6),
    size=st.integers(1, 12),
    seed=st.integers(0, 2**32 - 1),
    text=st.text(alphabet=st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=20),
    dropped=st.sets(st.sampled_from(OPTIONAL)),
    readings=st.integers(0, 3),
    gaps=st.lists(st.integers(1, 10**12), min_size=3, max_size=3),
    own=st.text(alphabet=st.characters(categories=["L", "N"]), min_size=1, max_size=10),
    shape=st.lists(st.integers(0, 4), max_size=3),
)
def test_what_is_written_is_read(tmp_path_factory, steps, size, seed, text, dropped, readings, gaps, own, shape):
    """Any sizes, rates and missing streams; streams without a reading; unicode in metadata and names."""
    rng = np.random.default_rng(seed)
    arrays = episode_arrays(rng, steps=steps, size=size)
    for name in dropped:
        arrays.pop(name, None)
        for other in [path for path in arrays if needs(path, name)]:
            del arrays[other]
    if not {"cameras/front/color", "cameras/front/depth"} & arrays.keys():
        arrays = {path: array for path, array in arrays.items() if not path.startswith("cameras/")}
    if "streams/wrench/t_ns" in arrays:
        arrays["streams/wrench/t_ns"] = np.cumsum(gaps)[:readings]
    if "streams/wrench/wrench" in arrays:
        arrays["streams/wrench/wrench"] = arrays["streams/wrench/wrench"][:readings]
    arrays[f"extra/{own}/reading"] = rng.normal(size=shape)
    episode = Episode(
        Meta(
            "centering",
            1,
            seed,
            "teleop",
            False,
            {"note": text, "list": [1, 2.5]},
            annotations=[{"name": text, "start_ns": 0, "end_ns": 1}],
        ),
        arrays,
    )
    path = tmp_path_factory.mktemp("store") / "episode.hdf5"
    write_episode(episode, path)
    assert_equal(read_episode(path), episode)


@pytest.mark.slow
def test_equal_episodes_are_equal_bytes():
    first = episode_bytes(make_episode(3))
    time.sleep(1.1)  # HDF5 stores times in whole seconds, if it does
    assert first == episode_bytes(make_episode(3))
    assert first != episode_bytes(make_episode(4))


def test_plain_h5py_can_read_units_and_components(tmp_path):
    write_episode(make_episode(), tmp_path / "e.hdf5")
    with h5py.File(tmp_path / "e.hdf5") as file:
        wrench = file["streams/wrench/wrench"]
        assert wrench.attrs["unit"] == "N, N, N, N m, N m, N m"
        assert json.loads(wrench.attrs["declaration"])["components"] == ["fx", "fy", "fz", "mx", "my", "mz"]
        assert (wrench.compression, wrench.shuffle) == ("gzip", True)


@pytest.mark.parametrize(
    ("group", "constants", "rows"),
    [
        ("/streams/wrench", ["/tare"], 200),
        ("/cameras/front", ["/depth_scale", "/intrinsics", "/T_base_camera", "/image_axes"], 5),
    ],
)
def test_reruns_own_reader_can_read_every_clock(tmp_path, group, constants, rows):
    """Another HDF5 implementation (Rerun's, in Rust) reads a sealed file, one group per clock."""
    write_episode(make_episode(), tmp_path / "e.hdf5")
    clock = IndexColumn.duration("/t_ns", input_unit="ns")
    stream = Hdf5Reader(tmp_path / "e.hdf5").stream(root_group=group, ignore_datasets=constants, index_column=clock)
    assert rows in [chunk.num_rows for chunk in stream.to_chunks()]


def test_arrays_of_an_episode_cannot_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        make_episode().wrench[0] = 0


def test_an_absent_stream_is_named(tmp_path):
    arrays = episode_arrays(np.random.default_rng(0))
    del arrays["streams/joints/position"]
    episode = Episode(make_episode().meta, arrays, name="e.hdf5")
    with pytest.raises(AttributeError, match=r"e\.hdf5.*streams/joints/position"):
        _ = episode.joints


def spoil_nan(arrays):
    arrays["streams/wrench/wrench"][7, 2] = np.nan


def spoil_shape(arrays):
    arrays["actions/action"] = arrays["actions/action"][:, :4]


def spoil_rows(arrays):
    for name in ("actions/action", "actions/expert_action"):
        arrays[name] = arrays[name][:-1]


def spoil_dtype(arrays):
    arrays["cameras/front/depth"] = arrays["cameras/front/depth"].astype(np.float32)


def spoil_size(arrays):
    arrays["cameras/front/depth"] = arrays["cameras/front/depth"][:, :-1]


def spoil_missing(arrays):
    del arrays["observations/t_ns"]


def spoil_actions(arrays):
    del arrays["actions/action"], arrays["actions/expert_action"]


def spoil_unknown(arrays):
    arrays["temperature"] = np.zeros(3)


@pytest.mark.parametrize(
    ("spoil", "facts"),
    [
        (spoil_nan, r"streams/wrench/wrench.*\bnan\b.*\(7, 2\)"),
        (spoil_shape, r"actions/action.*\(4, 4\).*\(N, 5\)"),
        (spoil_rows, r"\b5 observations.*\b4 actions.*\b3\b"),
        (spoil_dtype, "cameras/front/depth.*float32.*uint16"),
        (spoil_size, "cameras/front/depth.*H = 15.*cameras/front/color.*H = 16"),
        (spoil_missing, "observations/t_ns.*missing"),
        (spoil_actions, "actions/"),
        (spoil_unknown, "'temperature'.*observations/t_ns"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(spoil, facts):
    arrays = episode_arrays(np.random.default_rng(0))
    spoil(arrays)
    with pytest.raises(FieldError, match=facts):
        Episode(make_episode().meta, arrays)


def reseal(path: Path) -> None:
    """Seal a file that a test has changed with plain h5py."""
    content = path.read_bytes()
    path.write_bytes(content + seal(content))


def test_missing_and_foreign_files_are_named(tmp_path):
    with pytest.raises(FormatError, match=r"absent\.hdf5"):
        read_episode(tmp_path / "absent.hdf5")
    with pytest.raises(FormatError, match=rf"{tmp_path}: .*folder"):
        read_episode(tmp_path)
    (tmp_path / "empty.hdf5").touch()
    with pytest.raises(FormatError, match=r"empty\.hdf5.*\b0 bytes"):
        read_episode(tmp_path / "empty.hdf5")
    (tmp_path / "text.hdf5").write_text("not HDF5")
    with pytest.raises(FormatError, match=r"text\.hdf5.*\b8 bytes"):
        read_episode(tmp_path / "text.hdf5")
    with h5py.File(tmp_path / "foreign.hdf5", "w") as file:
        file["data/demo_0/actions"] = np.zeros((3, 7))
    with pytest.raises(FormatError, match=r"foreign\.hdf5.*sealed"):
        read_episode(tmp_path / "foreign.hdf5")
    reseal(tmp_path / "foreign.hdf5")
    with pytest.raises(FormatError, match=r"foreign\.hdf5.*None.*'svfl-episode'"):
        read_episode(tmp_path / "foreign.hdf5")


def test_later_versions_are_read_if_minor_and_refused_if_major(tmp_path):
    path = tmp_path / "later.hdf5"
    write_episode(make_episode(), path)
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = "2.7"
        for name in ("celsius", "t_ns"):
            field = Declarations([TEMPERATURE]).at(f"streams/temperature/{name}")
            file[field.path] = np.arange(3, dtype=field.dtype)
            file[field.path].attrs.update(field.attributes)
    reseal(path)
    read = read_episode(path)
    assert read["streams/temperature/celsius"].tolist() == [0, 1, 2]
    assert read.declarations.own == (replace(TEMPERATURE, shape=("T",)),)
    for version in ("1.0", "3.0"):
        with h5py.File(path, "a") as file:
            file.attrs["format_version"] = version
        reseal(path)
        with pytest.raises(FormatError, match=rf"later\.hdf5.*\b{version}\b.*\b2\.x"):
            read_episode(path)


def test_a_sealed_file_without_its_attributes_is_an_error_of_ours(tmp_path):
    path = tmp_path / "bare.hdf5"
    write_episode(make_episode(), path)
    with h5py.File(path, "a") as file:
        del file.attrs["task"]
    reseal(path)
    with pytest.raises(FormatError, match=r"bare\.hdf5.*task.*missing"):
        read_episode(path)


def test_the_users_own_arrays_are_kept(tmp_path):
    own = {"extra/tactile/left": np.arange(12.0).reshape(3, 4), "extra/note": np.array(7)}
    episode = Episode(make_episode().meta, make_episode().arrays | own)
    write_episode(episode, tmp_path / "e.hdf5")
    assert_equal(read_episode(tmp_path / "e.hdf5"), episode)


def test_a_truncated_file_is_an_error_wherever_it_ends(tmp_path):
    whole = episode_bytes(make_episode())
    path = tmp_path / "e.hdf5"
    for end in np.linspace(0, len(whole) - 1, 60).astype(int):
        path.write_bytes(whole[:end])
        with pytest.raises(FormatError, match=r"e\.hdf5"):
            read_episode(path)


def test_a_flipped_bit_is_never_silent(tmp_path):
    """Anywhere: HDF5 itself reads some damage as if nothing had happened, and never returns from other damage."""
    whole = bytearray(episode_bytes(make_episode()))
    path = tmp_path / "e.hdf5"
    rng = np.random.default_rng(0)
    for position in rng.integers(0, len(whole), 300):
        damaged = whole.copy()
        damaged[position] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        with pytest.raises(FormatError, match=r"e\.hdf5"):
            read_episode(path)


WRITER = """
import sys
from pathlib import Path
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode
folder = Path(sys.argv[1])
for index in range(100_000):
    write_episode(make_episode(index, steps=3), folder / f"episode_{index:06d}.hdf5")
"""


@pytest.mark.slow
def test_a_killed_writer_leaves_only_whole_episodes(tmp_path):
    root = Path(__file__).parents[3]
    rng = np.random.default_rng(0)
    for attempt in range(4):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        writer = subprocess.Popen([sys.executable, "-c", WRITER, folder], cwd=root)
        while len(list(folder.glob("*.hdf5"))) < 3:
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.1))
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        files = sorted(folder.glob("*.hdf5"))
        for index, file in enumerate(files):
            assert_equal(read_episode(file), make_episode(index, steps=3))


def test_a_full_disk_costs_only_the_unfinished_episode(tmp_path):
    """With no room for a whole file the process lives, says so, and leaves the earlier episode and no remains."""
    write_episode(make_episode(0), tmp_path / "episode_000000.hdf5")

    def write_too_much() -> int:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
        try:
            write_episode(make_episode(1), tmp_path / "episode_000001.hdf5")
        except StorageError as error:
            return 0 if "episode_000001.hdf5" in str(error) and os.strerror(errno.EFBIG) in str(error) else 3
        return 4

    assert in_child(write_too_much) == 0
    assert [file.name for file in tmp_path.iterdir()] == ["episode_000000.hdf5"]
    assert_equal(read_episode(tmp_path / "episode_000000.hdf5"), make_episode(0))


def test_a_missing_folder_is_an_error_of_ours(tmp_path):
    with pytest.raises(StorageError, match=f"absent/file.*{os.strerror(errno.ENOENT)}"):
        write_atomically(tmp_path / "absent" / "file", b"x")
