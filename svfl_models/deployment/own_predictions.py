"""Actions of a policy with inputs and an action of the user's own, at every observation of an episode."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch
from torch import Tensor

from svfl_data.errors import DatasetError
from svfl_data.sampling.cut import cut_steps
from svfl_data.schema.episode import Episode
from svfl_data.signals.camera_poses import moves
from svfl_data.system.printable import printable
from svfl_data.viewer.predictions import Network, Prediction
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.own_acting import OwnActingPolicy, action_path
from svfl_models.cloning.own_data import picture
from svfl_models.cloning.recorded_inputs import RecordedInput
from svfl_models.programs.own_policy import Facts, InputFacts, OwnPolicy
from svfl_models.programs.policy_file import inputs_of

AT_ONCE = 2**25
"""Number of numbers that inputs have at a time; an observation with more of them is taken alone."""


def of_module(module: CloningModule, name: str, at_once: int = AT_ONCE) -> Network:
    """Return the function that predicts the actions of a policy, as ``svfl-train bc --inputs`` has trained it.

    Args:
        module: The trained policy.
        name: Name of the policy in predictions.
        at_once: Number of numbers that the inputs have at a time.

    Returns:
        A function that takes an episode and returns a `Prediction`. It raises `DatasetError` if the episode lacks an
        input or the action of the policy, or has them with another shape, unit of depth or rate.
    """
    policy = OwnActingPolicy(module.policy, module.deployment).eval()
    facts, known = policy.facts(action_path(module)), {one.path: one for one in policy.inputs}

    @torch.inference_mode()
    def actions(recorded: dict[str, np.ndarray]) -> np.ndarray:
        told: Tensor = policy(*(_values(one, known.get(one.path), recorded) for one in facts.inputs))
        return np.clip(told.numpy(), facts.low, facts.high).astype(np.float32)

    def network(episode: Episode) -> Prediction:
        parts = [actions(recorded) for _, recorded in _observations(episode, facts, name, at_once)]
        return Prediction(name, "", actions=np.concatenate(parts), action=facts.action)

    return network


def of_program(policy: OwnPolicy, name: str, at_once: int = AT_ONCE) -> Network:
    """Return the function that predicts the actions of an exported policy.

    Args:
        policy: The exported policy.
        name: Name of the policy in predictions.
        at_once: Number of numbers that the inputs have at a time.

    Returns:
        A function that takes an episode and returns a `Prediction`; it raises the same errors as that of `of_module`.
    """

    def network(episode: Episode) -> Prediction:
        actions = [
            policy({path: values[row] for path, values in recorded.items()})
            for count, recorded in _observations(episode, policy.facts, name, at_once)
            for row in range(count)
        ]
        return Prediction(name, "", actions=np.stack(actions), action=policy.facts.action)

    return network


def _observations(
    episode: Episode, facts: Facts, name: str, at_once: int
) -> Iterator[tuple[int, dict[str, np.ndarray]]]:
    """Yield what a policy observes, cut out of an episode: a number of observations, and their values by path.

    Raises:
        DatasetError: If the policy does not fit the episode.
    """
    _expect_inputs(episode, facts.inputs, name)
    _expect_action(episode, facts, name)
    count = max(1, at_once // max(1, sum(int(np.prod(one.shape)) for one in facts.inputs)))
    for first in range(0, len(episode.t_ns), count):
        steps = range(first, min(first + count, len(episode.t_ns)))
        yield len(steps), cut_steps(episode, inputs_of(facts.inputs), steps)


def _values(one: InputFacts, known: RecordedInput | None, recorded: dict[str, np.ndarray]) -> Tensor:
    """Return an input of the network, (B, *shape), float32: an image, or what else the cut gives by the same path."""
    if known is not None and known.kind == "image":
        return picture(known, recorded)
    return torch.from_numpy(recorded[one.path]).float().reshape(-1, *one.shape)


def _expect_inputs(episode: Episode, inputs: Sequence[InputFacts], name: str) -> None:
    """Refuse an episode that lacks an input of a policy, or has it in another form than in training.

    Raises:
        DatasetError: If it does; the message names the first such input.
    """
    for one in inputs:
        if one.path.endswith("/image_axes"):
            if not moves(episode.arrays, one.path.split("/")[1]):
                raise DatasetError(f"{episode.name}: {name} takes {printable(one.path)}; its camera has no known poses")
            continue
        scale = f"{one.path}/depth_scale"
        for path in [f"{one.path}/{leaf}" for leaf in one.images] or [one.path]:
            if path not in episode.arrays:
                group = path.partition("/")[0]
                have = ", ".join(known for known in episode.arrays if known.startswith(f"{group}/")) or f"no {group}"
                raise DatasetError(
                    f"{episode.name}: {name} takes {printable(path)}, which was not recorded; it has "
                    f"{printable(have, 300)}"
                )
            row = tuple(episode.arrays[path].shape[1:])
            fits = row[:2] == one.shape[1:] if one.images else (int(np.prod(row)),) == one.shape[-1:]
            if not fits or (path.startswith("streams/") and len(one.shape) != 2):
                raise DatasetError(
                    f"{episode.name}: {name} was made for {printable(path)} of shape {one.shape}, a recorded row has "
                    f"{row}"
                )
        if "depth" in one.images and not np.isclose(recorded := float(episode.arrays[scale]), one.depth_scale):
            raise DatasetError(
                f"{episode.name}: {name} was made for a depth_scale of {one.depth_scale:g} m, that of "
                f"{printable(one.path)} is {recorded:g} m"
            )


def _expect_action(episode: Episode, facts: Facts, name: str) -> None:
    """Refuse an episode whose actions are not those that a policy commands.

    Raises:
        DatasetError: If the action was not recorded, or has other components.
    """
    field = episode.declarations.at(facts.action)
    if field is None or not facts.action.startswith("actions/") or facts.action not in episode.arrays:
        have = ", ".join(path for path in episode.arrays if path.startswith("actions/"))
        raise DatasetError(
            f"{episode.name}: {name} commands {printable(facts.action)}, which was not recorded; it has "
            f"{printable(have, 300)}"
        )
    count = int(np.prod(episode.arrays[facts.action].shape[1:]))
    recorded = list(field.components) or list(map(str, range(count)))
    if recorded != facts.components:
        raise DatasetError(
            f"{episode.name}: {name} commands {printable(', '.join(facts.components), 200)}; components of "
            f"{facts.action} are {printable(', '.join(recorded), 200)}"
        )
