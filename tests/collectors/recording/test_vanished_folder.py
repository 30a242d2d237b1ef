"""A dataset's folder that is removed or renamed while it is recorded into: noticed, said, and never made again."""

import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from collectors.recording import worker as worker_module
from collectors.recording.collection import collect_dataset
from collectors.recording.worker import Worker
from svfl_data.datasets.dataset import Dataset
from svfl_data.datasets.held_folder import identity
from svfl_data.errors import StorageError
from svfl_data.maintenance.repair import repair_dataset
from svfl_data.recording.index_locks import NEXT
from svfl_data.recording.writer import EpisodeWriter
from svfl_data.storage.store import episode_bytes
from tests.helpers.builders import make_episode
from tests.helpers.collecting import command
from tests.helpers.collectors import Made
from tests.helpers.recording import append_all, constants_of
from tests.helpers.typist import wait_for

pytestmark = pytest.mark.slow


def renamed(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))


def replaced(folder: Path) -> None:
    renamed(folder)
    Dataset.create_or_resume(folder, "centering", 0, {})


@dataclass(frozen=True)
class Interfering:
    """Makes episodes; before the third is done, something happens to the folder."""

    folder: Path
    happens: object

    def __call__(self, index: int, **_):
        if index == 2:
            self.happens(self.folder)
        episode = make_episode(index)
        return replace(episode, meta=replace(episode.meta, config={"rejected": []}))


def here(indices, workers, worker):
    """An executor without processes."""
    return map(worker.collect, indices)


@pytest.mark.parametrize("executor", [here, None])
@pytest.mark.parametrize("happens", [renamed, replaced, shutil.rmtree])
def test_collecting_stops_and_says_where_the_rest_is(tmp_path, happens, executor):
    dataset = Dataset.create_or_resume(tmp_path / "mine", "centering", 0, {})
    where = "deleted" if happens is shutil.rmtree else tmp_path / "elsewhere"
    with pytest.raises(StorageError, match=f"{dataset.path}: .* {where}"):
        collect_dataset(dataset, 9, 1, Interfering(dataset.path, happens), *([executor] if executor else []))
    if happens is replaced:
        assert [file.name for file in dataset.path.iterdir()] == ["dataset.json"]
    else:
        assert not dataset.path.exists()
    if happens is not shutil.rmtree:
        assert Dataset.open(tmp_path / "elsewhere").indices == [0, 1]


def test_the_command_fails_with_one_line(tmp_path):
    out = tmp_path / "mine"
    words = ("--episodes", 500, "--seed", 0, "--image-size", 16, "--workers", 1, "--out", out)
    process = subprocess.Popen(command("centering", *words), stderr=subprocess.PIPE, text=True)
    wait_for(lambda: (out / "episode_000001.hdf5").exists(), process)
    out.rename(tmp_path / "elsewhere")
    _, errors = process.communicate()
    assert process.returncode == 1
    (line,) = errors.strip().splitlines()
    assert f"{out}: " in line
    assert str(tmp_path / "elsewhere") in line
    assert not out.exists()
    assert Dataset.open(tmp_path / "elsewhere").read(1).meta.index == 1


@pytest.mark.parametrize("happens", [renamed, replaced])
def test_a_recording_is_not_published_elsewhere_and_is_saved_where_it_lies(tmp_path, happens):
    dataset, episode = Dataset.create_or_resume(tmp_path / "mine", "centering", 0, {}), make_episode()
    with EpisodeWriter(dataset, replace(episode.meta, index=NEXT), constants_of(episode.arrays)) as writer:
        append_all(writer, episode.arrays)
        happens(dataset.path)
        with pytest.raises(StorageError, match=f"svfl-data repair {tmp_path / 'elsewhere'}"):
            writer.seal()
    (action,) = repair_dataset(tmp_path / "elsewhere")
    assert action.path.read_bytes() == episode_bytes(episode)
    if happens is replaced:
        assert Dataset.open(dataset.path).indices == []


def test_a_folder_that_goes_just_after_the_check_is_not_made_again(tmp_path, monkeypatch):
    dataset = Dataset.create_or_resume(tmp_path / "mine", "made", 0, {})
    worker = Worker(Made(), dataset.path, "made", 0, {}, identity=identity(dataset.path))
    check = worker_module.check_same

    def check_and_rename(folder, expected):
        check(folder, expected)
        folder.rename(tmp_path / "elsewhere")

    monkeypatch.setattr(worker_module, "check_same", check_and_rename)
    with pytest.raises(StorageError):
        worker.collect(0)
    assert not dataset.path.exists()
