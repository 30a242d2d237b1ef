"""A trained policy as one file that runs without the code that trained it: a ``torch.export`` program.

The program takes what a policy sees at one step and gives what it does:

- ``image`` (1, 4, H, W) float32: RGB 0..1, then depth in [m], 0 where nothing was seen;
- ``wrench`` (1, 64, 6) float32: the last readings, latest last, tared, [N] and [N m], base axes, about the sensor
  origin;
- ``proprio`` (1, 5) float32: gripper opening 0..1, TCP x, y, z [m], yaw [rad], base;
- out: (1, 5), gripper opening 0..1, dx, dy, dz [m], dtheta [rad], base axes.

Cropping, normalisation and the change to image axes are part of the program. A file is never unpickled (`program`).
"""

import io
import json
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svfl_data.errors import FormatError, TrainingError
from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.robot import Observation
from svfl_data.system.atomic_io import write_atomically
from svfl_models.programs.program import Program, from_bytes, read

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
FACTS = "svfl_policy.json"
"""Name, inside the file, of what the program does not say itself."""
ACTION = (1, 5)


class Facts(msgspec.Struct):
    """Content of `FACTS`."""

    depth_scale: Annotated[float, msgspec.Meta(gt=0)]


def save(network: nn.Module, file: Path, image_size: tuple[int, int], depth_scale: float = 1e-4) -> None:
    """Export a network, in eval mode, as a policy.

    Args:
        network: Maps image, wrench and proprio to an action, shapes as above.
        file: Where to; its name must end in ``.pt2``.
        image_size: Height and width of the images, [px].
        depth_scale: Metres per unit of the depth that the cameras give.

    Raises:
        TrainingError: If the network does not take or give these shapes, does what a policy's file may not say
            (`operators`), or has weights that are not finite.
        StorageError: If the disk refuses; a file that was there before is untouched.
    """
    content = exported(network, image_size, depth_scale)
    opened(content, str(file))
    write_atomically(Path(file), content)


def exported(network: nn.Module, image_size: tuple[int, int], depth_scale: float = 1e-4) -> bytes:
    """What `save` writes.

    Raises:
        TrainingError: As `save`, but for what only `opened` finds out.
    """
    inputs = tuple(torch.zeros(shape) for shape in _shapes(image_size))
    try:
        with torch.inference_mode():
            action = network.to("cpu").eval()(*inputs)
    except (RuntimeError, TypeError, ValueError) as error:
        raise TrainingError(f"the network does not take image, wrench and proprio: {_line(error)}") from error
    if not isinstance(action, Tensor) or tuple(action.shape) != ACTION:
        raise TrainingError(f"the network gives {_words(action)}, an action is {ACTION}")
    with torch.no_grad():
        program = torch.export.export(network, inputs)
    buffer = io.BytesIO()
    torch.export.save(program, buffer, extra_files={FACTS: json.dumps({"depth_scale": depth_scale})})
    return buffer.getvalue()


def opened(content: bytes, name: str) -> "ExportedPolicy":
    """A policy from what `exported` gave.

    Raises:
        TrainingError: If it is none that could be loaded again.
    """
    return ExportedPolicy(*from_bytes(content, FACTS), name)


def load(file: Path) -> "ExportedPolicy":
    """Load a policy onto this machine's device.

    Raises:
        FormatError: If the file is missing, damaged, or not a policy.
    """
    return ExportedPolicy(*read(file, FACTS), str(file))


class ExportedPolicy:
    """A policy: called with an observation, it gives an action (5,), float32.

    Attributes:
        size: Height and width of the images that it takes, [px].
        program: What runs, on `DEVICE`.
    """

    def __init__(self, program: Program, facts: str, name: str) -> None:
        """Check what the program takes and gives, and bring it to the device.

        Args:
            program: The program.
            facts: `Facts` as JSON.
            name: What to call it in messages.

        Raises:
            FormatError: If its inputs, outputs or facts are other ones.
        """
        inputs, outputs = program.inputs, program.outputs
        image = inputs[0] if inputs else ()
        self.size = (image[2], image[3]) if len(image) == 4 else (0, 0)
        if inputs != _shapes(self.size) or outputs != [ACTION]:
            raise FormatError(
                f"{name}: takes {_list(inputs)} and gives {_list(outputs)}, but a policy takes image (1, 4, H, W), "
                f"wrench (1, {WINDOW}, 6), proprio (1, 5) and gives an action {ACTION}"
            )
        try:
            scale = msgspec.json.decode(facts, type=Facts).depth_scale
        except ValueError as error:
            raise FormatError(f"{name}: {FACTS} in it is not what a policy's says: {error}") from error
        self.program = program.to(DEVICE)
        self._depth_scale, self._name = np.float32(scale), name

    @torch.inference_mode()
    def __call__(self, seen: Observation) -> NDArray[np.float32]:
        """Act on an observation.

        Raises:
            TrainingError: If the pictures are of another size than in training, or the action is not finite.
        """
        frame = next(iter(seen.frames.values()))
        if frame.depth.shape != self.size:
            (height, width), (rows, columns) = self.size, frame.depth.shape
            raise TrainingError(
                f"{self._name}: was made for images of {height} x {width} px, the first camera gives {rows} x {columns}"
            )
        image = np.empty((4, *self.size), np.float32)
        image[:3] = frame.color.transpose(2, 0, 1) / np.float32(255)
        image[3] = frame.depth * self._depth_scale
        inputs = (torch.from_numpy(np.array(part)[None]).to(DEVICE) for part in (image, seen.wrench, seen.proprio))
        action: NDArray[np.float32] = self.program(*inputs)[0][0].float().cpu().numpy()
        if not np.isfinite(action).all():
            raise TrainingError(f"{self._name}: the policy's action is not finite: {action.tolist()}")
        return action


def _shapes(image_size: tuple[int, int]) -> list[tuple[int, ...]]:
    return [(1, 4, *image_size), (1, WINDOW, 6), ACTION]


def _list(shapes: list[tuple[int, ...]]) -> str:
    return ", ".join(map(str, shapes)) or "nothing"


def _words(value: object) -> str:
    return str(tuple(value.shape)) if isinstance(value, Tensor) else type(value).__name__


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
