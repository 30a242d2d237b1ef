"""Draw docs/images/tasks: start, strongest contact and success of one expert episode of every task.

.venv/bin/python docs/task_strips.py --size 180 --out docs/images/tasks
"""

import argparse
from pathlib import Path

import cv2
import numpy as np

from collectors.simulation import CameraConfig, PandaConfig, World, WorldConfig
from collectors.tasks import TASKS, task_class
from collectors.tasks.gripper import Gripper
from collectors.tasks.task import MAX_STEPS


def strip(name: str, size: int, seed: int) -> np.ndarray:
    """Return three pictures side by side, (size, 3 size, 3) uint8 RGB.

    Args:
        name: Name of the task.
        size: Height and width of a picture, [px].
        seed: Seed of the episode.
    """
    camera = CameraConfig(height=size, width=size, fov_deg=36.0)
    with World(WorldConfig(cameras={"front": camera}, robot=PandaConfig(full_meshes=True))) as world:
        task = task_class(name).begin(world, np.random.SeedSequence([seed]))
        pictures, forces = [world.observe().frames["front"].color], [0.0]
        for _, action in zip(range(MAX_STEPS), task.expert(Gripper(world, np.random.default_rng(seed))), strict=False):
            world.step(action)
            seen = world.observe()
            pictures.append(seen.frames["front"].color)
            touched = any(world.finger_contacts(task.body))
            forces.append(float(np.linalg.norm(seen.wrench[-25:, :3], axis=1).max()) if touched else 0.0)
            if task.success():
                break
        assert task.success(), f"{name}: the expert did not succeed with seed {seed}"
    return np.concatenate([pictures[0], pictures[int(np.argmax(forces))], pictures[-1]], axis=1)


def main() -> None:
    """Write one PNG file for each task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, default=180)
    parser.add_argument("--seed", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("docs/images/tasks"))
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    for name in TASKS:
        cv2.imwrite(str(asked.out / f"{name}.png"), strip(name, asked.size, asked.seed)[..., ::-1])


if __name__ == "__main__":
    main()
