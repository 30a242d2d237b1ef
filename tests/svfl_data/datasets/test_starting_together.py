"""Processes that start a dataset in the same folder at the same moment: one description, and nobody is refused."""

import functools
import re
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Barrier

import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError, StorageError, SvflError
from svfl_data.sampling.split import load_split, split_episodes
from svfl_data.system.atomic_io import write_atomically

pytestmark = pytest.mark.slow

STEPS = {"create_or_resume", "_begin", "write_atomically", "written_aside", "name_unless_taken", "save"}
"""Functions before each line of which a process may be stopped."""


@pytest.fixture(autouse=True)
def no_fsync(monkeypatch):
    monkeypatch.setattr("os.fsync", lambda descriptor: None)  # no power cuts here, and many rounds


def start(folder: Path, seed: int = 0) -> Dataset:
    return Dataset.create_or_resume(folder, "picking", seed, {"camera": {"size": 16}})


def record(folder: Path, number: int = 1, seed: int = 0) -> None:
    """What a worker does."""
    write_atomically(start(folder, seed).episode_path(number), b"an episode")


def collect(folder: Path, seed: int = 0) -> None:
    """What a collection does: it clears away what others were writing when they were killed."""
    dataset = start(folder, seed)
    with dataset.writing():
        write_atomically(dataset.episode_path(2), b"an episode")


def outcome(work: Callable[[], object]) -> SvflError | None:
    try:
        work()
    except SvflError as error:
        return error
    return None


def interrupted(work: Callable[[], object], line: int, other: Callable[[], object]) -> tuple[list, bool]:
    """Do some lines of a work, all of another, then the rest: what became of both; whether there was such a line."""
    lines, became = iter(range(sys.maxsize)), []

    def trace(frame, event, _):
        if frame.f_code.co_name not in STEPS:
            return None
        if event == "line" and next(lines) == line:
            sys.settrace(None)
            became.append(outcome(other))
        return None if became else trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        mine = outcome(work)
    finally:
        sys.settrace(before)
    return [mine, *became], bool(became)


def schedules(folder: Path, one: Callable, other: Callable) -> Iterator[tuple[Path, list]]:
    """Every line at which one process may be stopped while another does its whole work."""
    for existing in (False, True):
        line, more = 0, True
        while more:
            place = folder / f"{existing}_{line}"
            if existing:
                place.mkdir()
            became, more = interrupted(functools.partial(one, place), line, functools.partial(other, place))
            if more:
                yield place, became
            line += 1
        assert line > 10


@pytest.mark.parametrize("other", [start, functools.partial(record, number=2), collect])
def test_both_get_it_wherever_one_is_stopped(tmp_path, other):
    for place, became in schedules(tmp_path, start, other):
        assert became == [None, None], place
        assert Dataset.open(place).info["seed"] == 0
        assert not list(place.glob(".*"))


def test_of_two_that_disagree_one_wins_wherever_one_is_stopped(tmp_path):
    for place, became in schedules(tmp_path, start, functools.partial(collect, seed=1)):
        (lost,) = (error for error in became if error)
        assert isinstance(lost, DatasetError)
        won = became.index(None)
        assert re.search(rf"{place} .*seed.*\b{won}\b.*\b{1 - won}\b", str(lost))
        assert Dataset.open(place).info["seed"] == won


@pytest.mark.parametrize("seed", [0, 1])
def test_of_two_splits_of_one_name_one_is_stored_wherever_one_is_stopped(tmp_path, seed):
    """Equal ones are both content; of two that differ the other is told, and what is stored is whole."""
    mine, others = (split_episodes(range(6), {"train": 0.5, "test": 0.5}, number) for number in (0, seed))
    line, more = 0, True
    while more:
        dataset = start(tmp_path / f"{line}")
        for number in range(6):
            dataset.episode_path(number).touch()
        became, more = interrupted(functools.partial(mine.save, dataset), line, functools.partial(others.save, dataset))
        lost = [error for error in became if error]
        assert len(lost) == (more and mine.sha256 != others.sha256)
        assert all(isinstance(error, DatasetError) and "splits/default.json" in str(error) for error in lost)
        won = load_split(dataset, "default").sha256
        assert won == (others if became[0] else mine).sha256
        assert len(list((dataset.path / "splits").iterdir())) == 1
        line += 1
    assert line > 10


@pytest.mark.parametrize("links", [True, False])
def test_many_at_once(tmp_path, monkeypatch, links):
    if not links:
        monkeypatch.setattr("os.link", without_links)
    together = Barrier(4)

    def work(place: Path, number: int) -> None:
        together.wait(60)
        record(place, number)

    with ThreadPoolExecutor(4) as workers:
        for turn in range(50):
            done = [workers.submit(work, tmp_path / f"{turn}", number) for number in range(4)]
            assert [outcome(one.result) for one in done] == [None] * 4
            assert Dataset.open(tmp_path / f"{turn}").indices == [0, 1, 2, 3]


def without_links(*_: object) -> None:
    raise PermissionError(1, "Operation not permitted")


def test_what_a_killed_one_left_is_no_obstacle_and_is_cleared(tmp_path):
    (tmp_path / ".dataset.json.abc.part").write_bytes(b"half")
    with start(tmp_path).writing():
        assert [file.name for file in tmp_path.iterdir()] == ["dataset.json"]


@pytest.mark.parametrize(
    "name", ["thesis.tex", ".hidden", ".thesis.tex.abc.part", "dataset.json.abc.part", ".dataset.json.part"]
)
def test_foreign_files_are_still_refused(tmp_path, name):
    (tmp_path / name).write_text("do not touch")
    with pytest.raises(DatasetError, match=rf"{tmp_path} .*dataset\.json"):
        start(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == [name]


def test_a_disk_that_refuses_is_still_named(tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.link", full)
    with pytest.raises(StorageError, match=r"dataset\.json.*No space left on device"):
        start(tmp_path / "d")
    assert not list((tmp_path / "d").iterdir())
