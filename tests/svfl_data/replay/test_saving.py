"""A saved buffer goes on as it would have, and a file that is not one, or not whole, is refused in one line."""

import io
import json
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from svfl_data.errors import FormatError, StorageError
from svfl_data.replay import ReplayBuffer
from tests.helpers.replay_episodes import agent_buffer, live_through, make_demo, small, store


def used(**settings) -> ReplayBuffer:
    """A buffer that has forgotten episodes, been drawn from and updated."""
    buffer = agent_buffer(4, 5, 6, capacity=12, config=small(beta_samples=500, rotate=True, n_step=2, **settings))
    for _ in range(3):
        batch = buffer.sample(16)
        buffer.update_priorities(batch["index"], batch["reward"] + batch["weight"] * 3)
    return buffer


def assert_equal_future(one: ReplayBuffer, other: ReplayBuffer) -> None:
    for turn in range(4):
        batch, same = one.sample(16), other.sample(16)
        assert batch.keys() == same.keys()
        for name in batch:
            np.testing.assert_array_equal(batch[name], same[name], err_msg=name)
        for buffer in (one, other):
            buffer.update_priorities(batch["index"], batch["proprio"][:, 0])
            live_through(buffer, make_demo(10 + turn, 3))
        assert one.beta == other.beta


def test_what_is_loaded_goes_on_exactly_as_what_was_saved(tmp_path):
    buffer = used()
    buffer.save(tmp_path / "b.replay")
    loaded = ReplayBuffer.load(tmp_path / "b.replay")
    assert (repr(loaded), loaded.config, loaded.spec) == (repr(buffer), buffer.config, buffer.spec)
    assert_equal_future(buffer, loaded)


def test_demonstrations_stay_demonstrations(tmp_path):
    buffer = ReplayBuffer.from_demos(store(tmp_path / "d", make_demo(0), make_demo(1)), 2, capacity=30, config=small())
    live_through(buffer, make_demo(2), terminated=False)
    buffer.save(str(tmp_path / "b.replay"))
    loaded = ReplayBuffer.load(str(tmp_path / "b.replay"))
    assert "8 of experts" in repr(loaded)
    assert_equal_future(buffer, loaded)


def test_an_empty_buffer_comes_back_empty(tmp_path):
    agent_buffer().save(tmp_path / "b.replay")
    loaded = ReplayBuffer.load(tmp_path / "b.replay")
    assert len(loaded) == 0
    live_through(loaded, make_demo(0))
    assert len(loaded.sample(3)["index"]) == 3


def test_equal_buffers_are_equal_bytes_and_leave_nothing_else(tmp_path):
    buffer = used()
    buffer.save(tmp_path / "one.replay")
    ReplayBuffer.load(tmp_path / "one.replay").save(tmp_path / "two.replay")
    assert (tmp_path / "one.replay").read_bytes() == (tmp_path / "two.replay").read_bytes()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["one.replay", "two.replay"]


def test_a_disk_that_refuses_leaves_the_old_file(tmp_path, monkeypatch):
    file = tmp_path / "b.replay"
    used().save(file)
    before = file.read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(StorageError, match=r"b\.replay.*No space left on device"):
        used(seed=1).save(file)
    assert file.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["b.replay"]
    with pytest.raises(StorageError, match=r"nowhere/b\.replay.*No such file"):
        used().save(tmp_path / "nowhere" / "b.replay")


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    file = tmp_path_factory.mktemp("saved") / "b.replay"
    used().save(file)
    return file, file.read_bytes()


@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damage_is_refused_or_changes_nothing(saved, data):
    """One bit anywhere: an error of one line, or a bit that means nothing (the date of a member)."""
    file, whole = saved
    tail = data.draw(st.booleans())  # most of the file is pixels; the directory at its end is small
    place = data.draw(st.integers(len(whole) - 4000 if tail else 0, len(whole) - 1))
    damaged = bytearray(whole)
    damaged[place] ^= 1 << data.draw(st.integers(0, 7))
    other = file.with_name("damaged.replay")
    other.write_bytes(damaged)
    words = None
    try:
        ReplayBuffer.load(other).save(other)
    except FormatError as error:
        words = str(error)
    if words is None:
        assert other.read_bytes() == whole
    else:
        assert words.startswith(f"{other}: ")
        assert "\n" not in words


@pytest.mark.parametrize("keep", [0, 1, 100, 0.5, 0.99])
def test_a_file_that_is_cut_off_is_refused(saved, keep):
    file, whole = saved
    short = file.with_name("short.replay")
    short.write_bytes(whole[: keep if isinstance(keep, int) else int(keep * len(whole))])
    with pytest.raises(FormatError, match=r"short\.replay"):
        ReplayBuffer.load(short)


def test_foreign_files_are_refused(tmp_path):
    with pytest.raises(FormatError, match="/absent: "):
        ReplayBuffer.load(tmp_path / "absent")
    with pytest.raises(FormatError, match=f"{tmp_path}: .*file"):
        ReplayBuffer.load(tmp_path)
    np.savez(tmp_path / "a.npz", np.zeros(3))
    with pytest.raises(FormatError, match=r"a\.npz.*replay\.json"):
        ReplayBuffer.load(tmp_path / "a.npz")
    for header, facts in (
        ({"format": "svfl-split"}, "'svfl-replay'"),
        ({"format": "svfl-replay", "format_version": "1.0"}, r"\b1\.0\b.*\b2\.x"),
        ({"format": "svfl-replay", "format_version": "2.0"}, "damaged"),
        ([1], "'svfl-replay'"),
    ):
        with zipfile.ZipFile(tmp_path / "b.replay", "w") as archive:
            archive.writestr("replay.json", json.dumps(header))
        with pytest.raises(FormatError, match=rf"b\.replay.*{facts}"):
            ReplayBuffer.load(tmp_path / "b.replay")


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("capacity", 0), ("capacity", -3), ("capacity", 2.5), ("capacity", 2**80), ("capacity", 14),
        ("first", -1), ("drawn", -1), ("drawn", 0.5), ("largest", float("nan")), ("largest", 0.5),
        ("config/crop", 0), ("config/crop", 17), ("config/gamma", 2), ("config/beta_samples", -1),
        ("config/seed", -1), ("config/frames", 0), ("config/group_order", None),
        ("spec/size", [99, 99]), ("spec/size", [0, 0]), ("spec/depth_scale", 0), ("spec/centre", [0, 1e999]),
        ("episodes", []), ("random", {}),
    ],
)  # fmt: skip
def test_a_header_with_impossible_numbers_is_refused(saved, path, value):
    """Also one that is whole, as a program that writes such files wrongly would leave it."""
    file, _ = saved
    other = file.with_name("impossible.replay")
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(other, "w") as forged:
        header = json.loads(archive.read("replay.json"))
        *folders, name = path.split("/")
        owner = header
        for folder in folders:
            owner = owner[folder]
        owner[name] = value
        forged.writestr("replay.json", json.dumps(header))
        for member in archive.namelist()[1:]:
            forged.writestr(member, archive.read(member))
    if (path, value) == ("capacity", 14):
        assert len(ReplayBuffer.load(other)) == 11  # larger than needed is possible
        return
    with pytest.raises(FormatError, match=r"impossible\.replay: [^\n]+\([^\n]+\)$"):
        ReplayBuffer.load(other)


@pytest.mark.parametrize(
    ("shape", "dtype"), [((10**13,), "u1"), ((2**70, 0, 2), "u1"), ((3,), "O"), ((-5,), "f4"), ((0,), "f4")]
)
def test_an_array_of_another_size_than_its_member_is_refused(saved, shape, dtype):
    """NumPy alone would allocate what is declared."""
    file, _ = saved
    other = file.with_name("declared.replay")
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": f"|{dtype}", "fortran_order": False, "shape": shape})
    with zipfile.ZipFile(file) as archive, zipfile.ZipFile(other, "w") as forged:
        for member in archive.namelist():
            forged.writestr(member, header.getvalue() + b"x" * 64 if member == "priority.npy" else archive.read(member))
    with pytest.raises(FormatError, match=r"declared\.replay: [^\n]*\bpriority\b[^\n]*$"):
        ReplayBuffer.load(other)
