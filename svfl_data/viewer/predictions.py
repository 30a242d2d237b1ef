"""What a trained network thinks of every observation of an episode, for the viewer to draw.

Networks come from elsewhere: whoever can load some kind of file declares a function ``load(path) -> network`` in the
entry-point group `GROUP`, under the file's suffix without its dot; ``network(episode)`` gives a `Prediction`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np

from svfl_data.errors import FormatError, UsageError
from svfl_data.schema.episode import Episode

GROUP = "svfl.predictions"


@dataclass(frozen=True, eq=False)
class Prediction:
    """Of one network on one episode of N+1 observations.

    Attributes:
        name: Of the network.
        camera: Whose pictures it looks at; empty if it looks at none.
        seen: The pictures as it sees them, cropped and scaled, shape (N+1, H, W, 3), uint8; or None.
        probabilities: Of the directions `svfl_data.symmetry.DIRECTIONS`, shape (N+1, 4); or None.
        actions: What it would command, shape (N+1, 5), base axes; or None.
        crop: Which part of the camera's picture `seen` is: left, top, right, bottom edge, shape (N+1, 4), [px], the
            outer corner of the top left pixel being (0, 0); or None for the middle part that `images.CROP` says.
    """

    name: str
    camera: str
    seen: np.ndarray | None = None
    probabilities: np.ndarray | None = None
    actions: np.ndarray | None = None
    crop: np.ndarray | None = None


Network = Callable[[Episode], Prediction]


def load(checkpoint: Path) -> Network:
    """Open a trained network.

    Raises:
        FormatError: If there is no such file, or it is not what its suffix says.
        UsageError: If no installed package opens files of this kind.
    """
    if not checkpoint.is_file():
        raise FormatError(f"{checkpoint}: no such file")
    known = {entry.name: entry for entry in entry_points(group=GROUP)}
    entry = known.get(checkpoint.suffix.removeprefix("."))
    if entry is None:
        kinds = ", ".join(f".{name}" for name in sorted(known)) or "none (is svfl installed, not only on the path?)"
        raise UsageError(f"--checkpoint {checkpoint}: nothing here opens files of this kind; kinds: {kinds}")
    opened: Callable[[Path], Network] = entry.load()
    return opened(checkpoint)
