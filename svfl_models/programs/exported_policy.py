"""A trained policy as one file that runs without the code that trained it: a ``torch.export`` program.

The program takes the observation of one step and returns an action. Its inputs, in their order, are:

- ``image`` (1, 4, H, W) float32: RGB 0..1, then depth in [m], which is 0 where nothing was seen;
- ``wrench`` (1, T, 6) float32: the last T readings, latest last, tared, [N] and [N m], in base axes, about the sensor
  origin;
- ``proprio`` (1, 5) float32: gripper opening 0..1, TCP x, y, z [m], yaw [rad], in the base frame.

Its output has shape (1, 5): gripper opening 0..1, dx, dy, dz [m], dtheta [rad], in base axes.

Cropping, normalisation and the change to image-aligned axes are part of the program. A file is never unpickled (see
`program`).
"""

import io
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svfl_data.errors import FormatError, TrainingError
from svfl_data.sampling.live_cut import LiveCut
from svfl_data.schema.input_spec import PROPRIO, WINDOW, WRENCH, paper_inputs
from svfl_data.schema.observation import Frame, Observation
from svfl_data.signals.pictures import camera_picture
from svfl_data.system.atomic_io import write_atomically
from svfl_data.system.printable import printable
from svfl_models.programs.program import Program, from_bytes, read

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
FACTS = "svfl_policy.json"
"""Name of a text inside the file that holds the facts which the program itself does not state, see `Facts`."""
ACTION = (1, 5)


class Facts(msgspec.Struct):
    """Content of the text `FACTS` in the file of a policy.

    Attributes:
        depth_scale: Metres per unit of the camera's depth images, above 0.
        camera: Name of the camera whose images the policy takes; empty if it uses no images. None if the name does not
            matter, because the robot has one camera.
        wrench_hz: Rate of the wrench readings that the policy learned from, [Hz], above 0. None if it does not matter.
    """

    depth_scale: Annotated[float, msgspec.Meta(gt=0)]
    camera: str | None = None
    wrench_hz: Annotated[float, msgspec.Meta(gt=0)] | None = None


def save(
    network: nn.Module,
    file: Path,
    image_size: tuple[int, int],
    depth_scale: float = 1e-4,
    camera: str | None = None,
    wrench_hz: float | None = None,
    window: int = WINDOW,
) -> None:
    """Export a network, in eval mode, as the file of a policy.

    Args:
        network: Network that maps image, wrench and proprio to an action, with the shapes that this module's
            docstring lists. It is moved to the CPU and put into eval mode.
        file: File to write, whose name must end in ``.pt2``.
        image_size: Height and width of the images, [px].
        depth_scale: Metres per unit of the camera's depth images.
        camera: Name of the camera whose images the network takes, see `Facts`.
        wrench_hz: Rate of the wrench readings, [Hz], see `Facts`.
        window: Number T of readings of the wrench window.

    Raises:
        TrainingError: If the network does not take or return these shapes, uses operators that an exported policy may
            not use (see `operators`), or has weights that are not finite.
        FormatError: If `depth_scale` or `wrench_hz` is not above 0.
        StorageError: If the file cannot be written; an earlier file then stays as it was.
    """
    content = exported(network, image_size, depth_scale, camera, wrench_hz, window=window)
    opened(content, str(file))
    write_atomically(Path(file), content)


def exported(
    network: nn.Module,
    image_size: tuple[int, int],
    depth_scale: float = 1e-4,
    camera: str | None = None,
    wrench_hz: float | None = None,
    texts: Mapping[str, str] | None = None,
    window: int = WINDOW,
) -> bytes:
    """Export a network, in eval mode, and return the content of the file that `save` writes.

    Args:
        network: Network that maps image, wrench and proprio to an action, see `save`. It is moved to the CPU and put
            into eval mode.
        image_size: Height and width of the images, [px].
        depth_scale: Metres per unit of the camera's depth images.
        camera: Name of the camera whose images the network takes, see `Facts`.
        wrench_hz: Rate of the wrench readings, [Hz], see `Facts`.
        texts: Further texts to keep in the file, by name; None for none.
        window: Number T of readings of the wrench window.

    Raises:
        TrainingError: If the network does not take image, wrench and proprio, or does not return an action. Forbidden
            operators and weights that are not finite are found by `opened` only.
    """
    inputs = tuple(torch.zeros(shape) for shape in _shapes(image_size, window))
    try:
        with torch.inference_mode():
            action = network.to("cpu").eval()(*inputs)
    except (RuntimeError, TypeError, ValueError) as error:
        raise TrainingError(f"the network does not take image, wrench and proprio: {_line(error)}") from error
    if not isinstance(action, Tensor) or tuple(action.shape) != ACTION:
        raise TrainingError(f"the network gives {_words(action)}, an action is {ACTION}")
    with torch.no_grad():
        program = torch.export.export(network, inputs)
    buffer, facts = io.BytesIO(), {"depth_scale": depth_scale, "camera": camera}
    if wrench_hz is not None:
        facts["wrench_hz"] = wrench_hz
    torch.export.save(program, buffer, extra_files={FACTS: json.dumps(facts), **(texts or {})})
    return buffer.getvalue()


def opened(content: bytes, name: str) -> "ExportedPolicy":
    """Open a policy from the content that `exported` returned.

    Args:
        content: Content of the file.
        name: Name of the policy in messages.

    Raises:
        TrainingError: If the content could not be loaded again as a program.
        FormatError: If the inputs, outputs or facts of the program are not those of a policy.
    """
    return ExportedPolicy(*from_bytes(content, FACTS), name)


def load(file: Path) -> "ExportedPolicy":
    """Load a policy onto `DEVICE`: the GPU if there is one, otherwise the CPU.

    Args:
        file: File of the policy (``.pt2``).

    Raises:
        FormatError: If the file is missing, damaged, or not a policy.
    """
    return ExportedPolicy(*read(file, FACTS), str(file))


class ExportedPolicy:
    """A policy that, when called with an observation, returns an action, shape (5,), float32.

    Its inputs are cut from the observations as those of its training were cut from episodes, so it must be given all
    observations of an episode in their order (`svfl_data.sampling.live_cut.LiveCut`), or `act` values that are cut.

    Attributes:
        size: Height and width of the images that the policy takes, [px].
        window: Number of readings of its wrench window.
        camera: Name of the camera whose images the policy takes, see `Facts`.
        program: Program that computes the action, on `DEVICE`.
    """

    def __init__(self, program: Program, facts: str, name: str) -> None:
        """Check the inputs, outputs and facts of a program, and move it to `DEVICE`.

        Args:
            program: Program that computes the action.
            facts: JSON text of the program's `Facts`.
            name: Name of the policy in messages.

        Raises:
            FormatError: If the inputs, outputs or facts are not those of a policy.
        """
        inputs, outputs = program.inputs, program.outputs
        image = inputs[0] if inputs else ()
        self.size = (image[2], image[3]) if len(image) == 4 else (0, 0)
        self.window = inputs[1][1] if len(inputs) > 1 and len(inputs[1]) == 3 else 0
        if not self.window or inputs != _shapes(self.size, self.window) or outputs != [ACTION]:
            raise FormatError(
                f"{name}: takes {_list(inputs)} and gives {_list(outputs)}, but a policy takes image (1, 4, H, W), "
                f"wrench (1, T, 6), proprio (1, 5) and gives an action {ACTION}"
            )
        try:
            known = msgspec.json.decode(facts, type=Facts)
        except ValueError as error:
            raise FormatError(f"{name}: {FACTS} in it is not what a policy's says: {error}") from error
        self.program = program.to(DEVICE)
        self.camera, self._known, self._name = known.camera, known, name
        self._cut: LiveCut | None = None

    def forget(self) -> None:
        """Forget the past, because another episode begins."""
        self._cut = None

    def __call__(self, seen: Observation) -> NDArray[np.float32]:
        """Return the action for an observation.

        Args:
            seen: Observation of the current step. Of its images, those of the policy's own camera are used.

        Returns:
            The action, shape (5,), float32: gripper opening 0..1, dx, dy, dz [m], dtheta [rad], in base axes.

        Raises:
            TrainingError: If the observation has no image of the policy's camera, the image has no depth or has another
                size than in training, or the action is not finite.
            FieldError: If the robot observes no wrench or no proprioception.
            DatasetError: If the wrench readings come at another rate than in training.
        """
        camera = self._camera_of(seen.frames)
        inputs = paper_inputs(camera, self._known.wrench_hz, self.window)
        if self._cut is None or self._cut.inputs != inputs:
            self._cut = LiveCut(inputs)
        return self.act(self._cut(seen), camera)

    @torch.inference_mode()
    def act(self, cut: Mapping[str, NDArray[Any]], camera: str) -> NDArray[np.float32]:
        """Return the action for values that are cut, shape (5,), float32, as for an observation.

        Args:
            cut: Values of `svfl_data.schema.input_spec.paper_inputs` at one observation, each of shape (1, ...).
            camera: Name of the camera, which must have depth; empty if the policy uses no images.

        Raises:
            TrainingError: If the image has another size than in training, or the action is not finite.
        """
        image = np.zeros((1, 4, *self.size), np.float32)
        if camera:
            image = camera_picture(cut, camera, self._known.depth_scale)
            self._expect_size(camera, image.shape[-2:])
        parts = (image, cut[WRENCH], cut[PROPRIO])
        inputs = (torch.from_numpy(np.asarray(part, np.float32)).to(DEVICE) for part in parts)
        action: NDArray[np.float32] = self.program(*inputs)[0][0].float().cpu().numpy()
        if not np.isfinite(action).all():
            raise TrainingError(f"{self._name}: the policy's action is not finite: {action.tolist()}")
        return action

    def _camera_of(self, frames: Mapping[str, Frame]) -> str:
        """Return the name of the camera whose images the program takes; empty if it takes none."""
        if self.camera == "":
            return ""
        name = only_camera(frames) if self.camera is None else self.camera
        if name is None or name not in frames:
            have = ", ".join(map(printable, frames)) or "none"
            wanted = printable(name, 40) if name else "one camera"
            raise TrainingError(f"{self._name}: takes images of {wanted}; the cameras of this robot are: {have}")
        depth = frames[name].depth
        if depth is None:
            raise TrainingError(f"{self._name}: takes images with depth; camera {name} of this robot gives none")
        self._expect_size(name, depth.shape)
        return name

    def _expect_size(self, camera: str, found: tuple[int, ...]) -> None:
        if found != self.size:
            (height, width), (rows, columns) = self.size, found
            raise TrainingError(
                f"{self._name}: was made for images of {height} x {width} px, camera {camera} gives {rows} x {columns}"
            )


def only_camera(cameras: Iterable[str]) -> str | None:
    """Return the name of the only camera; None if there is not exactly one."""
    names = list(cameras)
    return names[0] if len(names) == 1 else None


def _shapes(image_size: tuple[int, int], window: int) -> list[tuple[int, ...]]:
    return [(1, 4, *image_size), (1, window, 6), ACTION]


def _list(shapes: list[tuple[int, ...]]) -> str:
    return ", ".join(map(str, shapes)) or "nothing"


def _words(value: object) -> str:
    return str(tuple(value.shape)) if isinstance(value, Tensor) else type(value).__name__


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
