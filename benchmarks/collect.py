"""Cost of collecting: environment steps per CPU second beside those of the bare engine, and where the time goes.

    .venv/bin/python benchmarks/collect.py --episodes 20

All figures are CPU time of one process. They include everything that `svfl-collect expert` does for an episode: reset,
scene, expert, control, 500 readings a second, RGB-D image, file. The bare engine does the same physics and nothing
else: the motor torques of the same episodes are played back (the wrist reactions are the same to the bit, which is
checked), joints and wrist are read in every physics step, and one image is rendered in every environment step. The
parts are measured by timing the functions that do them, in a separate pass, so that the timing does not slow the rates
that are reported.
"""

import argparse
import os
import platform
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from collectors.simulation import world as world_module
from collectors.simulation.admittance import Admittance
from collectors.simulation.arms.torque_arm import TorqueArm
from collectors.simulation.camera import Camera
from collectors.simulation.noise import SensorNoise
from collectors.simulation.world import World
from collectors.sources.expert import ExpertCollector
from collectors.tasks import TASKS, task_class
from collectors.tasks.task import Task
from svfl_data.storage import store
from svfl_data.storage.store import write_episode

PYBULLET = world_module.pybullet
MOVING = (*range(7), 9, 10)  # joints of panda.urdf: the arm, then the fingers
SENSED = (*MOVING, 8)
PARTS = (
    ("physics", PYBULLET, "stepSimulation"),
    ("control", TorqueArm, "drive"),
    ("control", TorqueArm, "read"),
    ("control", Admittance, "step"),
    ("sensor", world_module, "wrench_from_reaction"),
    ("sensor", SensorNoise, "__call__"),
    ("render", Camera, "render"),
    ("record", store, "episode_bytes"),
    ("record", store, "write_atomically"),
)
NAMES = ("physics", "control", "sensor", "render", "record", "other")


@contextmanager
def clocks() -> Iterator[dict[str, float]]:
    """Measure the CPU seconds of each part while the context lasts; parts never contain each other.

    Yields:
        The CPU seconds of each part so far, by name.
    """
    spent: dict[str, float] = defaultdict(float)

    def clocked(part: str, function):
        def call(*args, **kwargs):
            start = time.process_time()
            try:
                return function(*args, **kwargs)
            finally:
                spent[part] += time.process_time() - start

        return call

    with ExitStack() as stack:
        for part, owner, name in PARTS:
            stack.enter_context(patch.object(owner, name, clocked(part, getattr(owner, name))))
        yield spent


@dataclass
class Take:
    """Record of one episode after its beginning: the torques of the motors and the reactions at the wrist."""

    seed: np.random.SeedSequence
    torques: list[list[float]] = field(default_factory=list)
    reactions: list[tuple[float, ...]] = field(default_factory=list)


@contextmanager
def taking(takes: list[Take]) -> Iterator[None]:
    """Record the torques of every episode that begins while the context lasts.

    Args:
        takes: List that a record is added to for each episode.
    """
    begin, send, feel = Task.begin.__func__, PYBULLET.setJointMotorControlArray, world_module.wrench_from_reaction
    begun: list[Take] = []  # record of the current episode; empty while an episode is being set up

    def beginning(cls, world, seed):
        begun.clear()
        task = begin(cls, world, seed)
        takes.append(Take(seed))
        begun.append(takes[-1])
        return task

    def sending(body, joints, mode, **kwargs):
        if begun and joints is MOVING:
            begun[0].torques.append(kwargs["forces"])
        return send(body, joints, mode, **kwargs)

    def feeling(reaction):
        if begun:
            begun[0].reactions.append(reaction)
        return feel(reaction)

    with (
        patch.object(Task, "begin", classmethod(beginning)),
        patch.object(PYBULLET, "setJointMotorControlArray", sending),
        patch.object(world_module, "wrench_from_reaction", feeling),
    ):
        yield


def collect(collector: ExpertCollector, episodes: int, folder: Path) -> tuple[int, float]:
    """Collect episodes.

    Args:
        collector: Collector that makes the episodes.
        episodes: Number of episodes.
        folder: Folder to write the episodes to.

    Returns:
        The number of environment steps of the episodes that are kept, and the CPU seconds.
    """
    steps = 0
    start = time.process_time()
    for index in range(episodes):
        episode = collector(index)
        write_episode(episode, folder / f"{index}.hdf5")
        steps += len(episode)
    return steps, time.process_time() - start


def play_bare(name: str, takes: list[Take]) -> tuple[int, float]:
    """Play the recorded torques back in the bare engine.

    Args:
        name: Name of the task.
        takes: Records of the episodes.

    Returns:
        The number of environment steps, and the CPU seconds without those for beginning the episodes.
    """
    steps, seconds = 0, 0.0
    with World() as world:
        per_step, client = world.config.physics_steps, world.client
        camera = next(iter(world._cameras.values()))
        for take in takes:
            task_class(name).begin(world, take.seed)
            reactions = []
            start = time.process_time()
            for count, torques in enumerate(take.torques, 1):
                PYBULLET.setJointMotorControlArray(
                    world.robot, MOVING, PYBULLET.TORQUE_CONTROL, forces=torques, physicsClientId=client
                )
                PYBULLET.stepSimulation(physicsClientId=client)
                reactions.append(PYBULLET.getJointStates(world.robot, SENSED, physicsClientId=client)[-1][2])
                if count % per_step == 0:
                    camera.render()
            seconds += time.process_time() - start
            steps += len(take.torques) // per_step
            assert reactions == take.reactions, f"{name}: the bare engine did not do the same physics"
    return steps, seconds


def reset_ms(name: str, rounds: int = 20) -> float:
    """Return the median CPU time to begin an episode, [ms]: reset, scene and tare.

    Args:
        name: Name of the task.
        rounds: Number of episodes that are begun, after a first one that does not count.
    """
    spent = []
    with World() as world:
        for seed in range(rounds + 1):
            start = time.process_time()
            task_class(name).begin(world, np.random.SeedSequence([1, seed]))
            spent.append(1000 * (time.process_time() - start))
    return float(np.median(spent[1:]))  # the first one builds the world


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", choices=[*TASKS, "all"], default="all")
    parser.add_argument("--episodes", type=int, default=20)
    asked = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {asked.episodes} episodes a task, one process, CPU time\n")
    print("| task | steps/s | bare engine | share | reset, ms |", *(f" {part}, ms |" for part in NAMES), sep="")
    print("| --- " * (5 + len(NAMES)) + "|")
    for name in TASKS if asked.task == "all" else [asked.task]:
        with tempfile.TemporaryDirectory() as folder:
            collector = ExpertCollector(seed=0, task=name)
            collect(collector, 1, Path(folder))  # warm caches
            steps, seconds = collect(collector, asked.episodes, Path(folder))
            takes: list[Take] = []
            with taking(takes):
                collect(collector, asked.episodes, Path(folder))
            bare_steps, bare_seconds = play_bare(name, takes)
            with clocks() as spent:
                _, clocked_seconds = collect(collector, asked.episodes, Path(folder))
        spent["other"] = clocked_seconds - sum(spent.values())
        rate, bare = steps / seconds, bare_steps / bare_seconds
        parts = "".join(f" {1000 * spent[part] / steps:.2f} |" for part in NAMES)
        share = f"{100 * rate / bare:.0f} %"
        print(f"| {name} | {rate:.0f} | {bare:.0f} | {share} | {reset_ms(name):.1f} |{parts}", flush=True)


if __name__ == "__main__":
    main()
