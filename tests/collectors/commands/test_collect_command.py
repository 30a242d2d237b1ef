"""``svfl-collect``: reproducible with any number of workers, killed and resumed, and clear about mistakes."""

import os
import re
import resource
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from pathlib import Path

import pytest

from svfl_data.datasets.dataset import Dataset
from tests.helpers.collecting import collect, command, contents
from tests.helpers.patience import PATIENCE

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[3]
SAMPLES = 24  # a second's work for two workers: long enough to be stopped in the middle


@pytest.fixture(scope="module")
def collected(tmp_path_factory):
    folder = tmp_path_factory.mktemp("collected") / "centering"
    done = collect("centering", "--episodes", SAMPLES, "--workers", 1, "--out", folder)
    assert done.returncode == 0, done.stderr
    assert f"{folder}: {SAMPLES} samples" in done.stdout
    assert "rejected attempts: " in done.stdout
    return folder


def test_two_workers_give_the_same_bytes_as_one(collected, tmp_path):
    done = collect("centering", "--episodes", SAMPLES, "--workers", 2, "--out", tmp_path / "two")
    assert done.returncode == 0, done.stderr
    assert contents(tmp_path / "two") == contents(collected)


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGKILL, -signal.SIGKILL), (signal.SIGINT, 130)])
def test_a_stopped_collector_is_resumed_by_the_same_command(collected, tmp_path, sent, code):
    folder = tmp_path / "stopped"
    arguments = ("centering", "--episodes", SAMPLES, "--workers", 2, "--out", folder)
    for _ in range(5):  # on a busy machine it may have ended before it is told to
        shutil.rmtree(folder, ignore_errors=True)
        running = subprocess.Popen(
            command(*arguments), cwd=ROOT, start_new_session=True, stderr=subprocess.PIPE, stdout=subprocess.PIPE,
            text=True,
        )  # fmt: skip
        while running.poll() is None and not list(folder.glob("*.hdf5")):
            time.sleep(0.01)
        with suppress(ProcessLookupError):
            os.killpg(running.pid, sent)
        _, errors = running.communicate(timeout=PATIENCE)
        if running.returncode:
            break
    assert running.returncode == code
    assert "Traceback" not in errors
    whole = contents(folder)
    assert {name: content for name, content in whole.items() if name.endswith("hdf5")}.items() <= contents(
        collected
    ).items()
    assert len(Dataset.open(folder)) < SAMPLES
    done = collect(*arguments)
    assert done.returncode == 0, done.stderr
    assert contents(folder) == contents(collected)


def test_a_full_disk_is_one_clear_line(tmp_path):
    def no_room():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = collect("centering", "--episodes", 3, "--workers", 2, "--out", tmp_path / "full", preexec_fn=no_room)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "cannot write" in done.stderr
    assert "File too large" in done.stderr
    assert [file.name for file in (tmp_path / "full").iterdir()] == ["dataset.json"]


def test_another_dataset_is_refused(collected):
    before = contents(collected)
    done = collect("centering", "--episodes", SAMPLES, "--seed", 1, "--out", collected)
    assert done.returncode == 1
    assert re.search("seed .*0.* 1", done.stderr)
    assert done.stderr.count("\n") == 1
    assert contents(collected) == before


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (
            ["juggling", "--out", "x"],
            "no command 'juggling'; possible are expert, centering, policy, replay, ",
        ),
        (["centering", "--episodes", "0", "--out", "x"], "--episodes.* '0' .*at least 1"),
        (["centering", "--episodes", "many", "--out", "x"], "--episodes.* 'many'"),
        (["centering", "--workers", "-1", "--out", "x"], "--workers.* '-1' .*at least 1"),
        (["centering", "--seed", "-1", "--out", "x"], "--seed.* '-1' .*at least 0"),
        (["centering", "--border", "50", "--out", "x"], "--border.* '50' .*0 and 40"),
        (["centering", "--sensor-noise", "loud", "--out", "x"], "--sensor-noise.* 'loud'"),
        (
            ["centering", "--cameras", "front,back", "--out", "x"],
            "camera 'back'.* front, top, side_left",
        ),
        (["centering", "--robot", "abacus", "--out", "x"], "no robot 'abacus'; .* panda_sim, ur5e_sim"),
        (["replay", "x", "--robot", "abacus"], "no robot 'abacus'; .* panda_sim, ur5e_sim"),
        (["centering", "--address", "here:1", "--out", "x"], "--address here:1 .*--executor ray"),
        (["centering"], "--out"),
        ([], "COMMAND"),
    ],
)
def test_wrong_arguments_are_one_line_and_code_2(arguments, facts):
    done = collect(*arguments)
    assert done.returncode == 2
    assert re.search(facts, done.stderr)
    assert done.stderr.count("\n") == 1


def test_help_shows_an_example():
    for arguments in (["--help"], ["centering", "--help"]):
        done = collect(*arguments)
        assert done.returncode == 0
        assert "svfl-collect centering --episodes 200" in done.stdout
