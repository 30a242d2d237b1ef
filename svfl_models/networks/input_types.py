"""Inputs of a network: images, sequences and vectors, each with the way in which it transforms."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Literal

import msgspec

from svfl_data.errors import TrainingError
from svfl_data.symmetry import PROPRIO_PARTS, Kind, Part
from svfl_models.symmetry.actions import Action, act_on_image, act_on_invariant, act_on_parts
from svfl_models.symmetry.representations import wrench_parts

COLOUR_AND_DEPTH = 4
MOST_COMPONENTS = 2**16
"""Largest number of components of an input that is read from a file."""


@dataclass(frozen=True)
class ImageInput:
    """Square images of one camera.

    Attributes:
        name: Key of the images in a batch, shape (B, channels, H, H).
        channels: Number of channels: 4 for colour and depth, 3 for colour, 1 for grey or depth alone.
        moves: How the image transforms: ``pixels`` if it rotates with the scene (a fixed camera, or an image
            that was rotated into the axes of the base), ``invariant`` if it does not (a camera on the gripper whose
            images are taken as they are, because it rotates with the gripper).
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


PlainParts = list[tuple[Kind, list[tuple[int, int]]]]
"""Parts as plain values: the kind, and the indices as ranges, each of first index and index after the last one."""


def plain_parts(parts: Sequence[Part]) -> list[Any]:
    """Return parts as plain values (`PlainParts`), which are short however many components there are."""
    found = []
    for part in parts:
        ranges: list[list[int]] = []
        for index in part.index:
            if ranges and ranges[-1][1] == index:
                ranges[-1][1] += 1
            else:
                ranges.append([index, index + 1])
        found.append([part.kind, ranges])
    return found


def parts_of_plain(values: PlainParts) -> tuple[Part, ...]:
    """Restore parts from their plain values.

    Raises:
        TrainingError: If there are more components than any input has.
    """
    if sum(stop - first for _, ranges in values for first, stop in ranges) > MOST_COMPONENTS:
        raise TrainingError(f"an input of a network has more than {MOST_COMPONENTS} components")
    return tuple(Part(kind, tuple(index for pair in ranges for index in range(*pair))) for kind, ranges in values)


def plain_inputs(inputs: Sequence[NetworkInput]) -> list[dict[str, Any]]:
    """Return inputs as plain values for files."""
    kinds = {kind: name for name, kind in _KINDS.items()}
    found = []
    for one in inputs:
        values = {field.name: getattr(one, field.name) for field in fields(one)}
        if not isinstance(one, ImageInput):
            values["parts"] = plain_parts(one.parts)
        found.append({"kind": kinds[type(one)], **values})
    return found


def inputs_of_plain(values: Sequence[dict[str, Any]]) -> tuple[NetworkInput, ...]:
    """Restore inputs from the plain values that `plain_inputs` returned.

    Raises:
        TrainingError: If the values are not those of inputs.
    """
    try:
        return tuple(_input_of_plain(one) for one in values)
    except (KeyError, TypeError, AttributeError, msgspec.ValidationError) as error:
        raise TrainingError(f"the inputs of a network cannot be read ({error})") from error


def _input_of_plain(values: dict[str, Any]) -> NetworkInput:
    given = {key: value for key, value in values.items() if key != "kind"}
    kind = _KINDS[values["kind"]]
    if kind is not ImageInput:
        given["parts"] = parts_of_plain(msgspec.convert(given["parts"], PlainParts))
    return msgspec.convert(given, kind)
