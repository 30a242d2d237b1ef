"""Executor that runs workers on a Ray cluster, with one CPU each.

Every worker writes its files into the dataset's folder on its own machine. Where there is no shared file system, the
process that started the collection fetches the files into the dataset's folder on its own machine.
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
    """Executor on a Ray cluster; see `collectors.recording.worker.Executor`.

    Attributes:
        address: Address of the cluster. None takes the address in ``RAY_ADDRESS``, or else starts a new cluster on this
            machine that listens on the loopback interface only.
        folder: Folder that workers write to on their machines. None takes the path of the dataset's folder.
    """

    address: str | None = None
    folder: Path | None = None

    def __call__(self, indices: Sequence[int], workers: int, worker: Worker) -> Iterator[Collected]:
        """Collect episodes with Ray actors.

        Args:
            indices: Indices of the episodes to collect.
            workers: Number of actors that run at a time.
            worker: Worker that each actor runs.

        Yields:
            The report of each episode that is finished and on disk here, in order of completion.

        Raises:
            CollectError: If Ray is not installed, there is no such cluster, or workers keep dying.
            SvflError: If a collector raises one, which is passed on.
        """
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
        # One CPU also means OMP_NUM_THREADS=1, which Ray sets. A lost actor is replaced here, not by Ray, so that it is
        # reported.
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
                while idle:  # an idle actor is ended to free its CPU, for which a replacement may be waiting
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
    """Ray actor that runs a worker and returns the content of the files that the worker has written."""

    def __init__(self, worker: Worker) -> None:
        """Take over a worker, which will open its world in this process, and create the dataset on this machine.

        Args:
            worker: Worker to run.
        """
        worker.dataset()
        self._worker = replace(worker, identity=identity(worker.folder))

    def collect(self, index: int) -> Collected:
        """Make and write the episode of an index, and return the report of it."""
        return self._worker.collect(index)

    def content(self, file: str) -> bytes:
        """Return the bytes of a file that the worker has written; `file` is relative to the dataset's folder."""
        return (self._worker.folder / file).read_bytes()


def _connected(address: str | None) -> Any:  # noqa: ANN401 - Ray's module
    """Return the module Ray, connected to a cluster.

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
        ray._private.ray_constants.ENABLE_RAY_CLUSTER = False  # if Ray was imported before it could read this
    options: dict[str, Any] = {"address": address} if address else {"address": "local", "_node_ip_address": LOOPBACK}
    try:
        if address and "://" not in address and ":" in address:
            host, _, port = address.rpartition(":")
            socket.create_connection((host, int(port)), timeout=10).close()  # Ray itself would try for minutes
        handler = signal.getsignal(signal.SIGTERM)
        ray.init(include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR, **options)
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, handler)  # restores the handler that Ray has replaced
    except (OSError, ValueError, RuntimeError, ray.exceptions.RayError) as error:
        where = f"at {address}" if address else "on this machine"
        raise CollectError(f"no Ray cluster {where} ({str(error).splitlines()[0]})") from error
    return ray


def _keep_to_this_machine() -> None:
    """Make a cluster that is started here listen on the loopback interface alone, and require its token.

    By default Ray listens on every interface and accepts every client. Ray's processes read these settings from their
    environment, and the process that starts them reads the settings when it imports Ray.
    """
    os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"  # despite the name, 0 means a cluster of one machine
    os.environ["RAY_AUTH_MODE"] = "token"
    os.environ.setdefault("RAY_AUTH_TOKEN", secrets.token_hex(32))


@contextmanager
def _signals_as_before() -> Iterator[None]:
    """Make signals end a collection as they would end it without Ray.

    With Ray alone, SIGTERM ends the process with the wrong exit code and a dump of its stack, and what a handler raises
    while Ray waits becomes a bare KeyboardInterrupt.
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
    """Return the error that a worker raised, without Ray's wrapping and traceback if it is a mistake of the user's."""
    return error.cause if isinstance(error.cause, SvflError) else error


def _write(worker: Worker, path: Path, content: bytes) -> None:
    worker.dataset("" if path.parent == worker.folder.resolve() else path.parent.name)  # creates the folder if needed
    write_atomically(path, content)
