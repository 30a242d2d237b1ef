"""Tagged blocks in simulation: tasks whose block wears tags, and what a tag camera makes of them."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.tracker import Tracker
from collectors.apriltags.watch import Lifted, Reached, Watch
from collectors.recording.loop import State, Watcher, record
from collectors.simulation.camera import Camera, CameraConfig
from collectors.simulation.world import World
from collectors.sources.expert import ExpertCollector
from collectors.sources.tagged_block import wear_tags
from collectors.tasks import block_picking, block_pushing
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.block_pushing import BlockPushing
from collectors.tasks.task import MAX_STEPS, Task
from svfl_data.errors import UsageError
from svfl_data.schema.robot import Calibration, Policy

TAGGED = ("block_picking", "block_pushing")
"""Tasks whose success a block's pose tells."""
TARGET = (0.55, 0.0, 0.03)
TAG_CAMERAS = {
    f"tags_{name}": CameraConfig(
        360, 480, eye=(0.55 + 0.35 * x, 0.35 * y, 0.36), target=TARGET, up=(-x, -y, 0.0), fov_deg=40.0
    )
    for name, x, y in (("left", 1, 1), ("right_back", -1, -1), ("right", 1, -1), ("left_back", -1, 1))
}
"""Cameras at 0.6 m from the middle of the workspace, over its corners. The gripper hides the block from up to three of
them: a block that is pulled towards the arm is only seen from behind."""


class SimulatedTagCamera:
    """A camera of a world that nobody but the tracker looks through."""

    def __init__(self, world: World, config: CameraConfig, noise: float = 0.0, seed: int = 0) -> None:
        """Place it.

        Args:
            world: The world.
            config: Where it stands.
            noise: Standard deviation of the noise on its pictures, in grey levels.
            seed: Seed of the noise.
        """
        self._world, self._camera, self._noise = world, Camera(config, world.client), noise
        self._rng = np.random.default_rng(seed)

    @property
    def calibration(self) -> Calibration:
        """Its calibration."""
        return self._camera.calibration

    def __call__(self) -> tuple[int, NDArray[np.uint8]]:
        """A picture of now."""
        color = self._camera.render().color
        if self._noise:
            noisy = color + self._noise * self._rng.standard_normal(color.shape, np.float32)
            color = np.clip(noisy, 0, 255).astype(np.uint8)
        return int(self._world.wrench_t_ns[-1]), color


def watched(task: Task, noise: float = 0.0, seed: int = 0) -> Watch:
    """Put tags on the block of a task that has just been set up, and watch it.

    Args:
        task: Block pushing or block picking.
        noise: Standard deviation of the noise on the pictures, in grey levels.
        seed: Seed of the noise.

    Raises:
        UsageError: If tags cannot tell success of the task.
    """
    success: Callable[[NDArray[np.float64]], bool]
    if isinstance(task, BlockPushing):
        success = Reached(task.scene.goal, block_pushing.REACHED, task.scene.half + 2 * block_pushing.LYING)
    elif isinstance(task, BlockPicking):
        success = Lifted(task.scene.half + block_picking.LIFTED)
    else:
        raise UsageError(f"tags tell success of {' and '.join(TAGGED)}, not of {type(task).__name__}")
    task.body, layout = wear_tags(task.world.client, task.body, task.scene.half)
    cameras = {name: SimulatedTagCamera(task.world, config, noise, seed) for name, config in TAG_CAMERAS.items()}
    return Watch(Tracker(layout, upright=isinstance(task, BlockPushing)), cameras, success)


@dataclass(frozen=True)
class TaggedCollector(ExpertCollector):
    """Records demonstrations whose success is told by tags, as on a real table; what they do not see does not count.

    An attempt is at its end when the tags say so, and a demonstration if they do, whatever the truth is. An episode has
    the stream ``streams/tags/``, and ``extra/state/achieved``: the truth at each observation.

    Attributes:
        seed: Seed of the dataset.
        task: One of `TAGGED`.
        noise: How much demonstrations differ, 0 to 2.
        perturbations: How likely the gripper is to be pushed off its way at an action.
        world: Physics, arm, sensors and cameras of the policy; those that look at the tags are `TAG_CAMERAS`.
    """

    def __post_init__(self) -> None:
        """Refuse other tasks.

        Raises:
            UsageError: If tags cannot tell success of the task.
        """
        if self.task not in TAGGED:
            raise UsageError(f"tags tell success of {' and '.join(TAGGED)}, not of {self.task}")

    def config(self) -> dict[str, Any]:
        """Everything that was set, as JSON values."""
        cameras = {name: asdict(camera) for name, camera in TAG_CAMERAS.items()}
        return super().config() | {"tags": True, "tag_cameras": cameras}

    def _recorded(self, task: Task, policy: Policy, watch: Watcher) -> tuple[dict[str, np.ndarray], bool]:
        tags = watched(task)

        def state() -> State:
            return {**task.state(), "achieved": np.array(task.success())}

        arrays = record(self.opened, policy, MAX_STEPS, tags.done, state, watch)
        return arrays | tags.tracker.arrays(), tags.achieved
