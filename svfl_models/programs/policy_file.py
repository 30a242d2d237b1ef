"""Policies from their files, as functions of what a robot observes, whatever inputs and action they have."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from svfl_data.sampling.live_cut import LiveCut
from svfl_data.schema.input_spec import InputSpec, Window
from svfl_data.schema.observation import Observation
from svfl_data.schema.robot import Policy
from svfl_models.programs import exported_policy, own_policy
from svfl_models.programs.own_policy import InputFacts, OwnPolicy


def load(file: Path | str) -> Policy:
    """Load an exported policy, which says by a mark inside its file of which kind it is.

    Args:
        file: File of the policy (``.pt2``).

    Raises:
        FormatError: If the file is missing, damaged, or not a policy.
    """
    path = Path(file)
    return RobotPolicy(own_policy.load(path)) if own_policy.is_own(path) else exported_policy.load(path)


class RobotPolicy:
    """A policy with inputs of the user's own that, when called with the observations of a robot, returns actions.

    Its inputs are cut from the observations as those of its training were cut from episodes, so it must be given all
    observations of an episode in their order (`svfl_data.sampling.live_cut.LiveCut`).

    Args:
        policy: Policy of values by path.

    Attributes:
        policy: The same.
    """

    def __init__(self, policy: OwnPolicy) -> None:
        self.policy = policy
        self._cut = LiveCut(inputs_of(policy.facts.inputs))

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        self._cut.forget()

    def __call__(self, seen: Observation) -> NDArray[np.float32]:
        """Return the action for an observation, shape (C,), float32, within its bounds.

        Args:
            seen: Observation of the current step.

        Raises:
            FieldError: If the robot did not observe what the policy takes.
            DatasetError: If a stream has another rate than in training.
            TrainingError: If a value has another shape than in training, or the action is not finite.
        """
        return self.policy({path: values[0] for path, values in self._cut(seen).items()})


def inputs_of(facts: Sequence[InputFacts]) -> InputSpec:
    """Return what is cut from an episode, or from a robot's observations, for the inputs of a policy.

    Args:
        facts: Inputs of the policy.
    """
    return InputSpec(
        cameras=tuple(one.path.removeprefix("cameras/") for one in facts if one.images),
        windows={one.path: Window(one.shape[0], one.rate_hz) for one in facts if one.path.startswith("streams/")},
        vectors=tuple(one.path for one in facts if one.path.startswith("observations/")),
    )
