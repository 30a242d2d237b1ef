"""Running a command on a hostile dataset, and the laws of how it may end."""

import contextlib
import functools
import json
import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

from tests.hostile import sound
from tests.hostile.commands import Command
from tests.hostile.kind import Kind, build_outside, payload
from tests.hostile.laws import Ended, endings, hidden_characters, leaked, outputs
from tests.hostile.urdfs import arm

MODELS = frozenset(
    {"centering.ckpt", "bc.ckpt", "latent.ckpt", "policy.pt2", "buffer.replay", "bc.ckpt_run", "latent.ckpt_run"}
)
"""Concerns that stand beside the dataset."""
HANG_S = float(os.environ.get("SVFL_HOSTILE_HANG_S", "30"))
"""A command hangs that stands still for so long: it neither computes nor waits for the processor."""
CPU_S = 10.0
MEMORY_BYTES = 200 * 2**20
LOOKED_AT = 64 * 2**20
"""Most bytes of a written file that are searched for the secret."""
ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "RAYON")}


class Zygote:
    """`tests.hostile.zygote` in a process of its own, started when it is first needed."""

    def __init__(self, kind: str, home: Path) -> None:
        self.kind, self.home = kind, home
        self.process: subprocess.Popen | None = None

    def run(self, words: list[str], folder: Path, out: Path, err: Path) -> dict:
        """Run a command in a folder; says how it ended."""
        environment = {"CI": "1", "HOME": str(self.home), "TMPDIR": str(folder / "tmp"), "COLUMNS": "200"}
        request = {"words": words, "folder": str(folder), "out": str(out), "err": str(err), "seconds": HANG_S}
        line = json.dumps(request | {"environment": environment}) + "\n"
        for _ in range(2):  # the first may have been ended from outside, as by a system out of memory
            process = self.process or self._start()
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(line)
                process.stdin.flush()
                if answer := process.stdout.readline():
                    return json.loads(answer)
            self.process = None
        raise RuntimeError(f"{words}: the process that forks commands ended twice, with {process.wait()}")

    def _start(self) -> subprocess.Popen:
        environment = {**os.environ, **ONE_THREAD, "CI": "1", "HOME": str(self.home), "MPLBACKEND": "agg"}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.hostile.zygote", self.kind],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment,
            cwd=Path(__file__).parents[2],
        )  # fmt: skip
        assert json.loads(self.process.stdout.readline())["ready"]
        return self.process

    def close(self) -> None:
        """End it."""
        if self.process:
            self.process.stdin.close()
            self.process.wait()


class Campaign:
    """A place for boxes (`tests.hostile.kind`), and the processes that run commands in them."""

    def __init__(self, place: Path, sound: Path) -> None:
        """Begin.

        Args:
            place: An empty folder.
            sound: A sound dataset.
        """
        self.sound, self.box, self.template = sound, place / "box", place / "template"
        self.zygotes = {kind: Zygote(kind, place / "home") for kind in ("light", "heavy")}
        (place / "home").mkdir()
        self.peaks: dict[str, int] = {}
        self.cpu_s: dict[str, float] = {}

    @functools.cached_property
    def simulated(self) -> Path:
        """A dataset that the simulation has recorded."""
        return sound.simulated_dataset(self.box.with_name("simulated"))

    @functools.cached_property
    def models(self) -> Path:
        """Trained networks."""
        return sound.sound_models(self, self.box.with_name("sound_models"))

    def close(self) -> None:
        """End the processes."""
        for zygote in self.zygotes.values():
            zygote.close()

    def prepare(self, kind: Kind | None) -> None:
        """Make the hostile dataset once; every command gets a copy of it under the same path."""
        concern = kind.concern if kind else ""
        models = self.models if concern in MODELS else None  # making them needs the box too
        data = self.simulated if concern == "config" else self.sound
        for folder in (self.box, self.template):
            _remove(folder)
        self.box.mkdir()
        build_outside(self.box)
        for name in ("out", "tmp"):
            (self.box / name).mkdir()
        _copy(data, self.box / "data")
        if models:
            _copy(models, self.box / "models")
        if kind is not None:
            here = os.getcwd()
            os.chdir(self.box)
            try:
                kind.make(self.box / "data")
            finally:
                os.chdir(here)
        _remove(self.box / "models")
        os.rename(self.box, self.template)

    def _place_models(self, folder: Path, command: Command) -> None:
        if "urdf" in command.reads:
            (folder.parent / "arm.urdf").write_text(arm())
        for concern in command.reads & MODELS:
            source = folder.parent / "models" / concern.replace(".ckpt_run", "_run")
            _copy(source, folder.parent / ("out/made" if concern.endswith("_run") else concern))

    def run(self, command: Command) -> Ended:
        """Run a command on a fresh copy of what was prepared."""
        _remove(self.box)
        _copy(self.template, self.box)
        out, err = self.box / "stdout", self.box / "stderr"
        zygote = self.zygotes["heavy" if command.heavy else "light"]
        found = zygote.run(list(command.words), self.box, out, err)
        return Ended(out=_begin(out), err=_begin(err), **found)

    def baseline(self, command: Command) -> Ended:
        """What a command does on sound files, its memory noted."""
        self.prepare(Kind("sound", next(iter(command.reads)), lambda folder: self._place_models(folder, command)))
        ended = self.run(command)
        self.peaks[command.name], self.cpu_s[command.name] = ended.peak_bytes, ended.cpu_s
        return ended

    def attack(self, kind: Kind, command: Command) -> tuple[Ended, list[str]]:
        """Run a command on the prepared kind; returns how it ended and which laws it broke, in words."""
        before = _listing(self.template)
        ended = self.run(command)
        broken = [*endings(ended, command, kind), *outputs(ended, command)]
        allowed = 2 * (_size(self.template) - _size(self.template / "outside")) + MEMORY_BYTES
        excess = ended.peak_bytes - self.peaks.get(command.name, 0)
        if excess > allowed:
            broken.append(f"memory: {excess / 2**20:.0f} MB above a sound dataset's, {allowed / 2**20:.0f} allowed")
        if ended.cpu_s > CPU_S + self.cpu_s.get(command.name, 0.0):
            broken.append(f"time: {ended.cpu_s:.1f} s of processor time")
        return ended, broken + list(self._changes(before, ended, command))

    def _changes(self, before: dict[str, tuple], ended: Ended, command: Command):
        """What was written where it should not be, and what stands in what was written."""
        if payload(self.box / "data").exists():
            yield "payload: code of the file was run"
        after = _listing(self.box)
        changed = [name for name in after if before.get(name) != after[name]]
        for name in [*changed, *(before.keys() - after.keys())]:
            place, _, inner = name.partition("/")
            own = place in ("out", "tmp") or name in ("stdout", "stderr", ".", "")
            index = name in ("data/index.jsonl", "data") and not (self.box / name).is_symlink()
            if place == "outside":
                yield f"written: {name} outside the dataset"
            elif not own and not index and not (command.changes and place == "data"):
                yield f"written: {name}"
            if ended.code and place == "out" and (".part" in inner or inner.rpartition("/")[2].startswith(".")):
                yield f"left: {name}"
        for name in changed:
            path = self.box / name
            if path.is_file() and not path.is_symlink() and name not in ("stdout", "stderr"):
                content = _begin(path)
                before_it = self.template / name
                if name.startswith("data/") and before_it.is_file() and leaked(_begin(before_it)):
                    continue  # the attacker had it already
                if trace := leaked(content):
                    yield f"leak: {name} holds {trace!r}"
                text = content.replace(b"\r\n", b"\n") if path.suffix == ".csv" else content  # RFC 4180
                if path.suffix in (".md", ".csv", ".txt", ".html") and (hidden := hidden_characters(text)):
                    yield f"hidden characters in {name}: {hidden}"


def targets(kind: Kind, commands: Iterable[Command]) -> list[Command]:
    """The commands that a kind is tried on: of a model, those that read it; else all that are given a dataset.

    Rerun asks an importer about files that are there only, and the episodes of a shard are none.
    """
    special = MODELS | {"config", "urdf"}
    if kind.concern in special:
        return [one for one in commands if kind.concern in one.reads]
    able = [one for one in commands if not one.reads & special]
    return [one for one in able if one.name != "importer"] if kind.concern == "shard" else able


def in_turn(number: int, kind: Kind, commands: Iterable[Command], turns: int) -> list[Command]:
    """A few of the commands for a kind, those first that must refuse it; others for the next kind."""
    able = targets(kind, commands)
    able = [one for one in able if not one.may_succeed(kind)] or able
    return [able[(number * turns + turn) % len(able)] for turn in range(min(turns, len(able)))]


def _begin(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(LOOKED_AT)


def _copy(source: Path, target: Path) -> None:
    subprocess.run(["cp", "-a", "--sparse=auto", source, target], check=True)


def _remove(folder: Path) -> None:
    if folder.exists():
        subprocess.run(["rm", "-rf", folder], check=True)


def _listing(box: Path) -> dict[str, tuple]:
    """Every entry by its path: kind, size and time of change; folders without their times but those of the user."""
    found: dict[str, tuple] = {}
    for root, folders, files in os.walk(box):
        place = os.path.relpath(root, box)
        for name in (*folders, *files):
            at = os.lstat(os.path.join(root, name))
            path = os.path.normpath(os.path.join(place, name))
            folder = os.path.isdir(os.path.join(root, name)) and not os.path.islink(os.path.join(root, name))
            found[path] = (at.st_mode,) if folder else (at.st_mode, at.st_size, at.st_mtime_ns)
    return found


def _size(folder: Path) -> int:
    """What a dataset takes on disk: holes of a sparse file are no content."""
    total = 0
    for root, _, files in os.walk(folder):
        total += sum(
            min(at.st_size, at.st_blocks * 512) for name in files if (at := os.lstat(os.path.join(root, name)))
        )
    return total
