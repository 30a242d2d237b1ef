"""Block-centering samples: attempts that collide as meant become labelled episodes, the others are counted."""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from collectors.recording.collection import software_versions
from collectors.recording.loop import OBJECT, Watcher, record, unwatched
from collectors.recording.worker import forget
from collectors.simulation.centering import FINGERTIP, CenteringConfig, Scene, draw_scene, true_label
from collectors.simulation.centering_expert import CollisionExpert
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.sources.simulated import VERSIONS, Simulated
from collectors.tasks.task import ATTEMPTS, MAX_STEPS, attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError
from svfl_data.schema.episode import Episode, Meta
from svfl_data.symmetry import DIRECTIONS

TASK = "centering"


@dataclass(frozen=True)
class CenteringCollector(Simulated):
    """Produces the episode of an index: the same bytes for the same seed, index and configuration, anywhere.

    Attributes:
        seed: Seed of the dataset.
        scene: How scenes are drawn.
        world: Physics, arm, sensors and camera.
    """

    seed: int
    scene: CenteringConfig = field(default_factory=CenteringConfig)
    world: WorldConfig = field(default_factory=WorldConfig)

    def config(self) -> dict[str, Any]:
        """Everything that was set, as JSON values."""
        return {"scene": asdict(self.scene), "world": asdict(self.world)}

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect one episode; failed attempts are counted and not kept.

        Raises:
            CollectError: If no attempt collides as meant.
        """
        rejected: list[str] = []
        for attempt in range(ATTEMPTS):
            outcome = self._attempt(index, attempt, rejected, watch)
            if isinstance(outcome, Episode):
                return outcome
            rejected.append(outcome)
        raise CollectError(
            f"sample {index} (seed {self.seed}): none of {ATTEMPTS} attempts collided as meant: {', '.join(rejected)}"
        )

    def _attempt(self, index: int, attempt: int, rejected: list[str], watch: Watcher) -> Episode | str:
        """One attempt: the episode, or why it is rejected."""
        world = self.opened
        scene, block = begin(world, self.scene, self.seed, index, attempt)
        expert = CollisionExpert(scene, touchdown=2 * scene.block_half + FINGERTIP)
        arrays = record(world, expert, MAX_STEPS, state=lambda: {OBJECT: world.pose(block)}, watch=watch)

        label = true_label(world, block)
        touching = sum(world.finger_contacts(block))
        if touching != 1:
            return f"{touching} fingers touched"
        if label.direction != balanced_direction(self.seed, index) or label.border_deg < self.scene.border_deg:
            return "the block was pushed across a class border"
        arrays |= {
            "streams/object/half_extents": np.full(3, scene.block_half),
            "labels/offset": label.offset,
            "labels/direction": np.array(label.direction),
        }
        config = self.config() | {"drawn": asdict(scene), "attempt": attempt, "rejected": rejected}
        meta = Meta(TASK, index, self.seed, "expert", True, config, software_versions(*VERSIONS))
        return Episode(meta, arrays)


def balanced_direction(seed: int, index: int) -> int:
    """The class of a sample: every four consecutive samples hold each class once, in random order."""
    order = np.random.default_rng([seed, index // 4]).permutation(4)
    return int(order[index % 4])


def begin(world: World, config: CenteringConfig, seed: int, index: int, attempt: int) -> tuple[Scene, int]:
    """Draw the scene of an attempt and set it up, homed and tared.

    Args:
        world: Any world; what it was used for before does not matter.
        config: How scenes are drawn.
        seed: Of the dataset.
        index: Of the sample.
        attempt: Number of the attempt.

    Returns:
        The scene and the body id of its block.
    """
    randomness = attempt_seed(seed, index, attempt)
    scene = draw_scene(np.random.default_rng(randomness), balanced_direction(seed, index), config, world)
    world.reset(seed=int(randomness.generate_state(1)[0]))
    block = add_block(world, scene)
    world.tare()
    return scene, block


def add_block(world: World, scene: Scene) -> int:
    """Put the block of a scene on the table; returns its body id."""
    return world.add_box(
        half_extents=(scene.block_half,) * 3,
        position=(*scene.block_xy, scene.block_half),
        yaw=scene.block_yaw,
        mass=scene.block_mass,
        friction=scene.block_friction,
        color=scene.block_color,
    )


def summary(dataset: Dataset) -> list[str]:
    """What a dataset of samples holds, in lines: classes, and how many attempts were rejected and why."""
    classes: Counter[str] = Counter()
    rejected: Counter[str] = Counter()
    for episode in dataset:
        classes[DIRECTIONS[int(episode.label_direction)]] += 1
        rejected.update(episode.meta.config["rejected"])
    total = classes.total()
    lines = [
        f"{dataset.path}: {total} samples",
        "classes: " + ", ".join(f"{name} {classes[name]}" for name in DIRECTIONS),
        f"rejected attempts: {rejected.total()} of {total + rejected.total()}",
    ]
    return [*lines, *(f"  {count} x {reason}" for reason, count in rejected.most_common())]
