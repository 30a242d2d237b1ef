"""Collector of block-centering samples: attempts that collide as intended become labelled episodes."""

from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from collectors.recording.collection import software_versions
from collectors.recording.loop import OBJECT, record, unwatched
from collectors.recording.worker import forget
from collectors.simulation.centering import CenteringConfig, Scene, draw_scene, true_label
from collectors.simulation.centering_expert import CollisionExpert
from collectors.simulation.config import WorldConfig
from collectors.simulation.world import World
from collectors.sources.simulated import VERSIONS, Simulated
from collectors.tasks.task import ATTEMPTS, MAX_STEPS, attempt_seed
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import CollectError
from svfl_data.schema.episode import Episode, Meta
from svfl_data.schema.robot import Watcher
from svfl_data.symmetry import DIRECTIONS

TASK = "centering"


@dataclass(frozen=True)
class CenteringCollector(Simulated):
    """Collector that produces the episode of an index.

    The same seed, index and configuration give the same bytes in any process. Attempts that do not collide as intended
    are rejected, and the episode's configuration lists why.

    Attributes:
        seed: Seed of the dataset.
        scene: Bounds of the scenes that are drawn.
        world: Configuration of the world: physics, arm, sensors and cameras.
        attempts: Number of attempts after which the collector gives up, 20 at most. It is not stored, because it
            changes no episode.
    """

    seed: int
    scene: CenteringConfig = field(default_factory=CenteringConfig)
    world: WorldConfig = field(default_factory=WorldConfig)
    attempts: int = ATTEMPTS

    def config(self) -> dict[str, Any]:
        """Return the configuration of the collector as JSON values."""
        return {"scene": asdict(self.scene), "world": asdict(self.world)}

    def __call__(self, index: int, *, keep: Callable[[Episode], None] = forget, watch: Watcher = unwatched) -> Episode:
        """Collect one episode; failed attempts are counted and not kept.

        Args:
            index: Number of the episode in the dataset.
            keep: Function that is called with every failed attempt; this collector makes no episodes of those.
            watch: Function that is called with every observation and action of every attempt.

        Raises:
            CollectError: If no attempt collides as intended.
        """
        rejected: list[str] = []
        for attempt in range(self.attempts):
            outcome = self._attempt(index, attempt, rejected, watch)
            if isinstance(outcome, Episode):
                return outcome
            rejected.append(outcome)
        raise CollectError(
            f"sample {index} (seed {self.seed}): none of {self.attempts} attempts collided as intended: "
            + ", ".join(rejected)
        )

    def _attempt(self, index: int, attempt: int, rejected: list[str], watch: Watcher) -> Episode | str:
        """Make one attempt, and return its episode or the reason why the attempt is rejected."""
        world = self.opened
        scene, block = begin(world, self.scene, self.seed, index, attempt)
        expert = CollisionExpert(scene, touchdown=2 * scene.block_half + world.fingers.tip)
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
        software, robot = software_versions(*VERSIONS), world.name
        meta = Meta(TASK, index, self.seed, "expert", True, config, software, robot=robot)
        return Episode(meta, arrays, declarations=world.declarations)


def balanced_direction(seed: int, index: int) -> int:
    """Return the class of a sample, 0..3, such that samples 4 k to 4 k + 3 hold each class once, in random order.

    Args:
        seed: Seed of the dataset.
        index: Number of the sample.
    """
    order = np.random.default_rng([seed, index // 4]).permutation(4)
    return int(order[index % 4])


def begin(world: World, config: CenteringConfig, seed: int, index: int, attempt: int) -> tuple[Scene, int]:
    """Draw the scene of an attempt and set it up, with the arm at home and the wrist sensor tared.

    Args:
        world: World to use. Its earlier use does not matter.
        config: Bounds of the scenes that are drawn.
        seed: Seed of the dataset.
        index: Number of the sample.
        attempt: Number of the attempt at the sample, from 0.

    Returns:
        The scene and the body id of the scene's block.
    """
    randomness = attempt_seed(seed, index, attempt)
    scene = draw_scene(np.random.default_rng(randomness), balanced_direction(seed, index), config, world)
    world.reset(seed=int(randomness.generate_state(1)[0]))
    block = add_block(world, scene)
    world.tare()
    return scene, block


def add_block(world: World, scene: Scene) -> int:
    """Put the block of a scene on the table and return its body id."""
    return world.add_box(
        half_extents=(scene.block_half,) * 3,
        position=(*scene.block_xy, scene.block_half),
        yaw=scene.block_yaw,
        mass=scene.block_mass,
        friction=scene.block_friction,
        color=scene.block_color,
    )


def summary(dataset: Dataset) -> tuple[dict[str, Any], list[str]]:
    """Describe a dataset of samples, as facts and in lines: the classes, and how many attempts failed and why."""
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
    facts = {"path": dataset.path, "task": dataset.info["task"], "episodes": total}
    facts |= {"classes": {name: classes[name] for name in DIRECTIONS}}
    facts |= {"attempts": total + rejected.total(), "failures": dict(rejected)}
    return facts, [*lines, *(f"  {count} x {reason}" for reason, count in rejected.most_common())]
