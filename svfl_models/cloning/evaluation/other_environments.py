"""Evaluation in gymnasium environments of other packages, whose observations have a policy's inputs by their keys.

An observation is a dictionary. A policy with the paper's inputs takes ``image`` (4, H, H), ``wrench`` (T, 6) and
``proprio`` (5,) from it, as far as it uses them; a policy with inputs of the user's own takes the paths of its inputs,
with the values that `svfl_data.sampling.samples.Samples` gives at a step. All are in base axes.
"""

from typing import Any

import numpy as np

from svfl_data.errors import TrainingError
from svfl_data.system.printable import printable
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.networks.action_space import PLANAR, ActionSpace

OURS = "svfl/"
"""Namespace of the environments of this package, which take a robot, a camera and scenes."""


def is_ours(environment: str) -> bool:
    """Return whether a gymnasium id is of an environment of this package.

    Args:
        environment: Gymnasium id, with or without the module that declares the environment.
    """
    return environment.rpartition(":")[2].startswith(OURS)


def begin(scene: tuple[int, int]) -> dict[str, Any]:
    """Return the arguments with which an environment of another package is reset for an episode.

    Args:
        scene: Seed of the scenes and number of the episode; together they give the seed of the reset.
    """
    return {"seed": int(np.random.SeedSequence(scene).generate_state(1)[0])}


def expect_inputs(environment: Any, module: CloningModule, name: str) -> None:  # noqa: ANN401 - gymnasium's, wrapped
    """Refuse an environment whose observations lack inputs of a policy, or whose action is another one.

    Args:
        environment: Environment, as gymnasium makes it.
        module: The trained policy.
        name: Name of the policy in messages.

    Raises:
        TrainingError: If the environment does not fit; the message says what was found.
    """
    spaces = getattr(environment.observation_space, "spaces", None)
    if not isinstance(spaces, dict):
        raise TrainingError(f"{name}: takes inputs by name, the environment's observation is no dictionary")
    have = printable(", ".join(map(str, spaces)) or "none", 200)
    for key, shape in _inputs(module).items():
        if key not in spaces:
            raise TrainingError(f"{name}: takes {printable(key, 80)}, the environment's observation has {have}")
        found = tuple(spaces[key].shape or ())
        if shape is not None and found != shape:
            raise TrainingError(f"{name}: takes {printable(key, 80)} of shape {shape}, the environment gives {found}")
    count = len(ActionSpace.of_plain(module.deployment.action) if module.deployment.action else PLANAR)
    found = environment.action_space.shape
    if found != (count,):
        raise TrainingError(f"{name}: gives {count} numbers, the environment's action has shape {found}")


def _inputs(module: CloningModule) -> dict[str, tuple[int, ...] | None]:
    """Return the keys of the observation that a policy takes, with the shapes that are fixed."""
    known = module.deployment
    if known.inputs:
        found: dict[str, tuple[int, ...] | None] = {}
        for one in of_plain(known.inputs):
            found |= dict.fromkeys([f"{one.path}/{leaf}" for leaf in one.images] or [one.path])
            found |= {} if one.axes is None else {one.axes: None}
        return found
    encoder = module.hparams["network"]["encoder"]
    image = (4, known.image_side, known.image_side)
    shapes = {"v": ("image", image), "f": ("wrench", (module.policy.trunk.window, 6)), "p": ("proprio", (5,))}
    return {key: shape for letter, (key, shape) in shapes.items() if letter in encoder}
