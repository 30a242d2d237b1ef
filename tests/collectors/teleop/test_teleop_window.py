"""``svfl-collect teleop`` with a real window: a person's keys, sent to it by the display, pick a block."""

import os
import subprocess

import numpy as np
import pytest

from collectors.simulation.world import World
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.gripper import nearest_turn
from collectors.tasks.task import attempt_seed
from collectors.teleop.clock import Clock
from collectors.teleop.devices.device import Command
from collectors.teleop.devices.script import Script
from collectors.teleop.screen import NoScreen
from collectors.teleop.session import Session
from collectors.teleop.setting import ATTEMPT, Teleoperation
from svfl_data.checks import check_episode
from svfl_data.datasets.dataset import Dataset
from tests.helpers.collecting import command
from tests.helpers.collectors import SMALL
from tests.helpers.patience import PATIENCE
from tests.helpers.typist import PACE, Typist, display, needs_display, wait_for

pytestmark = pytest.mark.slow

pytest.importorskip("pygame")
SEED = 0


@needs_display
def test_typed_keys_pick_a_block(tmp_path):
    with World(SMALL) as world:
        scene = BlockPicking.begin(world, attempt_seed(SEED, 0, ATTEMPT)).scene
    out, log = tmp_path / "mine", tmp_path / "keys.log"
    options = ("--seed", SEED, "--out", out, "--log", log, "--operator", "typist", "--image-size", 16)
    with display() as name:
        process = subprocess.Popen(
            command("teleop", "--task", "block_picking", "--input-device", "keyboard", *options),
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | {"DISPLAY": name},
        )  # fmt: skip
        try:
            typist = Typist(name, log, process)
            wait_for(lambda: bool(typist.lines()), process)
            typist.tell("Return", Command.START)
            typist.go(3, nearest_turn(scene.yaw, np.pi / 2), 0.03)
            typist.go(0, scene.xy[0], 0.003)
            typist.go(1, scene.xy[1], 0.003)
            typist.go(2, 0.018, 0.006)
            typist.grip()
            typist.xdotool("keydown", "e")
            wait_for(lambda: out.joinpath("episode_000000.hdf5").exists(), process)
            typist.xdotool("keyup", "e")
            typist.xdotool("key", "Escape")
            said, complaints = process.communicate(timeout=PATIENCE)
        finally:
            process.kill()
            process.wait()
    assert (process.returncode, complaints) == (0, "")
    assert "episode 0 saved: success (achieved)" in said
    episode = Dataset.open(out).read(0)
    assert check_episode(episode) == []
    assert episode.meta.config["teleop"]["rate_hz"] > 0

    # The log without window or clock: the same episode, to the last bit.
    what = Teleoperation(SEED, "block_picking", SMALL)
    again = Dataset.create_or_resume(tmp_path / "again", what.task, what.seed, what.config())
    Session(again, what, Script(log), NoScreen(), Clock(paced=False), PACE, 2400, {}).run()
    what.opened.close()
    arrays = dict(episode.arrays)
    del arrays["extra/teleop/beat_ns"]
    assert arrays.keys() == again.read(0).arrays.keys()
    for path, values in arrays.items():
        assert values.tobytes() == again.read(0).arrays[path].tobytes(), path
