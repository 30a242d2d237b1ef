"""A process that has imported everything once and forks a child per command: a start costs milliseconds, and memory.

Started as ``python -m tests.hostile.zygote light`` (or ``heavy``, with torch and the simulation). It reads one request
per line (JSON) and answers each with one line: how the command ended, its CPU time and its peak memory.
"""

import contextlib
import json
import os
import resource
import select
import signal
import sys
import time
import traceback
from pathlib import Path

GUARD_BYTES = 4 * 2**30
"""Anonymous memory a command may take beyond what it began with, so that an attack does not take the machine along."""
GUARD_CPU_S = 60
GUARD_FILE_BYTES = 2**30


def preload(kind):
    """Import what commands import, so that only their own work is measured."""
    import matplotlib.figure
    import rerun  # noqa: F401

    figure = matplotlib.figure.Figure()
    figure.subplots().set_title("fonts are found once")
    figure.savefig(os.devnull, format="png")
    if kind == "heavy":
        pass


def main():
    preload(sys.argv[1])
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # nothing but answers goes to the test
    print(json.dumps({"ready": os.getpid()}), file=answers, flush=True)
    for line in sys.stdin:
        print(json.dumps(serve(json.loads(line))), file=answers, flush=True)


def serve(request):
    """Run one command in a child of its own and say what it took."""
    child = os.fork()
    if child == 0:
        become(request)
    ended = ends(child, request["seconds"])
    if not ended:
        os.killpg(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what it has left behind
    return {
        "code": os.waitstatus_to_exitcode(status),
        "hung": not ended,
        "cpu_s": used.ru_utime + used.ru_stime,
        "peak_bytes": used.ru_maxrss * 1024,
    }


def ends(child, seconds):
    """Wait for a process; false once it and its descendants have stood still, neither working nor waiting for work.

    What is counted is standing still, not time: on a machine under load a command may take long without hanging.
    """
    descriptor, busy, still = os.pidfd_open(child), -1, 0
    try:
        while not select.select([descriptor], [], [], 1.0)[0]:
            now = work_of(child)
            busy, still = now, still + 1 if now == busy else 0
            if still >= seconds:
                return False
    finally:
        os.close(descriptor)
    return True


def work_of(child):
    """Processor time of a process and its descendants so far; what is ready to run counts as if it had run."""
    found = {}
    for entry in os.listdir("/proc"):
        with contextlib.suppress(OSError, ValueError):
            state, parent, *rest = Path("/proc", entry, "stat").read_text().rpartition(") ")[2].split()
            found[int(entry)] = int(parent), state, int(rest[9]) + int(rest[10])
    family = {child}
    while more := {pid for pid, (parent, _, _) in found.items() if parent in family} - family:
        family |= more
    ready = any(found[pid][1] in "RD" for pid in family & found.keys())
    return time.monotonic() if ready else sum(found[pid][2] for pid in family & found.keys())


def become(request):
    """Be the command, with its output in files; does not return."""
    code = 70
    try:
        os.setsid()
        fresh = os.O_RDWR | os.O_CREAT | os.O_TRUNC
        for number, name, flags in (
            (0, os.devnull, os.O_RDONLY),
            (1, request["out"], fresh),
            (2, request["err"], fresh),
        ):
            os.dup2(os.open(name, flags, 0o600), number)
        status = Path("/proc/self/status").read_text()
        taken = int(status.partition("VmData:")[2].split()[0]) * 1024
        for limit, value in ((resource.RLIMIT_DATA, taken + GUARD_BYTES), (resource.RLIMIT_CPU, GUARD_CPU_S),
                             (resource.RLIMIT_FSIZE, GUARD_FILE_BYTES), (resource.RLIMIT_CORE, 0)):  # fmt: skip
            resource.setrlimit(limit, (value, resource.getrlimit(limit)[1]))
        os.chdir(request["folder"])
        os.environ.update(request["environment"])
        from tests.hostile.programs import PROGRAMS

        sys.argv = [request["words"][0], *request["words"][1:]]
        code = PROGRAMS[request["words"][0]]()
    except SystemExit as asked:
        code = asked.code if isinstance(asked.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        leave(code)


def leave(code):
    """End as an interpreter does: helpers of multiprocessing first, then what is still in the buffers."""
    try:
        from multiprocessing.util import _exit_function

        _exit_function()
        sys.stdout.flush()
        sys.stderr.flush()
    except BaseException:
        traceback.print_exc()
        code = 120
    finally:
        os._exit(code or 0)


if __name__ == "__main__":
    main()
