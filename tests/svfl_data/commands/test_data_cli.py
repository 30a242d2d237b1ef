import subprocess
import sys

import h5py
import pytest

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode


@pytest.fixture
def dataset(tmp_path):
    dataset = Dataset.create_or_resume(tmp_path / "data", "centering", 0, {})
    for index in (2, 5):
        write_episode(make_episode(index), dataset.episode_path(index))
    return dataset


def one_line(text):
    return text.startswith("svfl-data") and text.endswith("\n") and text.count("\n") == 1


@pytest.mark.parametrize(("words", "shown"), [((), 2), (("--episode", 5), 5)])
def test_view_saves_the_chosen_or_the_first_episode(command, dataset, tmp_path, monkeypatch, words, shown):
    from svfl_data.viewer import show

    saved = []
    monkeypatch.setattr(show, "content", lambda episodes, urdf: [shown.meta.index for shown, _ in episodes])
    monkeypatch.setattr(show, "save", lambda content, path: saved.append((content, path)))
    code, out, _ = command("view", dataset.path, *words, "--out", tmp_path / "a.rrd")
    assert (code, saved) == (0, [([shown], tmp_path / "a.rrd")])
    assert f"rerun {tmp_path / 'a.rrd'}" in out


def test_view_takes_a_single_episode_file(command, dataset, tmp_path):
    code, _, err = command("view", dataset.episode_path(5), "--out", tmp_path / "a.rrd")
    assert (code, err) == (0, "")
    assert (tmp_path / "a.rrd").stat().st_size > 0


def test_every_mistake_is_one_line_with_its_exit_code(command, dataset, tmp_path):
    truncated = tmp_path / "truncated.hdf5"
    truncated.write_bytes(dataset.episode_path(2).read_bytes()[:-1000])
    foreign = tmp_path / "foreign.hdf5"
    with h5py.File(foreign, "w") as file:
        file["x"] = 1
    text = tmp_path / "text.hdf5"
    text.write_text("text")
    no_dataset, empty = tmp_path / "folder", tmp_path / "empty"
    no_dataset.mkdir()
    Dataset.create_or_resume(empty, "centering", 0, {})
    target = tmp_path / "out.rrd"
    for words, code, said in (
        ((tmp_path / "nowhere",), 1, "no such folder"),
        ((tmp_path / "nowhere.hdf5",), 1, "no such file"),
        ((no_dataset,), 1, "not a dataset"),
        ((empty,), 1, "no episodes"),
        ((truncated,), 1, "sealed"),
        ((foreign,), 1, "sealed"),
        ((text,), 1, "4 bytes"),
        ((dataset.path, "--episode", 7), 1, "2 episodes, 2 to 5"),
        ((dataset.path, "--episode", -1), 2, "integer of at least 0"),
        ((dataset.episode_path(2), "--episode", 2), 2, "--episode chooses from a dataset"),
        ((), 2, "PATH"),
    ):
        found, out, err = command("view", *words, "--out", target)
        assert (found, out) == (code, ""), words
        assert one_line(err), err
        assert said in err
        assert code == 2 or str(words[0]) in err
    assert not target.exists()


def test_save_names_that_cannot_work_are_one_line(command, dataset, tmp_path):
    (tmp_path / "folder.rrd").mkdir()
    for target, code, said in (
        (tmp_path / "out.txt", 2, "must end in .rrd"),
        (tmp_path / "missing" / "out.rrd", 1, "No such file or directory"),
        (tmp_path / "folder.rrd", 1, "no ordinary file"),
    ):
        found, _, err = command("view", dataset.path, "--out", target)
        assert found == code
        assert one_line(err), err
        assert said in err
        assert str(target) in err


def test_a_failed_save_leaves_the_old_file_and_nothing_else(command, dataset, tmp_path, monkeypatch):
    target = tmp_path / "saved" / "out.rrd"
    target.parent.mkdir()
    target.write_bytes(b"precious")

    def full_disk(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    code, _, err = command("view", dataset.path, "--out", target)
    assert code == 1
    assert "No space left on device" in err
    assert target.read_bytes() == b"precious"
    assert list(target.parent.iterdir()) == [target]


def test_without_a_display_the_way_out_is_named(command, dataset, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    code, _, err = command("view", dataset.path)
    assert code == 1
    assert one_line(err)
    assert "--out FILE.rrd" in err


def test_a_viewer_that_fails_is_one_line(command, dataset, monkeypatch):
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setenv("DISPLAY", ":98765")
    code, _, err = command("view", dataset.path)
    assert code == 1
    assert one_line(err), err
    assert "--out FILE.rrd" in err


def python(script):
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("words", [["--help"], ["view", "--help"]])
def test_help_has_an_example_and_does_not_load_the_viewer(words):
    shown = python(f"""
import sys
from svfl_data.cli import main
sys.argv = ["svfl-data", *{words}]
try:
    main()
finally:
    assert "rerun" not in sys.modules
""")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert "svfl-data view data/centering --episode 3" in shown.stdout


def test_without_rerun_the_command_says_what_to_install(dataset):
    ended = python(f"""
import sys
from svfl_data.cli import main
sys.modules["rerun"] = None
sys.argv = ["svfl-data", "view", {str(dataset.path)!r}]
sys.exit(main())
""")
    assert ended.returncode == 1
    assert one_line(ended.stderr)
    assert "pip install 'svfl[view]'" in ended.stderr
