"""Workers on a Ray cluster, one CPU each.

Every worker writes its files into the dataset's folder on its own machine. Where that is not the folder of whoever
started the collection, for want of a shared file system, the files are fetched.
"""

import logging
import os
import secrets
import signal
import socket
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import Any

from collectors.recording.worker import Collected, Deaths, Worker
from svfl_data.datasets.held_folder import identity
from svfl_data.errors import CollectError, SvflError
from svfl_data.system.atomic_io import write_atomically

LOOPBACK = "127.0.0.1"


@dataclass(frozen=True)
class Ray:
    """The executor; see `collectors.recording.worker.Executor`.

    Attributes:
        address: Of the cluster; without one, that of ``RAY_ADDRESS``, or a new one of this machine that listens on the
            loopback interface only.
        folder: Where workers write on their machines, if not where the dataset is.
    """

    address: str | None = None
    folder: Path | None = None

    def __call__(self, indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
        """Collect with actors."""
        with _signals_as_before():
            yield from self._collect(_connected(self.address), indices, workers, worker)

    def _collect(
        self,
        ray: Any,  # noqa: ANN401 - Ray's module
        indices: Sequence[int],
        workers: int,
        worker: Worker,
    ) -> Iterator[Collected]:
        here, there = worker.folder.resolve(), (self.folder or worker.folder).resolve()
        # One CPU also means OMP_NUM_THREADS=1, which Ray sets. A lost actor is replaced here, not by Ray, to say so.
        start = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(Actor).remote
        waiting, deaths = deque(indices), Deaths()
        actors = [start(replace(worker, folder=there, identity=None)) for _ in range(min(workers, len(waiting)))]
        running: dict[Any, tuple[Any, int]] = {}
        idle = list(actors)
        try:
            while waiting or running:
                while waiting and idle:
                    actor, index = idle.pop(), waiting.popleft()
                    running[actor.collect.remote(index)] = actor, index
                while idle:  # frees its CPU, for which a replacement may be waiting
                    ray.kill(idle.pop())
                (reference, *_), _ = ray.wait(list(running))
                actor, index = running.pop(reference)
                try:
                    collected: Collected = ray.get(reference)
                    for file in collected.files:
                        if not (here / file).exists():
                            _write(worker, here / file, ray.get(actor.content.remote(file)))
                except ray.exceptions.RayTaskError as error:
                    raise _cause(error) from None
                except ray.exceptions.RayError:
                    deaths.count("a Ray worker", [index])
                    waiting.appendleft(index)
                    actors.remove(actor)
                    actor = start(replace(worker, folder=there, identity=None))
                    actors.append(actor)
                else:
                    deaths.forget()
                    yield collected
                idle.append(actor)
        finally:
            for actor in actors:
                ray.kill(actor)


class Actor:
    """A worker that also hands out what it has written."""

    def __init__(self, worker: Worker) -> None:
        """Take over a worker, which will open its world in this process, and begin the folder on this machine."""
        worker.dataset()
        self._worker = replace(worker, identity=identity(worker.folder))

    def collect(self, index: int) -> Collected:
        """Make and write the episode of an index."""
        return self._worker.collect(index)

    def content(self, file: str) -> bytes:
        """The bytes of a file that was written here."""
        return (self._worker.folder / file).read_bytes()


def _connected(address: str | None) -> Any:  # noqa: ANN401 - Ray's module
    """Ray, connected to a cluster.

    Raises:
        CollectError: If Ray is not installed, or there is no such cluster.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # otherwise Ray reports to its makers
    address = address or os.environ.get("RAY_ADDRESS")
    started = sys.modules.get("ray")
    if started and started.is_initialized():
        return started
    if not address:
        _keep_to_this_machine()
    try:
        import ray
    except ModuleNotFoundError as error:
        raise CollectError("Ray is not installed here; run: pip install 'svfl[ray]'") from error
    if not address:
        ray._private.ray_constants.ENABLE_RAY_CLUSTER = False  # where Ray was imported before it could read of it
    options: dict[str, Any] = {"address": address} if address else {"address": "local", "_node_ip_address": LOOPBACK}
    try:
        if address and "://" not in address and ":" in address:
            host, _, port = address.rpartition(":")
            socket.create_connection((host, int(port)), timeout=10).close()  # Ray itself would try for minutes
        handler = signal.getsignal(signal.SIGTERM)
        ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR, **options)
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)  # Ray has put its own in its place
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        where = f"at {address}" if address else "on this machine"
        raise CollectError(f"no Ray cluster {where} ({str(error).splitlines()[0]})") from error
    return ray


def _keep_to_this_machine() -> None:
    """Have a cluster that is started here listen on the loopback interface alone, and obey only who knows its token.

    By itself Ray listens on every interface and obeys everybody. Its processes read these settings from their
    environment, the one that starts them when it imports Ray.
    """
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # the name is history: a cluster of one machine
    os.environ["RAY_AUTH_MODE"] = "token"
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))


@contextmanager
def _signals_as_before() -> Iterator[None]:
    """Have signals end a collection as they would end it without Ray.

    Ray has SIGTERM end the process with the wrong exit code and a dump of its stack. What a handler raises while Ray
    waits becomes a bare KeyboardInterrupt.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    raised: list[BaseException] = []

    def handle(number: int, frame: FrameType | None) -> None:
        usual = before[signal.Signals(number)]
        if not callable(usual):
            signal.signal(number, usual)
            os.kill(os.getpid(), number)
            return
        try:
            usual(number, frame)
        except BaseException as error:
            raised.append(error)
            raise

    for number, usual in before.items():
        if usual != signal.SIG_IGN:
            signal.signal(number, handle)
    try:
        yield
    except KeyboardInterrupt:
        if raised:
            raise raised[0] from None
        raise
    finally:
        for number, usual in before.items():
            signal.signal(number, usual)


def _cause(error: Any) -> Exception:  # noqa: ANN401 - Ray's RayTaskError
    """What was raised in a worker, without Ray's wrapping and traceback if it is a mistake of the user's."""
    return error.cause if isinstance(error.cause, SvflError) else error


def _write(worker: Worker, path: Path, content: bytes) -> None:
    worker.dataset("" if path.parent == worker.folder.resolve() else path.parent.name)  # begins the folder
    write_atomically(path, content)
