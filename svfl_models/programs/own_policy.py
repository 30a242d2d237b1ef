"""A trained policy with inputs and an action of the user's own, as one file that runs without the code that trained it.

The file is a ``torch.export`` program, as that of `exported_policy`. Its inputs and their order, the components of the
action and their bounds are facts inside the file, so that a robot can be asked for what the policy needs. A file is
never unpickled (see `program`).
"""

import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from zipfile import BadZipFile

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from svfl_data.errors import FormatError, TrainingError
from svfl_data.schema.action_fields import ACTION
from svfl_data.signals.pictures import BRIGHTEST, DEPTH, picture
from svfl_data.system.printable import printable
from svfl_data.system.stored_zip import stored
from svfl_models.programs.program import Program, from_bytes, read
from svfl_models.programs.program_file import EXTRA

DEVICE = torch.device("cuda" if torch.cuda.is_available() else "cpu")
FACTS = "svfl_own_policy.json"
"""Name of the text inside the file that holds the facts, see `Facts`."""


class InputFacts(msgspec.Struct):
    """What a policy takes as one of its inputs.

    Attributes:
        path: Group of the camera, or path of the array, as in an episode: ``cameras/front``,
            ``streams/wrench/wrench``, ``observations/proprio``. After a camera that moves comes
            ``cameras/wrist/image_axes``: the matrix from base (x, y) to image (right, up) when the image was taken
            (`svfl_data.image_axes`).
        shape: Shape of the values: images (channels, H, W), image axes (2, 2), windows (T, C), vectors (C,).
        images: Arrays of a camera that make up the channels, in their order: ``color``, ``grey``, ``grey16``,
            ``depth``.
        depth_scale: Metres per unit of recorded depth.
        rate_hz: Rate of a window, [Hz]; None if it does not matter.
    """

    path: str
    shape: tuple[int, ...]
    images: tuple[str, ...] = ()
    depth_scale: float = 1.0
    rate_hz: float | None = None


class Facts(msgspec.Struct):
    """Content of the text `FACTS`.

    Attributes:
        inputs: Inputs of the program, in their order.
        components: Names of the components of the action.
        low: Smallest command of each component.
        high: Largest command of each component.
        step_ms: Time between two actions, [ms]; 0 if it is unknown.
        action: Path of the action in episodes.
    """

    inputs: list[InputFacts]
    components: list[str]
    low: list[float]
    high: list[float]
    step_ms: float = 0.0
    action: str = ACTION


def exported(network: nn.Module, facts: Facts) -> bytes:
    """Export a network, in eval mode, and return the content of its file.

    Args:
        network: Network that maps the inputs of `facts`, each with a batch dimension, to an action. It is moved to the
            CPU and put into eval mode.
        facts: What the policy takes and gives.

    Raises:
        TrainingError: If the network does not take these inputs or give this action.
    """
    inputs = tuple(torch.zeros(1, *one.shape) for one in facts.inputs)
    try:
        with torch.inference_mode():
            action = network.to("cpu").eval()(*inputs)
    except (RuntimeError, TypeError, ValueError) as error:
        raise TrainingError(f"the network does not take its inputs: {' '.join(str(error).split())[:200]}") from error
    if not isinstance(action, Tensor) or tuple(action.shape) != (1, len(facts.low)):
        raise TrainingError(f"the network does not give an action of {len(facts.low)} components")
    with torch.no_grad():
        program = torch.export.export(network, inputs)
    buffer = io.BytesIO()
    torch.export.save(program, buffer, extra_files={FACTS: json.dumps(msgspec.to_builtins(facts))})
    return buffer.getvalue()


def opened(content: bytes, name: str) -> "OwnPolicy":
    """Open a policy from the content that `exported` returned.

    Args:
        content: Content of the file.
        name: Name of the policy in messages.

    Raises:
        TrainingError: If the content could not be loaded again as a program.
        FormatError: If inputs, output and facts do not fit each other.
    """
    return OwnPolicy(*from_bytes(content, FACTS), name)


def is_own(file: Path) -> bool:
    """Return whether a file holds a policy with inputs of the user's own; false also if it cannot be read.

    Args:
        file: File of an exported network (``.pt2``).
    """
    try:
        with stored(file) as archive:
            return any(name.endswith(f"/{EXTRA}{FACTS}") for name in archive.members)
    except (OSError, FormatError, BadZipFile):
        return False


def load(file: Path) -> "OwnPolicy":
    """Load a policy onto `DEVICE`: the GPU if there is one, otherwise the CPU.

    Args:
        file: File of the policy (``.pt2``).

    Raises:
        FormatError: If the file is missing, damaged, or not such a policy.
    """
    return OwnPolicy(*read(file, FACTS), str(file))


class OwnPolicy:
    """A policy that, when called with values by path, returns an action, shape (C,), float32.

    Attributes:
        facts: What the policy takes and gives.
        program: Program that computes the action, on `DEVICE`.
    """

    def __init__(self, program: Program, facts: str, name: str) -> None:
        """Check the inputs, the output and the facts of a program, and move it to `DEVICE`.

        Args:
            program: Program that computes the action.
            facts: JSON text of the program's `Facts`.
            name: Name of the policy in messages.

        Raises:
            FormatError: If they do not fit each other.
        """
        try:
            self.facts = msgspec.json.decode(facts, type=Facts)
        except (ValueError, RecursionError) as error:
            raise FormatError(f"{name}: {FACTS} in it is not what a policy's says: {printable(error)}") from error
        count = len(self.facts.components)
        shapes = [(1, *one.shape) for one in self.facts.inputs]
        if program.inputs != shapes or program.outputs != [(1, count)] or not _bounds(self.facts):
            raise FormatError(f"{name}: takes {program.inputs} and gives {program.outputs}, but says {shapes}, {count}")
        for one in self.facts.inputs:
            if len(one.shape) != _axes(one) or 0 in one.shape or (one.images and one.shape[0] != _channels(one)):
                raise FormatError(f"{name}: {printable(one.path, 60)} cannot have the shape {one.shape} that it says")
        self.program, self._name = program.to(DEVICE), name

    @torch.inference_mode()
    def __call__(self, values: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float32]:
        """Return the action for what is observed now, within its bounds.

        Args:
            values: Values by path, as recorded: images ``cameras/NAME/color`` (H, W, 3) uint8, ``.../grey`` (H, W)
                uint8, ``.../grey16`` and ``.../depth`` (H, W) uint16, or several with the latest last, as in a sample;
                windows (T, ...), tared, latest last; vectors (C,). Image axes ``cameras/NAME/image_axes`` (2, 2) of
                cameras that move. Further entries are ignored.

        Raises:
            TrainingError: If a value is missing or has another shape, or the action is not finite.
        """
        inputs = [torch.from_numpy(self._value(one, values)[None]).to(DEVICE) for one in self.facts.inputs]
        action: NDArray[np.float32] = self.program(*inputs)[0][0].float().cpu().numpy()
        if not np.isfinite(action).all():
            raise TrainingError(f"{self._name}: the policy's action is not finite: {action.tolist()}")
        return np.clip(action, self.facts.low, self.facts.high).astype(np.float32)

    def _value(self, one: InputFacts, values: Mapping[str, NDArray[np.generic]]) -> NDArray[np.float32]:
        paths = [f"{one.path}/{leaf}" for leaf in one.images] or [one.path]
        for path in paths:
            if path not in values:
                have = ", ".join(map(printable, values)) or "nothing"
                raise TrainingError(f"{self._name}: takes {printable(path)}; this robot gives {have}")
        if one.images:
            images = {leaf: _latest(leaf, np.asarray(values[f"{one.path}/{leaf}"])) for leaf in one.images}
            for leaf, image in images.items():
                self._expect(f"{one.path}/{leaf}", image, (*one.shape[1:], 3)[: _image_axes(leaf)])
            return picture(images, one.depth_scale)
        found = np.asarray(values[one.path], np.float32)
        found = found.reshape(one.shape) if found.size == int(np.prod(one.shape)) else found
        self._expect(one.path, found, one.shape)
        return np.ascontiguousarray(found)

    def _expect(self, path: str, found: NDArray[np.generic], shape: tuple[int, ...]) -> None:
        if found.shape != shape:
            raise TrainingError(f"{self._name}: {printable(path)} has shape {found.shape}, expected {shape}")


def _latest(leaf: str, images: NDArray[np.generic]) -> NDArray[np.generic]:
    return images[-1] if images.ndim > _image_axes(leaf) and len(images) else images


def _image_axes(leaf: str) -> int:
    return 3 if leaf == "color" else 2


def _axes(one: InputFacts) -> int:
    """Return the number of axes of an input: images three, windows and the axes of an image two, vectors one."""
    if one.images:
        return 3
    return 2 if one.path.startswith(("streams/", "cameras/")) else 1


def _channels(one: InputFacts) -> int:
    """Return the number of channels of an image; 0 if one of its kinds is unknown, or named twice."""
    known = set(one.images) <= {*BRIGHTEST, DEPTH} and len(set(one.images)) == len(one.images)
    return sum(3 if leaf == "color" else 1 for leaf in one.images) if known else 0


def _bounds(facts: Facts) -> bool:
    lengths: Sequence[int] = (len(facts.components), len(facts.low), len(facts.high))
    return len(set(lengths)) == 1 and all(low < high for low, high in zip(facts.low, facts.high, strict=True))
