"""The index is a cache: it saves time, is never believed over the files, and may vanish at any moment."""

import dataclasses
import json
import multiprocessing
import os
import shutil

import pytest

from svfl_data.datasets import index
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.index import INDEX, append_index, entries, summary
from svfl_data.errors import StorageError
from svfl_data.maintenance.pack import pack
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode
from tests.helpers.open_episode import bare_episode, dataset_of, open_episode

pytestmark = pytest.mark.slow


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "d", "centering", 0, {})
    for number in range(4):
        write_episode(make_episode(number, steps=3 + number), dataset.episode_path(number))
    return dataset


@pytest.fixture
def opened(monkeypatch):
    """Names of the episodes that were opened to be described."""
    names = []
    describe = index.describe
    monkeypatch.setattr(index, "describe", lambda extent: names.append(extent.file.name) or describe(extent))
    return names


def test_the_summary_is_the_sum_of_the_files(dataset):
    found = summary(dataset)
    assert (found.episodes, found.damaged, found.steps) == (4, {}, 3 + 4 + 5 + 6)
    assert found.seconds == pytest.approx(sum(0.05 * steps for steps in (3, 4, 5, 6)))
    assert found.bytes == sum(dataset.episode_path(number).stat().st_size for number in range(4))
    assert (found.successes, found.tasks, found.sources) == (4, {"centering": 4}, {"expert": 4})
    assert found.format_versions == {"2.0": 4}
    wrench = found.streams["wrench"]
    assert (wrench["episodes"], wrench["rows"]) == (4, sum(25 * steps + 100 for steps in (3, 4, 5, 6)))
    assert wrench["rate_hz"] == pytest.approx((500, 500))
    assert found.cameras["front"]["sizes"] == [[16, 16]]
    assert found == summary(dataset)  # from the index what came from the files


def test_instructions_and_robots_are_counted_and_lines_without_them_do_not_count(tmp_path, opened):
    cups = dataset_of(tmp_path / "cups", open_episode)
    assert summary(cups).instructions == {"put the cup on the plate": 3}
    assert summary(cups).robots == {"ur5e": 3}
    assert summary(dataset_of(tmp_path / "bare", bare_episode)).instructions == {}
    before = len(opened)
    lines = [json.loads(line) for line in (cups.path / INDEX).read_text().splitlines()]
    older = [{name: value for name, value in line.items() if name != "robot"} for line in lines]
    (cups.path / INDEX).write_text("".join(json.dumps(line) + "\n" for line in older))
    assert summary(cups).robots == {"ur5e": 3}
    assert len(opened) == before + 3


def test_an_index_keeps_the_beginning_of_a_long_instruction(tmp_path):
    def talkative(number):
        episode = make_episode(number)
        return dataclasses.replace(episode, meta=dataclasses.replace(episode.meta, instruction="please " * 5000))

    (said,) = summary(dataset_of(tmp_path / "long", talkative, 1)).instructions
    assert len(said) == index.LONGEST_SAID


def test_only_what_is_new_or_changed_is_opened(dataset, opened):
    summary(dataset)
    assert len(opened) == 4
    summary(dataset)
    assert len(opened) == 4
    write_episode(make_episode(4), dataset.episode_path(4))
    write_episode(make_episode(1, steps=9), dataset.episode_path(1))
    dataset.episode_path(3).unlink()
    assert summary(dataset).steps == 3 + 9 + 5 + 4
    assert sorted(opened[4:]) == ["episode_000001.hdf5", "episode_000004.hdf5"]


def test_the_index_is_never_believed_over_the_files(dataset):
    honest = entries(dataset)
    file = dataset.path / INDEX
    lines = [json.loads(line) for line in file.read_text().splitlines()]
    lies = [line | {"steps": 1000, "size": line["size"] + 1} for line in lines]
    ghosts = [line | {"name": "episode_000077.hdf5", "index": 77} for line in lines[:1]]
    file.write_text("".join(json.dumps(line) + "\n" for line in lies + ghosts))
    assert entries(dataset) == honest


@pytest.mark.parametrize("damage", ["", "\n", "{", "null\n[]\n3\n", '{"name": 1}\n', "\x00\xff garbage"])
def test_a_broken_index_is_rebuilt(dataset, damage):
    honest = entries(dataset)
    file = dataset.path / INDEX
    whole = file.read_text()
    for content in (damage, whole + damage, whole[: len(whole) // 2] + damage, damage + whole):
        file.write_text(content, encoding="utf-8")
        assert entries(dataset) == honest
        assert entries(dataset) == honest


def test_the_last_line_of_a_name_wins_and_old_lines_are_cleared_away(dataset):
    for steps in range(1, 20):
        write_episode(make_episode(0, steps=steps), dataset.episode_path(0))
        append_index(dataset.path, dataset.episode_path(0))
    assert entries(dataset)[0].steps == 19
    for _ in range(12):
        write_episode(make_episode(0), dataset.episode_path(0))
        os.utime(dataset.episode_path(0), ns=(0, _))
        assert entries(dataset)[0].steps == 4
    assert len((dataset.path / INDEX).read_text().splitlines()) <= 2 * 4 + 10


def test_a_folder_that_cannot_be_written_is_still_summarised(dataset, monkeypatch):
    def full(*_):
        raise StorageError("disk full")

    monkeypatch.setattr(index, "_append", full)
    assert summary(dataset).episodes == 4
    assert not (dataset.path / INDEX).exists()


def test_damage_is_part_of_the_summary_and_looked_at_again(dataset):
    whole = dataset.episode_path(2).read_bytes()
    dataset.episode_path(2).write_bytes(whole[:-100])
    found = summary(dataset)
    assert found.episodes == 3
    assert list(found.damaged) == ["episode_000002.hdf5"]
    dataset.episode_path(2).write_bytes(whole)
    assert summary(dataset).damaged == {}


def append(folder, number):
    dataset = Dataset.open(folder)
    for _ in range(30):
        append_index(folder, dataset.episode_path(number))


@pytest.mark.slow
def test_writers_do_not_mix_their_lines(dataset, opened):
    context = multiprocessing.get_context("fork")
    writers = [context.Process(target=append, args=(dataset.path, number)) for number in range(4)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
        assert writer.exitcode == 0
    lines = [json.loads(line) for line in (dataset.path / INDEX).read_text().splitlines()]
    assert len(lines) == 120
    assert summary(dataset).episodes == 4
    assert opened == []


def test_a_packed_dataset_has_the_same_summary(dataset, tmp_path):
    packed = pack(dataset, tmp_path / "packed", shard_bytes=40_000)
    assert summary(packed) == summary(dataset) == summary(packed)
    own = [dataclasses.replace(entry, name="", size=0, mtime_ns=0) for entry in entries(dataset)]
    assert own == [dataclasses.replace(entry, name="", size=0, mtime_ns=0) for entry in entries(packed)]


def test_looking_at_a_dataset_does_not_change_it_for_collectors(dataset, tmp_path):
    summary(dataset)
    again = Dataset.create_or_resume(dataset.path, "centering", 0, {})
    with again.writing():
        assert again.indices == [0, 1, 2, 3]
    shutil.copytree(dataset.path, tmp_path / "copy")
    assert summary(Dataset.open(tmp_path / "copy")) == summary(dataset)
