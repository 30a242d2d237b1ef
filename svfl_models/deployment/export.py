"""Export of a trained block-centering network to files that need no escnn: a ``torch.export`` program, or ONNX.

Files of both formats have the inputs and outputs of `CenteringClassifier`, for any number of samples at once. A JSON
text inside the file, named `FACTS`, states axes, units, crop and names of the directions. ``docs/run_exported.py`` runs
such files with neither escnn nor this package.
"""

import copy
import io
import json
import logging
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.export import Dim, ExportedProgram

from svfl_data.errors import TrainingError, UsageError
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.atomic_io import write_atomically
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.centering.latent_trunk import LatentTrunk
from svfl_models.deployment.onnx_file import missing
from svfl_models.programs.program import TOLERANCE, from_bytes
from svfl_models.symmetry.actions import Batch
from svfl_models.symmetry.ordinary import plain

FACTS = "svfl_centering.json"
"""Name of a text inside an exported file that holds the facts which the program itself does not state, see `facts`."""
FORMAT = "svfl-centering-exported"
FORMAT_VERSION = "1.0"
CONTENTS = {
    "image": "red, green, blue in 0..1, then depth in [m]; rows run downwards",
    "wrench": "the last readings, latest last, tared: force [N], then torque [N m] about the sensor origin",
}


def save_program(
    classifier: CenteringClassifier,
    path: Path,
    view: str = "camera",
    camera: str | None = None,
    texts: Mapping[str, str] | None = None,
) -> float:
    """Write a network as a ``torch.export`` program, which `program.read` and `torch.export.load` can open.

    A `program.Program` is called with the inputs in their order; PyTorch's own program takes a dictionary of them.

    Args:
        classifier: Network to export, which is not changed.
        path: File to write. An existing file is replaced after the new one has been tested.
        view: View that the network was trained on: ``camera`` for images as taken, ``top`` for the view from above.
        camera: Name of the camera that the network was trained on; None if it is unknown or does not matter.
        texts: Further texts to keep in the file, by name, such as its provenance; None for none.

    Returns:
        Largest difference between the outputs of file and network on random inputs, relative to the largest output.

    Raises:
        TrainingError: If the network cannot be exported, or the outputs differ by more than rounding.
        StorageError: If the file cannot be written.
    """
    buffer, kept = io.BytesIO(), {FACTS: json.dumps(facts(classifier, view, camera), indent=2), **(texts or {})}
    torch.export.save(_program(classifier), buffer, extra_files=kept)
    content = buffer.getvalue()
    program, _ = from_bytes(content, FACTS)

    def run(batch: Batch) -> Tensor:
        (output,) = program(*batch.values())
        return output

    difference = _tried(classifier, run, path)
    write_atomically(path, content)
    return difference


def save_onnx(
    classifier: CenteringClassifier,
    path: Path,
    view: str = "camera",
    camera: str | None = None,
    texts: Mapping[str, str] | None = None,
) -> float:
    """Write a network as ONNX, which takes its inputs by their names.

    Args:
        classifier: Network to export, which is not changed.
        path: File to write. An existing file is replaced after the new one has been tested.
        view: View that the network was trained on: ``camera`` for images as taken, ``top`` for the view from above.
        camera: Name of the camera that the network was trained on; None if it is unknown or does not matter.
        texts: Further texts to keep in the file, by name, such as its provenance; None for none.

    Returns:
        Largest difference between the outputs of file and network on random inputs, relative to the largest output.

    Raises:
        TrainingError: If the packages for ONNX are missing, the network cannot be exported, or the outputs differ by
            more than rounding.
        StorageError: If the file cannot be written.
    """
    try:
        import onnxruntime
        import onnxscript  # noqa: F401 - torch needs it later, and would say so in a longer message
    except ImportError as error:
        raise missing(error) from error
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)  # warns of missing torchvision, not needed here
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*LeafSpec", category=FutureWarning)  # about torch's own code
        program = torch.onnx.export(
            _program(classifier),
            input_names=list(inputs(classifier)),
            output_names=[_output(classifier)],
            verbose=False,
        )
    assert program is not None  # it is None only if `export` writes a file
    program.model.metadata_props.update({FACTS: json.dumps(facts(classifier, view, camera)), **(texts or {})})
    content = program.model_proto.SerializeToString()
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])

    def run(batch: Batch) -> Tensor:
        return torch.from_numpy(session.run(None, {name: values.numpy() for name, values in batch.items()})[0])

    difference = _tried(classifier, run, path)
    write_atomically(path, content)
    return difference


Saver = Callable[[CenteringClassifier, Path, str, str | None, Mapping[str, str] | None], float]
SAVERS: dict[str, Saver] = {".pt2": save_program, ".onnx": save_onnx}
"""Functions that export a network, by the suffix of the file that they write."""


def saver(path: Path) -> Saver:
    """Return the function that writes the format of a file: `save_program` or `save_onnx`.

    Args:
        path: File to write, whose suffix is one of `SAVERS`.

    Raises:
        UsageError: If the suffix is none of these.
    """
    if path.suffix not in SAVERS:
        raise UsageError(
            f"{path}: cannot export to {path.suffix or 'a file without suffix'}; possible: {', '.join(SAVERS)}"
        )
    return SAVERS[path.suffix]


def inputs(classifier: CenteringClassifier) -> dict[str, tuple[int, ...]]:
    """Return the shapes of a network's inputs by their names, without the number of samples.

    Args:
        classifier: Network that takes images, wrench windows or both.

    Raises:
        TrainingError: If the network is built on a latent encoder, which cannot be exported.
    """
    trunk = classifier.trunk
    if isinstance(trunk, LatentTrunk):
        raise TrainingError("a classifier on a latent encoder cannot be exported; those of V, F and V+F can")
    found: dict[str, tuple[int, ...]] = {}
    found |= {name: trunk.shape(name) for name in trunk.inputs}
    return found


def facts(classifier: CenteringClassifier, view: str = "camera", camera: str | None = None) -> dict[str, Any]:
    """Return the facts that are needed to run an exported network, as plain values.

    Args:
        classifier: Network that is exported.
        view: View that the network was trained on: ``camera`` for images as taken, ``top`` for the view from above.
        camera: Name of the camera that the network was trained on; None if it is unknown or does not matter.

    Raises:
        TrainingError: If the network is built on a latent encoder, which cannot be exported.
    """
    size = classifier.trunk.image_size
    means = (
        "scores of the directions"
        if classifier.target == "direction"
        else "where the block's centre is, right and up, [m]"
    )
    width = len(DIRECTIONS) if classifier.target == "direction" else 2
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "inputs": {
            name: {"shape": ["samples", *shape], "dtype": "float32", "content": CONTENTS[name]}
            for name, shape in inputs(classifier).items()
        },
        "output": {"name": _output(classifier), "shape": ["samples", width], "content": means},
        "target": classifier.target,
        "directions": list(DIRECTIONS),
        "axes": "image-aligned, x right, y up: (a camera's image_axes) @ (x, y of the robot's base)",
        "group": classifier.group.name,
        "image_size": size,
        "crop": {
            "share": classifier.trunk.crop,
            "rule": f"the middle square of side max({size}, round(share * side)); if larger than {size}, "
            "scaled down, bilinear with antialiasing",
        },
        "view": view,
        "camera": camera,
    }


def random_batch(classifier: CenteringClassifier, samples: int) -> Batch:
    """Return random inputs with the mean and scale of the inputs that a network was trained on.

    Args:
        classifier: Network that takes the inputs.
        samples: Number of samples.

    Returns:
        The inputs by name, in physical units. They are the same in every call.

    Raises:
        TrainingError: If the network is built on a latent encoder, which cannot be exported.
    """
    generator, normalization = torch.Generator().manual_seed(0), classifier.trunk.normalization
    batch = {name: torch.randn(samples, *shape, generator=generator) for name, shape in inputs(classifier).items()}
    if "image" in batch:
        mean, scale = (values[:, None, None] for values in (normalization.mean("image"), normalization.scale("image")))
        batch["image"] = batch["image"] * scale.cpu() + mean.cpu()
    if "wrench" in batch:
        batch["wrench"] = batch["wrench"] * normalization.scale("wrench").cpu() + normalization.mean("wrench").cpu()
    return batch


def _output(classifier: CenteringClassifier) -> str:
    return "scores" if classifier.target == "direction" else "offset"


def _program(classifier: CenteringClassifier) -> ExportedProgram:
    batch = random_batch(classifier, 2)
    with torch.no_grad():
        any_number = {name: {0: Dim.DYNAMIC} for name in batch}
        return torch.export.export(plain(classifier).to("cpu"), (batch,), dynamic_shapes=(any_number,))


@torch.no_grad()
def _tried(classifier: CenteringClassifier, run: Callable[[Batch], Tensor], path: Path) -> float:
    """Return the largest relative difference between the outputs of an export and its network, on 1 and 16 samples.

    Raises:
        TrainingError: If the difference is more than rounding.
    """
    batch = random_batch(classifier, 16)
    expected = copy.deepcopy(classifier).to("cpu").eval()(batch)
    size = expected.abs().max().clamp(min=torch.finfo(torch.float32).tiny)  # all outputs can be zero
    alone = run({name: values[:1] for name, values in batch.items()})
    difference = torch.cat([run(batch) - expected, alone - expected[:1]])
    worst = float(difference.abs().max() / size)  # NaN if an output is NaN
    if not worst < TOLERANCE:
        raise TrainingError(f"{path}: not written, its outputs differ from the network's by {worst:.1g} (relative)")
    return worst
