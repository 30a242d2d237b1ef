"""Interface of a tracker."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol


class Tracker(Protocol):
    """One run in an experiment tracker.

    Trackers write below the folder of the training. None uses a network unless the user's environment says so.
    """

    def configuration(self, values: Mapping[str, Any]) -> None:
        """Log the configuration of the training, plain values."""

    def numbers(self, values: Mapping[str, float], step: int) -> None:
        """Log numbers by name, after the given number of optimiser steps."""

    def picture(self, name: str, file: Path) -> None:
        """Log a picture; an animated GIF is logged as a video."""

    def close(self, succeeded: bool) -> None:
        """End the run and write what is left."""


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested plain values as one dictionary, with names such as ``latent/steps``."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{prefix}{name}/")
        else:
            found[f"{prefix}{name}"] = value
    return found
