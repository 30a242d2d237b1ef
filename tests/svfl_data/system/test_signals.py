"""A command that is told to end, ends as after Ctrl-C: in order, and with all that it has started."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from svfl_data.system import command_line
from tests.helpers.child import exit_code, fork
from tests.helpers.patience import PATIENCE

COMMAND = """
import os, signal, subprocess, sys, time
from svfl_data.system import command_line

def work():
    child = subprocess.Popen([sys.executable, "-c", "import time; print('ready', flush=True); time.sleep(600)"])
    try:
        child.wait()
    finally:
        child.kill()
        print("in order", child.wait(), flush=True)

sys.exit(command_line.run(work, "svfl-data view"))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_was_started_ends_too(number):
    command = subprocess.Popen(
        [sys.executable, "-c", COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert command.stdout.readline() == "ready\n"
    command.send_signal(number)
    said, complaint = command.communicate(timeout=PATIENCE)
    assert said == "in order -9\n"
    assert complaint == "svfl-data view: interrupted; everything finished so far is on disk\n"
    assert command.returncode == 128 + number


def test_nohup_is_respected():
    words = "import os, signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)" + COMMAND.replace(
        "child = subprocess", "os.kill(os.getpid(), signal.SIGHUP); return print('alive'); child = subprocess"
    )
    done = subprocess.run([sys.executable, "-c", words], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "alive\n")


@pytest.fixture
def _default_handlers():
    """Libraries that an earlier test has used, such as Ray, may have left handlers of theirs."""
    before = {number: signal.signal(number, signal.SIG_DFL) for number in (signal.SIGTERM, signal.SIGHUP)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("_default_handlers")
def test_a_forked_child_is_ended_as_usual():
    def work():
        told, tell = os.pipe()

        def wait_for_ever() -> int:
            os.write(tell, b"!")  # before that, Python drops the signals of its parent
            while True:
                time.sleep(0.01)

        child = fork(wait_for_ever)
        os.read(told, 1)
        os.kill(child, signal.SIGTERM)
        assert exit_code(child) == -signal.SIGTERM

    assert command_line.run(work, "svfl") == 0


@pytest.mark.usefixtures("_default_handlers")
def test_signals_are_as_before_afterwards_and_threads_may_run_commands():
    codes = []
    thread = threading.Thread(target=lambda: codes.append(command_line.run(lambda: None, "svfl")))
    thread.start()
    thread.join()
    codes.append(command_line.run(lambda: None, "svfl"))
    assert codes == [0, 0]
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
