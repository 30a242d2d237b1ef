"""Observations of the environments, and their spaces: the paper's three arrays, or inputs of the user's own."""

from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from collectors.simulation.world import World
from svfl_data.sampling.batch import Batch
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.input_spec import PROPRIO, WRENCH, InputSpec, paper_inputs
from svfl_data.schema.robot import Frame, Observation
from svfl_data.signals.pictures import camera_picture, picture
from svfl_data.signals.topdown import topdown_frame

View = Literal["camera", "top"]


class PaperObservations:
    """Function that returns the paper's three arrays of what a world observes (`collectors.environment.Environment`).

    Attributes:
        space: Space of what is returned.
    """

    def __init__(self, world: World, camera: str, view: View, eye: float, window: int = WINDOW) -> None:
        """Prepare for a world.

        Args:
            world: The world.
            camera: Name of the camera of ``image``.
            view: View of ``image``.
            eye: Height from which the view "top" looks down, base z, [m].
            window: Number of readings of ``wrench``.
        """
        self._world, self._camera, self._view, self._eye = world, camera, view, eye
        self._cut = LiveCut(paper_inputs(camera, window=window))
        seen = world.config.cameras[camera]
        high = np.ones((4, seen.height, seen.width), np.float32)
        high[3] = 2**16 * seen.depth_scale
        reach = np.array([1.1, 2.0, 2.0, 2.0, np.pi], np.float32)  # farther than the arm can be
        self.space = spaces.Dict(
            {
                "image": spaces.Box(np.zeros_like(high), high, dtype=np.float32),
                "wrench": spaces.Box(-np.inf, np.inf, (window, 6), np.float32),
                "proprio": spaces.Box(-reach, reach, dtype=np.float32),
            }
        )

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        self._cut.forget()

    def __call__(self, seen: Observation) -> dict[str, NDArray[Any]]:
        """Return ``image``, ``wrench`` and ``proprio``.

        Args:
            seen: What the world observes now, later than before, or at the beginning of an episode.
        """
        rows = self._cut(seen)
        return {"image": self._image(rows), "wrench": rows[WRENCH][0], "proprio": rows[PROPRIO][0]}

    def _image(self, rows: Batch) -> NDArray[np.float32]:
        calibration = self._world.cameras[self._camera]
        if self._view == "camera":
            return camera_picture(rows, self._camera, calibration.depth_scale)[0]
        frame = Frame(*(rows[f"cameras/{self._camera}/{leaf}"][0, -1] for leaf in ("color", "depth")))
        color, depth = topdown_frame(frame, calibration, self._world.workspace, size=len(frame.color), eye=self._eye)
        return picture({"color": color, "depth": depth}, calibration.depth_scale)


class InputObservations:
    """Function that returns inputs of the user's own, by path, of what a world observes.

    Attributes:
        space: Space of what is returned.
    """

    def __init__(self, world: World, inputs: InputSpec) -> None:
        """Find the space of the inputs, whose shapes an observation of the empty table has.

        Args:
            world: The world, which is reset.
            inputs: What is observed.

        Raises:
            FieldError: If the world does not observe one of the inputs.
        """
        self._cut = LiveCut(inputs)
        world.reset(seed=0)
        found = self(world.observe())
        limits = {path: _limits(values.dtype) for path, values in found.items()}
        self.space = spaces.Dict(
            {path: spaces.Box(*limits[path], values.shape, values.dtype.type) for path, values in found.items()}
        )

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        self._cut.forget()

    def __call__(self, seen: Observation) -> dict[str, NDArray[Any]]:
        """Return the inputs by path.

        Args:
            seen: What the world observes now, later than before, or at the beginning of an episode.
        """
        values = self._cut(seen)
        return {path: rows[0] for path, rows in values.items() if not path.endswith(("/padding", "/age"))}


def _limits(dtype: np.dtype) -> tuple[float, float]:
    return (0, np.iinfo(dtype).max) if dtype.kind == "u" else (-np.inf, np.inf)
