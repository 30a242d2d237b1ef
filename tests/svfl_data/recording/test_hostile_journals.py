"""Journals that anybody may have made: each is one line of repair's, and the good one behind it is saved."""

import json
import os
import struct
import zlib
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import FormatError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.journal import HEADER, MAGIC, read_journal
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.storage.store import read_episode
from tests.helpers.builders import make_episode
from tests.helpers.recording import append_all, constants_of

pytestmark = pytest.mark.slow


def record(label: object, content: bytes = b"") -> bytes:
    words = label if isinstance(label, bytes) else json.dumps(label).encode()
    return HEADER.pack(MAGIC, len(words), len(content), zlib.crc32(content, zlib.crc32(words))) + words + content


def rows(path: str, array: np.ndarray, **changes) -> bytes:
    label = {"path": path, "dtype": array.dtype.str, "shape": array.shape, "start": 0} | changes
    return record({name: value for name, value in label.items() if value is not None}, array.tobytes())


META = asdict(make_episode(1).meta)


def episode_records(**replaced: bytes) -> bytes:
    """A whole unfinished episode 1; records by dataset path may be replaced."""
    arrays, constants = make_episode(1).arrays, constants_of(make_episode(1).arrays)
    content = replaced.pop("meta", record({"meta": META}))
    for path, array in arrays.items():
        kind = {"start": None, "constant": True} if path in constants else {}
        content += replaced.pop(path, rows(path, array, **kind))
    return content + b"".join(replaced.values())


def with_meta(**changes: object) -> bytes:
    return episode_records(meta=record({"meta": META | changes}))


def with_rows(path: str, **changes: object) -> bytes:
    return episode_records(**{path: rows(path, make_episode(1).arrays[path], **changes)})


DEEP = b'{"meta":' + b'{"config":' * 3000 + b"{}" + b"}" * 3001
WRENCH, T_NS = "streams/wrench/wrench", "streams/wrench/t_ns"
QUARANTINED = {
    "nothing": b"",
    "text": b"time,fx,fy\n" * 100,
    "zeros": bytes(100_000),
    "no metadata": episode_records(meta=b""),
    "metadata is a list": record({"meta": [1, 2]}) + episode_records(meta=b""),
    "label is a list": record([1, 2]) + episode_records(meta=b""),
    "label is no JSON": record(b"\xff{") + episode_records(meta=b""),
    "deep JSON": record(DEEP) + episode_records(meta=b""),
    "index is text": with_meta(index="1"),
    "index is another one": with_meta(index=7),
    "index is negative": with_meta(index=-5),
    "index is huge": with_meta(index=10**30),
    "success is a number": with_meta(success=3),
    "config is text": with_meta(config="x"),
    "history is a number": with_meta(history=3),
    "history holds numbers": with_meta(history=[3]),
    "task is another one": with_meta(task="pushing"),
    "surrogates": with_meta(task="\ud800"),
    "objects": with_rows(T_NS, dtype="|O"),
    "records": with_rows(T_NS, dtype="i4,i4"),
    "no dtype": with_rows(T_NS, dtype="nonsense((("),
    "huge shape": with_rows(T_NS, shape=[2**62, 2**62]),
    "shape of text": with_rows(T_NS, shape="many"),
    "negative shape": with_rows(T_NS, shape=[-1]),
    "shape is not that of the content": with_rows(T_NS, shape=[3]),
    "negative start": with_rows(T_NS, start=-1),
    "huge start": with_rows(T_NS, start=2**70),
    "start is text": with_rows(T_NS, start="0"),
    "not a number": episode_records(
        **{WRENCH: rows(WRENCH, np.full_like(make_episode(1).wrench, np.nan))}
    ),
    "one row": record({"meta": META}) + rows(T_NS, np.arange(1)),
}  # fmt: skip
SALVAGED = {
    "a way up": episode_records(own=rows("extra/../../../x", np.zeros(3))),
    "an absolute path": episode_records(own=rows("/extra/x", np.zeros(3))),
    "a control": episode_records(own=rows("extra/\x1b[2J", np.zeros(3))),
    "an unknown array": episode_records(own=rows("unknown/x", np.zeros(3))),
    "an object array": episode_records(own=rows("extra/x", np.zeros(3), dtype="|O")),
    "a row of no bytes": episode_records(own=rows("extra/x", np.zeros((0, 3)), shape=[0, 2**50])),
    "bytes of no size": episode_records(own=rows("extra/x", np.zeros(0, "S1"), dtype="|S0", shape=[2**40])),
    "constants twice": episode_records(own=rows("workspace", make_episode().workspace, start=None, constant=True)),
    "another shape later": episode_records(own=rows(WRENCH, np.zeros((4, 5), np.float32), start=10**6)),
    "a record beyond the file": episode_records() + struct.pack("<4sIQI", MAGIC, 10, 2**60, 0) + b"x" * 100,
    "magics": episode_records() + MAGIC * 50_000,
    "gaps of nonsense": episode_records() + record({"gap": {"stream": 3}}) + record({"gap": {"a": [1]}}),
    "a gap that runs backwards": episode_records()
    + record({"gap": {"stream": "streams/wrench", "start_ns": 9, "end_ns": 3, "reason": "x"}}),
    "a gap in all of time": episode_records()
    + record({"gap": {"stream": "streams/wrench", "start_ns": -(2**70), "end_ns": 2**70, "reason": "x"}}),
    "a fault with controls": episode_records() + record({"fault": "\x1b[2J\n\n"}),
    "an unknown record": episode_records() + record({"surprise": 1}),
}


@pytest.fixture
def dataset(tmp_path) -> Dataset:
    return Dataset.create_or_resume(tmp_path / "recorded", "centering", 0, {})


def good_journal(dataset: Dataset, index: int = NEXT) -> None:
    episode = make_episode()
    with EpisodeWriter(dataset, replace(episode.meta, index=index), constants_of(episode.arrays)) as writer:
        append_all(writer, episode.arrays)


def journal_path(dataset: Dataset) -> Path:
    folder = dataset.path / ".inflight"
    folder.mkdir(exist_ok=True)
    return folder / "episode_000001.journal"


def repaired(dataset: Dataset, done: str) -> None:
    """The strange journal 1 is one line, the good one behind it is saved, and repairing again finds nothing."""
    good_journal(dataset, index=2)
    first, second = repair_dataset(dataset.path)
    assert first.done == done, first
    assert "\n" not in first.detail
    assert "Error(" not in first.detail or "not a readable journal" in first.detail
    assert (second.done, second.path.name) == ("salvaged", "episode_000002.hdf5")
    assert list((dataset.path / ".inflight").iterdir()) == []
    for index in dataset.indices:
        read_episode(dataset.episode_path(index))
    assert repair_dataset(dataset.path) == []


@pytest.mark.parametrize("content", QUARANTINED.values(), ids=QUARANTINED.keys())
def test_what_gives_no_episode_is_set_aside_and_the_next_one_saved(dataset, content):
    journal_path(dataset).write_bytes(content)
    repaired(dataset, "quarantined")
    assert (dataset.path / "damaged" / "episode_000001.journal").read_bytes() == content


@pytest.mark.parametrize("content", SALVAGED.values(), ids=SALVAGED.keys())
def test_what_is_strange_in_an_episode_is_left_out(dataset, content):
    journal_path(dataset).write_bytes(content)
    repaired(dataset, "salvaged")
    saved = read_episode(dataset.episode_path(1))
    assert saved.arrays.keys() - make_episode(1).arrays.keys() <= {"extra/x"}
    np.testing.assert_array_equal(saved.wrench, make_episode(1).wrench)


def test_an_array_of_another_dtype_than_declared_is_left_out(dataset):
    content = with_rows(WRENCH, dtype="<i4")
    journal_path(dataset).write_bytes(content)
    repaired(dataset, "salvaged")
    saved = read_episode(dataset.episode_path(1))
    assert not saved.has("wrench")
    assert saved.meta.history[-1]["damaged_bytes"] > 0
    assert (dataset.path / "damaged" / "episode_000001.journal").read_bytes() == content


def test_rows_that_never_were_are_not_made_up(dataset):
    content = with_rows(T_NS, start=2**40)
    journal_path(dataset).write_bytes(content)
    repaired(dataset, "salvaged")
    assert len(read_episode(dataset.episode_path(1)).wrench) == 0
    assert (dataset.path / "damaged" / "episode_000001.journal").read_bytes() == content


@pytest.mark.parametrize("kind", ["pipe", "link", "folder", "dangling link"])
def test_what_is_no_file_is_set_aside_unread(dataset, tmp_path, kind):
    (tmp_path / "secret").write_bytes(episode_records())
    path = journal_path(dataset)
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(tmp_path / ("secret" if kind == "link" else "nothing"))
    repaired(dataset, "quarantined")
    assert (tmp_path / "secret").read_bytes() == episode_records()


@pytest.mark.parametrize("name", ["notes.journal", "episode_1.journal", "episode_000001x.journal"])
def test_a_journal_of_another_name_is_set_aside(dataset, name):
    journal_path(dataset).with_name(name).write_bytes(episode_records())
    (action,) = repair_dataset(dataset.path)
    assert action.done == "quarantined"


@pytest.mark.parametrize("folder", [".inflight", "damaged"])
def test_nothing_is_written_through_a_link(dataset, tmp_path, folder):
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "episode_000001.journal").write_bytes(b"text")
    if folder == "damaged":
        journal_path(dataset).write_bytes(b"text")
    (dataset.path / folder).symlink_to(outside)
    with pytest.raises(FormatError, match=f"{folder}.*symbolic link"):
        repair_dataset(dataset.path)
    assert [file.name for file in outside.iterdir()] == ["episode_000001.journal"]


def test_reading_a_journal_made_to_take_for_ever_ends(tmp_path, monkeypatch):
    """Headers that each claim nearly the whole file, and are damaged: as many bytes are read as the file allows."""
    count = 200_000
    content = b"".join(HEADER.pack(MAGIC, 0, 20 * (count - row - 1), 1) for row in range(count))
    path = tmp_path / "hostile"
    path.write_bytes(content)
    read = [0]
    pread = os.pread

    def counting(descriptor, size, offset):
        found = pread(descriptor, size, offset)
        read[0] += len(found)
        return found

    monkeypatch.setattr(os, "pread", counting)
    descriptor = os.open(path, os.O_RDONLY)
    journal = read_journal(descriptor)
    os.close(descriptor)
    assert journal.damaged == [(0, len(content))]
    assert read[0] < 20 * len(content) + 2**27
