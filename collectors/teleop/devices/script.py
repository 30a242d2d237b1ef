"""Input logs with the inputs and commands of a session, line by line, and the device that replays such a log.

The first line identifies the log. Every other line is a tick, counted from the start of the session, from which on
something is new: ``input`` (the five numbers of `Device.read`, which hold until the next ``input``) or ``commands``, or
both:

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
    """Log of the inputs of a session, which is written while the session goes on.

    Args:
        path: Path of the log file, which is replaced if it exists.
        about: Facts that the first line of the log stores in addition.

    Raises:
        StorageError: If the file cannot be written.
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
        """Add the inputs of one tick to the log, which stores only what has changed.

        Args:
            values: Reading of the device, (5,).
            commands: Commands given in this tick.
        """
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
        self._file.flush()  # the log of a killed session holds all inputs up to then

    def close(self) -> None:
        """End the log with a command to quit, so that a session that replays the log also ends here."""
        self._line({"tick": self._tick, "commands": [Command.QUIT]})
        self._file.close()


class Script(Device):
    """Device that replays the readings and commands of a log tick by tick, and then quits.

    Args:
        path: Path of the log file.

    Raises:
        FormatError: If the file is not an input log, or cannot be read.
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
        """Return the reading of the next tick, (5,)."""
        self._tick += 1
        self._now = self._inputs.get(self._tick, self._now)
        return self._now

    def commands(self) -> list[Command]:
        """Return the commands of the tick that was last read."""
        return [Command.QUIT] if self._tick > self._end else self._commands.get(self._tick, [])


def _five(values: Sequence[float]) -> NDArray[np.float32]:
    array = np.asarray(values, np.float32)
    if array.shape != (5,) or not np.isfinite(array).all():
        raise ValueError(f"an input is five finite numbers, got {values}")
    return array
