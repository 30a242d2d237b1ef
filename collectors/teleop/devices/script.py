"""Input logs: what a session was told, line by line, and the device that tells it again.

The first line says what it is. Every other line is a tick from which on something is new, counted from the start of
the session: ``input`` (the five numbers of `Device.read`, which hold until the next one) or ``commands``, or both:

    {"format": "svfl-teleop-log", "version": 1, "device": "keyboard", "task": "block_picking", "seed": 0}
    {"tick": 0, "input": [1, 0, 0, 0, 0], "commands": ["start"]}
    {"tick": 40, "input": [1, 0, 0, -1, 0]}
    {"tick": 75, "commands": ["quit"]}
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.teleop.devices.device import Command, Device, reading
from svfl_data.errors import FormatError, StorageError
from svfl_data.system.side_files import parse_json

FORMAT, VERSION = "svfl-teleop-log", 1


class InputLog:
    """Writes the log of a session while it goes on.

    Args:
        path: The file; replaced if it exists.
        about: What else its first line shall say.

    Raises:
        StorageError: If it cannot be written.
    """

    def __init__(self, path: Path, **about: Any) -> None:  # noqa: ANN401 - JSON values
        self._last: list[float] | None = None
        self._tick = 0
        try:
            self._file = path.open("w", encoding="utf-8")
        except OSError as error:
            raise StorageError(f"cannot write {path}: {error.strerror}") from error
        self._line({"format": FORMAT, "version": VERSION, **about})

    def append(self, values: NDArray[np.float32], commands: Sequence[Command]) -> None:
        """Add what was told in one tick."""
        now = values.tolist()
        line: dict[str, Any] = {"tick": self._tick}
        if now != self._last:
            line["input"] = self._last = now
        if commands:
            line["commands"] = list(commands)
        if len(line) > 1:
            self._line(line)
        self._tick += 1

    def _line(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line) + "\n")
        self._file.flush()  # a killed session leaves what it was told

    def close(self) -> None:
        """End it, so that a session of the script ends here too."""
        self._line({"tick": self._tick, "commands": [Command.QUIT]})
        self._file.close()


class Script(Device):
    """Tells what a log says, tick by tick, then quits.

    Args:
        path: The log.

    Raises:
        FormatError: If it is not one.
    """

    def __init__(self, path: Path) -> None:
        try:
            lines = [parse_json(line, path) for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
            head, lines = lines[0], lines[1:]
            if head["format"] != FORMAT or head["version"] != VERSION:
                raise FormatError(f"{path}: first line says {head}; expected {FORMAT!r}, version {VERSION}")
            self._inputs = {line["tick"]: _five(line["input"]) for line in lines if "input" in line}
            self._commands = {
                line["tick"]: [Command(name) for name in line["commands"]] for line in lines if "commands" in line
            }
        except OSError as error:
            raise FormatError(f"{path}: {error.strerror}") from error
        except (ValueError, LookupError, TypeError) as error:
            raise FormatError(
                f"{path}: not an input log, as svfl-collect teleop --log writes them ({error})"
            ) from error
        self._end = max([-1, *self._inputs, *self._commands])
        self._now = reading(1.0, 0.0, 0.0, 0.0, 0.0)
        self._tick = -1
        self.name = f"script of {head.get('device', 'nobody')}"

    def read(self) -> NDArray[np.float32]:
        """The next tick's input."""
        self._tick += 1
        self._now = self._inputs.get(self._tick, self._now)
        return self._now

    def commands(self) -> list[Command]:
        """The same tick's commands."""
        return [Command.QUIT] if self._tick > self._end else self._commands.get(self._tick, [])


def _five(values: Sequence[float]) -> NDArray[np.float32]:
    array = np.asarray(values, np.float32)
    if array.shape != (5,) or not np.isfinite(array).all():
        raise ValueError(f"an input is five finite numbers, got {values}")
    return array
