"""Collector of demonstrations in simulation whose block has AprilTags that show when the task is achieved."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from collectors.apriltags.tracker import Tracker
from collectors.apriltags.watch import Lifted, Reached, Watch
from collectors.recording.loop import State, record
from collectors.simulation.camera import Camera, CameraConfig
from collectors.simulation.world import World
from collectors.sources.expert import ExpertCollector
from collectors.sources.tagged_block import wear_tags
from collectors.tasks import block_picking, block_pushing
from collectors.tasks.block_picking import BlockPicking
from collectors.tasks.block_pushing import BlockPushing
from collectors.tasks.task import Task
from svfl_data.errors import UsageError
from svfl_data.schema.robot import Calibration, Policy, Watcher

TAGGED = ("block_picking", "block_pushing")
"""Names of the tasks whose success is determined by a block's pose."""
TARGET = (0.55, 0.0, 0.03)
TAG_CAMERAS = {
    f"tags_{name}": CameraConfig(
        360, 480, eye=(0.55 + 0.35 * x, 0.35 * y, 0.36), target=TARGET, up=(-x, -y, 0.0), fov_deg=40.0
    )
    for name, x, y in (("left", 1, 1), ("right_back", -1, -1), ("right", 1, -1), ("left_back", -1, 1))
}
"""Cameras at 0.6 m from the middle of the workspace, over its corners, by name.

The gripper hides the block from up to three of the cameras. A block that is moved towards the arm is seen only from
behind.
"""


class SimulatedTagCamera:
    """Simulated camera whose images only the tag tracker uses, and which are not recorded."""

    def __init__(self, world: World, config: CameraConfig, noise: float = 0.0, seed: int = 0) -> None:
        """Place the camera.

        Args:
            world: World that the camera looks at.
            config: Pose and optics of the camera.
            noise: Standard deviation of the noise on the camera's images, in grey levels.
            seed: Seed of the noise.
        """
        self._world, self._camera, self._noise = world, Camera(config, world.client), noise
        self._rng = np.random.default_rng(seed)

    @property
    def calibration(self) -> Calibration:
        """Calibration of the camera."""
        return self._camera.calibration()

    def __call__(self) -> tuple[int, NDArray[np.uint8]]:
        """Render an image.

        Returns:
            Time of the latest reading, [ns], and the colour image, (H, W, 3) uint8 RGB.
        """
        color = self._camera.render().color
        if self._noise:
            noisy = color + self._noise * self._rng.standard_normal(color.shape, np.float32)
            color = np.clip(noisy, 0, 255).astype(np.uint8)
        return int(self._world.wrench_t_ns[-1]), color


def watched(task: Task, noise: float = 0.0, seed: int = 0, cameras: Mapping[str, CameraConfig] = TAG_CAMERAS) -> Watch:
    """Put tags on the block of a task that has just been set up, and begin to watch the block.

    Args:
        task: Block pushing or block picking. Its `body` becomes the tagged block.
        noise: Standard deviation of the noise on the cameras' images, in grey levels.
        seed: Seed of the noise.
        cameras: Cameras that look at the tags, by name.

    Returns:
        The watch, which detects from the tags when the task is achieved.

    Raises:
        UsageError: If tags cannot tell the success of the task.
    """
    success: Callable[[NDArray[np.float64]], bool]
    if isinstance(task, BlockPushing):
        success = Reached(task.scene.goal, block_pushing.REACHED, task.scene.half + 2 * block_pushing.LYING)
    elif isinstance(task, BlockPicking):
        success = Lifted(task.scene.half + block_picking.LIFTED)
    else:
        raise UsageError(f"tags can determine the success of {' and '.join(TAGGED)}, not of {type(task).__name__}")
    task.body, layout = wear_tags(task.world.client, task.body, task.scene.half)
    placed = {name: SimulatedTagCamera(task.world, config, noise, seed) for name, config in cameras.items()}
    return Watch(Tracker(layout, upright=isinstance(task, BlockPushing)), placed, success)


@dataclass(frozen=True)
class TaggedCollector(ExpertCollector):
    """Collector of demonstrations whose success is determined by tags, as on a real table.

    An attempt ends when the tags show success. It is a demonstration if the tags show success at its end, whatever the
    true state is. An episode has the stream ``streams/tags/``, and in ``extra/state/achieved`` whether the task truly
    is achieved at each observation.

    Attributes:
        seed: Seed of the dataset.
        task: Name of the task, one of `TAGGED`.
        noise: Amount by which demonstrations differ: 0 not at all, 1 as intended, 2 at most.
        perturbations: Probability, 0..1, that a perturbation of the gripper begins at an action (see
            `collectors.sources.perturbations`).
        world: Configuration of the world: physics, arm, sensors and the cameras that are recorded.
        attempts: Number of attempts after which the collector gives up, 20 at most.
        steps: Number of actions after which an attempt ends.
        tag_cameras: Cameras that look at the tags, by name.
    """

    tag_cameras: Mapping[str, CameraConfig] = field(default_factory=lambda: TAG_CAMERAS)

    def __post_init__(self) -> None:
        """Refuse tasks that are not in `TAGGED`.

        Raises:
            UsageError: If tags cannot tell the success of the task.
        """
        if self.task not in TAGGED:
            raise UsageError(f"tags can determine the success of {' and '.join(TAGGED)}, not of {self.task}")

    def config(self) -> dict[str, Any]:
        """Everything that was set, as JSON values."""
        cameras = {name: asdict(camera) for name, camera in self.tag_cameras.items()}
        return super().config() | {"tags": True, "tag_cameras": cameras}

    def _recorded(self, task: Task, policy: Policy, watch: Watcher) -> tuple[dict[str, np.ndarray], bool]:
        tags = watched(task, cameras=self.tag_cameras)

        def state() -> State:
            return {**task.state(), "achieved": np.array(task.success())}

        arrays = record(self.opened, policy, self.steps, tags.done, state, watch)
        return arrays | tags.tracker.arrays(), tags.achieved
