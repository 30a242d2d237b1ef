"""A virtual display, and somebody who types on it: real key events, sent by xdotool to a window under Xvfb."""

import json
import math
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from collectors.simulation.camera import CAMERAS, calibration
from collectors.simulation.config import WorldConfig
from collectors.teleop.action_mapper import ActionMapper
from collectors.teleop.devices.device import Command
from svfl_data.schema.action_fields import planar_action
from tests.helpers.patience import PATIENCE

PACE = 0.5
CONFIG = WorldConfig()
BOUND = np.array([CONFIG.max_move] * 3 + [CONFIG.max_turn])
FULL = (PACE * BOUND * [1, 1, 1, 0.5]).tolist()  # what a held key moves in a tick, x, y, z [m], yaw [rad]
KEYS = (("s", "w"), ("d", "a"), ("e", "q"), ("Left", "Right"))  # towards larger and smaller x, y, z, yaw

needs_display = pytest.mark.skipif(
    not (shutil.which("Xvfb") and shutil.which("xdotool")), reason="needs Xvfb and xdotool (.ci/apt-packages.txt)"
)


@contextmanager
def display() -> Iterator[str]:
    """A display of its own."""
    read, write = os.pipe()
    command = ["Xvfb", "-displayfd", str(write), "-screen", "0", "1280x800x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    try:
        with os.fdopen(read) as answer:
            yield f":{answer.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


def wait_for(condition: Callable[[], bool], process: subprocess.Popen, seconds: float = PATIENCE) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, f"it ended: {process.communicate()}"
        assert time.monotonic() < end, "it takes too long"
        time.sleep(0.02)


class Typist:
    """Steers by what the input log says has arrived, since a busy machine may be late with everything."""

    def __init__(self, display: str, log: Path, process: subprocess.Popen) -> None:
        self._environment = os.environ | {"DISPLAY": display}
        self._log, self._process = log, process

    def xdotool(self, *words: str) -> str:
        done = subprocess.run(["xdotool", *words], env=self._environment, capture_output=True, text=True, check=True)
        return done.stdout

    def lines(self) -> list[dict]:
        text = self._log.read_text() if self._log.exists() else ""
        return [json.loads(line) for line in text.split("\n")[1:-1]]

    def tell(self, key: str, command: Command) -> None:
        """Press a key and wait until the session has got the command."""
        count = sum(command in line.get("commands", ()) for line in self.lines())
        self.xdotool("key", key)
        wait_for(lambda: sum(command in line.get("commands", ()) for line in self.lines()) > count, self._process)

    def grip(self) -> None:
        opening = self.inputs()[-1][1][0]
        self.xdotool("key", "space")
        wait_for(lambda: self.inputs()[-1][1][0] != opening, self._process)

    def inputs(self) -> list[tuple[int, list[float]]]:
        return [(line["tick"], line["input"]) for line in self.lines() if "input" in line]

    def at(self) -> np.ndarray:
        """Where the hand has been told to be: x, y, z [m], yaw [rad]."""
        start = next(line["tick"] for line in self.lines() if Command.START in line.get("commands", ()))
        mapper = ActionMapper(
            planar_action(CONFIG.max_move, CONFIG.max_turn), calibration(CAMERAS["front"]).image_axes, PACE
        )
        told, target = dict(self.inputs()), np.array([*CONFIG.home, 0.0])
        now = told[0]
        for tick in range(max(told) + 8):
            now = told.get(tick, now)
            if tick > start:
                target += mapper.action(np.array(now, np.float32))[1:]
        return target

    def go(self, component: int, goal: float, near: float) -> None:
        """Hold the right key for most of the way, again and again, at last in fine mode."""
        while abs(left := goal - float(self.at()[component])) > near:
            fine = abs(left) < 6 * FULL[component]
            ticks = 0.8 * abs(left) / FULL[component] * (4 if fine else 1) - 1
            keys = ["shift"] * fine + [KEYS[component][left < 0]]
            for key in keys:
                self.xdotool("keydown", key)
            wait_for(lambda: any(self.inputs()[-1][1][1:]), self._process)
            time.sleep(max(0.0, 0.05 * math.floor(ticks)))
            for key in reversed(keys):
                self.xdotool("keyup", key)
            wait_for(lambda: not any(self.inputs()[-1][1][1:]), self._process)
