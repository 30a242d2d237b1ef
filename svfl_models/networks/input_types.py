"""Inputs of a network: images, sequences and vectors, each with the way in which it transforms."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import msgspec

from svfl_data.errors import TrainingError
from svfl_data.symmetry import PROPRIO_PARTS, Part
from svfl_models.symmetry.actions import Action, act_on_image, act_on_invariant, act_on_parts
from svfl_models.symmetry.representations import wrench_parts

COLOUR_AND_DEPTH = 4


@dataclass(frozen=True)
class ImageInput:
    """Square images of one camera.

    Attributes:
        name: Key of the images in a batch, shape (B, channels, H, H).
        channels: Number of channels: 4 for colour and depth, 3 for colour, 1 for grey or depth alone.
        moves: How the image transforms: ``pixels`` if it turns with the world (a camera that stands still, or an image
            that was turned into the axes of the base), ``invariant`` if it does not (a camera on the gripper whose
            images are taken as they are, because it turns with the gripper).
    """

    name: str = "image"
    channels: int = COLOUR_AND_DEPTH
    moves: Literal["pixels", "invariant"] = "pixels"


@dataclass(frozen=True)
class SequenceInput:
    """Window of readings, latest last.

    Attributes:
        name: Key of the windows in a batch, shape (B, length, C).
        parts: Parts of the C components of a reading.
        length: Number of readings, T.
    """

    name: str
    parts: tuple[Part, ...]
    length: int


@dataclass(frozen=True)
class VectorInput:
    """Vector of numbers.

    Attributes:
        name: Key of the vectors in a batch, shape (B, C).
        parts: Parts of the C components.
    """

    name: str
    parts: tuple[Part, ...]


NetworkInput = ImageInput | SequenceInput | VectorInput
_KINDS = {"image": ImageInput, "sequence": SequenceInput, "vector": VectorInput}


def paper_inputs(letters: str, window: int = 64, torque: str = "axial") -> tuple[NetworkInput, ...]:
    """Return the paper's inputs by their short names.

    Args:
        letters: ``v`` for the image of colour and depth, ``f`` for the wrench window, ``p`` for proprioception, or
            several of them, in this order.
        window: Number of readings T per wrench window.
        torque: How a torque transforms: ``axial``, or the paper's ``polar`` (see `representations.wrench_parts`).

    Raises:
        TrainingError: If there is no such input.
    """
    known: dict[str, NetworkInput] = {
        "v": ImageInput(),
        "f": SequenceInput("wrench", wrench_parts(torque), window),
        "p": VectorInput("proprio", PROPRIO_PARTS),
    }
    if unknown := set(letters) - set(known):
        raise TrainingError(f"unknown input {''.join(sorted(unknown))!r}; possible: {', '.join(known)}")
    return tuple(one for letter, one in known.items() if letter in letters)


def actions_of(inputs: Sequence[NetworkInput]) -> dict[str, Action]:
    """Return the action of rotations and reflections on each input, by its name (`svfl_models.symmetry.actions`).

    Args:
        inputs: Inputs of a network.
    """
    return {
        one.name: act_on_parts(one.parts)
        if not isinstance(one, ImageInput)
        else (act_on_image if one.moves == "pixels" else act_on_invariant)
        for one in inputs
    }


def plain_inputs(inputs: Sequence[NetworkInput]) -> list[dict[str, Any]]:
    """Return inputs as plain values for files."""
    kinds = {kind: name for name, kind in _KINDS.items()}
    return [{"kind": kinds[type(one)], **asdict(one)} for one in inputs]


def inputs_of_plain(values: Sequence[dict[str, Any]]) -> tuple[NetworkInput, ...]:
    """Restore inputs from the plain values that `plain_inputs` returned.

    Raises:
        TrainingError: If the values are not those of inputs.
    """
    try:
        return tuple(
            msgspec.convert({k: v for k, v in one.items() if k != "kind"}, _KINDS[one["kind"]]) for one in values
        )
    except (KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
        raise TrainingError(f"the inputs of a network cannot be read ({error})") from error
