"""Interface of the specifications of a replay buffer: what all its episodes have in common, and how it is kept."""

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from svfl_data.errors import DatasetError
from svfl_data.replay.config import ReplayConfig
from svfl_data.replay.specs.layout import Layout

Observation = Mapping[str, np.ndarray]
"""What an agent has observed, by key."""


class Spec(Protocol):
    """Specification of a replay buffer; two buffers with equal specifications hold episodes of one kind."""

    @property
    def task(self) -> str:
        """Name of the task."""

    def layout(self, config: ReplayConfig) -> Layout:
        """Return what is kept of an episode and given in a batch.

        Raises:
            UsageError: If the settings are impossible for the inputs.
        """

    def observed(self, observation: Observation, layout: Layout) -> dict[str, np.ndarray]:
        """Return the rows of an observation by the names of a layout, as copies.

        They are the last rows of each stream (T, ...), and the row of each vector; for streams that keep them also the
        number of padded rows and the age.

        Raises:
            FieldError: If an array of the observation is missing or has a wrong shape or value.
        """

    def acted(self, action: np.ndarray) -> np.ndarray:
        """Return an action, shape (C,), as a batch gives it.

        Raises:
            FieldError: If the action has a wrong shape or value, or is beyond the bounds.
        """

    def kept(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return observed rows of an array, shape (M, ...), as a batch gives them."""

    def require_equal(self, other: "Spec", where: str, there: str) -> None:
        """Refuse another spec if it differs from this spec.

        Args:
            other: The other spec.
            where: Origin of this spec, for the error message, such as ``the replay buffer``.
            there: Origin of the other spec, for the error message.

        Raises:
            DatasetError: If the two specs differ.
        """

    def plain(self) -> dict[str, Any]:
        """Return the spec as plain values for files."""


def difference(name: str, mine: object, its: object, where: str, there: str) -> DatasetError:
    """Return the error about a fact in which two specifications differ.

    Args:
        name: Name of the fact.
        mine: Fact of the one specification.
        its: Fact of the other one.
        where: Origin of the one specification.
        there: Origin of the other one.
    """
    return DatasetError(f"{there}: its {name} is {its}, but {mine} in {where}; one replay buffer holds one kind")
