"""Provenance: what one start of a program leaves, in files that are read as those of a stranger."""

import json
import sys

import pytest

from svfl_data.errors import FormatError
from svfl_models.training import run_folder
from svfl_models.training.provenance import commit, record, session, words
from svfl_models.training.provenance.commit import Commit
from svfl_models.training.provenance.record import KEY, MOST, as_text, of_checkpoint, of_runs, of_text, recorded
from svfl_models.training.provenance.session import FROM_PYTHON, DataRecord, Host, Session, command_line
from tests.helpers.demonstrations import demonstrations
from tests.hostile.json_attributes import HIDDEN

EVIL = f"{HIDDEN}\n\x1b[2JFORGED <img src=x> [a](b) `c` \u202e"


def whole(text="x"):
    """A session all of whose texts are one."""
    host = Host(text, text, 2, text)
    data = {text: DataRecord(text, text[:64], 3, 1), "file": DataRecord(text, text[:64])}
    return Session(text, text, text[:64], False, {text: text}, host, text, (0, 1), data)


def test_a_session_tells_code_machine_data_and_command(tmp_path, monkeypatch):
    data = demonstrations(tmp_path / "data", 2)
    (tmp_path / "file").write_bytes(b"content")
    monkeypatch.setattr(session, "own_commit", lambda: Commit("a" * 40, False))
    monkeypatch.setattr(sys, "argv", ["/usr/bin/svfl-train", "bc", "--data", "my data"])
    found = session.session(
        {"data": session.dataset(data), "checkpoint": session.file(tmp_path / "file")}, [3], device="a GPU"
    )
    assert (found.commit, found.clean, found.seeds, found.device) == ("a" * 40, False, (3,), "a GPU")
    assert found.command == "svfl-train bc --data 'my data'"
    assert {"python", "numpy", "torch", "h5py"} <= found.packages.keys()
    assert found.host.name
    assert found.host.cores > 0
    assert found.data["data"].episodes == 2
    assert found.data["data"].path == str(data)
    assert found.data["checkpoint"].sha256 == "ed7002b439e9ac845f22357d822bac1444730fbdb6016d3ec9432297b9ec9f73"
    assert found.started.endswith("+00:00")


def test_without_a_gpu_the_processor_has_computed():
    found = session.session({})
    assert found.device == found.host.processor
    assert session.session({}, device="").device == ""


def test_what_cannot_be_found_out_fails_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(session, "own_commit", lambda: None)
    assert session.dataset(tmp_path / "no") == DataRecord(str(tmp_path / "no"))
    assert session.file(tmp_path) == DataRecord(str(tmp_path))
    assert (session.session({}).commit, session.session({}).clean) == ("", None)


def test_the_commit_is_that_of_this_source():
    """Whether there is one depends on where the tests run."""
    assert commit.own_commit() == commit.commit_of(commit.Path(commit.__file__).resolve().parents[3])


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        (["python", "-m", "x"], FROM_PYTHON),
        (["-c"], FROM_PYTHON),
        ([], FROM_PYTHON),
        (["/opt/bin/svfl-train", "latent", "--out", "a b"], "svfl-train latent --out 'a b'"),
        (["svfl-train", "--api-key", "hunter2", "--epochs", "2"], "svfl-train --api-key '***' --epochs 2"),
        (["svfl-train", "--wandb-token=hunter2", "x"], "svfl-train '--wandb-token=***' x"),
        (["svfl-train", "--password", "--epochs", "2"], "svfl-train --password --epochs 2"),
        (["svfl-train", "--data", "https://me:hunter2@example.org/d"], "svfl-train --data 'https://***@example.org/d'"),
        (["svfl-train", "--data", "\udc80\x1b"], r"svfl-train --data '\udc80\x1b'"),
    ],
)
def test_a_command_line_tells_nothing_secret(given, shown):
    assert command_line(given) == shown


def test_a_path_tells_nothing_secret():
    assert session.dataset("s3://key:hunter2@bucket/data").path == "s3://***@bucket/data"


def test_sessions_add_up_in_a_folder(tmp_path):
    assert recorded(tmp_path) == []
    assert record.record(tmp_path, whole("a")) == [whole("a")]
    assert record.record(tmp_path, whole("b")) == [whole("a"), whole("b")] == recorded(tmp_path)
    assert of_runs([tmp_path, tmp_path / "none"]) == [[whole("a"), whole("b")], []]


def test_of_very_many_the_first_and_the_latest_stay(tmp_path):
    few = json.loads(as_text([whole(str(number)) for number in range(MOST)]))
    (tmp_path / run_folder.PROVENANCE).write_text(json.dumps(few))
    found = record.record(tmp_path, whole("last"))
    assert len(found) == MOST == len(recorded(tmp_path))
    assert [one.started for one in (found[0], found[1], found[-1])] == ["0", "2", "last"]


def test_sessions_survive_every_way(tmp_path):
    sessions = [whole("a"), Session("b")]
    assert of_text(as_text(sessions), "here") == sessions
    assert of_checkpoint({KEY: record.plain(sessions)}, "here") == sessions
    assert of_checkpoint({}, "here") == []


BAD = {
    "a text": "x", "null": None, "a number": 3, "numbers": [1], "no time": [{}], "a list in a list": [[]],
    "a long text": [{"started": "x" * 10**6}], "a text for a number": [{"started": "", "host": {"cores": "2"}}],
    "many": [{"started": ""}] * (MOST + 1),
    "many packages": [{"started": "", "packages": dict.fromkeys(map(str, range(2000)), "")}],
    "escapes": [{"started": "", EVIL: 1, "clean": EVIL}],
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_provenance_is_one_line(name, tmp_path):
    content = {"format": "svfl-provenance", "format_version": "1.0", "sessions": BAD[name]}
    (tmp_path / run_folder.PROVENANCE).write_text(json.dumps(content))
    for read in (
        lambda: recorded(tmp_path),
        lambda: of_checkpoint({KEY: BAD[name]}, "here"),
        lambda: of_text(json.dumps(content), "here"),
    ):
        with pytest.raises(FormatError, match="provenance") as caught:
            read()
        assert str(caught.value).isprintable()
        assert len(str(caught.value)) < 1000


def test_a_tensor_in_its_place_is_one_line():
    import torch

    with pytest.raises(FormatError, match="provenance"):
        of_checkpoint({KEY: [{"started": torch.zeros(3)}]}, "here")


@pytest.mark.parametrize("content", [b"", b"\xff", b"[" * 10**5, b"[]", b'{"format": "other"}'])
def test_other_files_of_the_name_are_one_line(content, tmp_path):
    (tmp_path / run_folder.PROVENANCE).write_bytes(content)
    with pytest.raises(FormatError, match=run_folder.PROVENANCE):
        record.record(tmp_path, whole())
    assert of_runs([tmp_path]) == [[]]


def test_hostile_texts_are_shown_harmlessly():
    for line in words.lines(whole(EVIL)):
        assert line.isprintable()
    page = words.section(whole(EVIL), [[whole(EVIL)]])
    assert all(line.isprintable() for line in page.splitlines())
    told = [line for line in page.splitlines() if not line.startswith("      ")]  # but for the command, which is code
    assert not any(mark in line.replace("\\<", "").replace("\\[", "") for line in told for mark in ("<img", "[a]"))


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (Session("", commit="a" * 40, clean=True), f"commit {'a' * 12} (clean)"),
        (Session("", commit="a" * 40, clean=False), f"commit {'a' * 12} (not clean)"),
        (Session("", commit="a" * 40), f"commit {'a' * 12} (not known whether clean)"),
        (Session(""), "no git commit"),
    ],
)
def test_a_dirty_tree_is_said(found, said):
    assert words.software(found).startswith(said)
    assert said in words.section(found).replace("\\", "")


def test_a_page_counts_runs_by_what_made_them():
    one, other = whole("a"), Session("t", commit="b" * 40, clean=True)
    page = words.section(None, [[one], [one], [other], [one, other], []])
    assert page.count("- 3 runs: commit a ") == 1
    assert page.count(f"- 2 runs: commit {'b' * 12} ") == 1
    assert "- 1 run: unknown provenance" in page
