"""Predictions of a trained network for every observation of an episode, which the viewer draws.

Other packages load the networks. A package that can load files of some kind declares a function
``load(path) -> network`` in the entry-point group `GROUP`, under the suffix of the files without its dot;
``network(episode)`` returns a `Prediction`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.sampling.centering_samples import direction_in
from svfl_data.schema.episode import Episode
from svfl_data.viewer.entities.episode_source import ACTION, EpisodeSource

GROUP = "svfl.predictions"


@dataclass(frozen=True, eq=False)
class Prediction:
    """Prediction of one network on one episode with N+1 observations.

    Attributes:
        name: Name of the network.
        camera: Name of the camera whose images the network sees, or in whose image-aligned axes it predicts directions;
            empty if it does neither.
        seen: Cropped and scaled images that the network sees, shape (N+1, H, W, 3), uint8. None if there are none.
        probabilities: Probabilities of the directions `svfl_data.symmetry.DIRECTIONS`, shape (N+1, 4). None if the
            network does not predict directions.
        actions: Actions that the network would command, shape (N+1, C), in the units, axes and order of components of
            the recorded action. None if it does not predict actions.
        action: Path of the recorded action that `actions` are beside.
        crop: Part of the camera's image that the network sees: left, top, right, bottom edge, shape (N+1, 4), [px],
            where the outer corner of the top left pixel is (0, 0). None for the middle part, whose size is given by
            `svfl_data.viewer.entities.images.CROP`.
    """

    name: str
    camera: str
    seen: np.ndarray | None = None
    probabilities: np.ndarray | None = None
    actions: np.ndarray | None = None
    crop: np.ndarray | None = None
    action: str = ACTION


Network = Callable[[Episode], Prediction]


def true_direction(shown: EpisodeSource, prediction: Prediction) -> int | None:
    """Return the direction class that a network should have predicted, in the axes of its camera; None if unknown.

    Args:
        shown: Episode that is shown.
        prediction: Prediction of directions on this episode.
    """
    needed = ("labels/direction", "labels/offset", axes := f"cameras/{prediction.camera}/image_axes")
    if not all(path in shown for path in needed):
        return int(shown["labels/direction"]) if "labels/direction" in shown else None
    return direction_in(shown[axes], int(shown["labels/direction"]), shown["labels/offset"])


def load(checkpoint: Path) -> Network:
    """Open a trained network.

    Args:
        checkpoint: File of the network, whose suffix selects the package that opens it.

    Returns:
        Function that predicts on an episode.

    Raises:
        FormatError: If the file does not exist, or its content does not match its suffix.
        UsageError: If no installed package opens files with this suffix.
    """
    if not checkpoint.is_file():
        raise FormatError(f"{checkpoint}: no such file")
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    entry = known.get(checkpoint.suffix.removeprefix("."))
    if entry is None:
        kinds = ", ".join(f".{name}" for name in sorted(known)) or "none (svfl must be installed with pip)"
        raise UsageError(f"--checkpoint {checkpoint}: no installed package opens this kind of file; possible: {kinds}")
    opened: Callable[[Path], Network] = entry.load()
    return opened(checkpoint)
