"""Description of a checkpoint or an exported network: configuration, inputs, network, data, provenance, results.

The files may come from anybody. Checkpoints are opened as for use, so that their description is what they do. Texts
in the answer are those of the file; whoever prints them makes them printable.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
from torch import nn

from svfl_data.errors import FormatError
from svfl_data.system.printable import printable
from svfl_data.system.side_files import read_json
from svfl_models.centering.checkpoint import configuration, load_classifier
from svfl_models.centering.module import FORMAT as CENTERING
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.module import FORMAT as POLICY
from svfl_models.cloning.recorded_inputs import of_plain
from svfl_models.latent.checkpoint import load_latent
from svfl_models.latent.config import MODALITIES, LatentConfig
from svfl_models.latent.inputs import IMAGE_SIZE
from svfl_models.latent.module import FORMAT as LATENT
from svfl_models.networks.inputs import INPUTS
from svfl_models.networks.presets import widths_of
from svfl_models.training import checkpoint_io, run_folder
from svfl_models.training.provenance import record
from svfl_models.training.provenance.session import Session, file


@dataclass(frozen=True)
class Inspection:
    """What is known of a trained network from its file.

    Attributes:
        path: The file.
        what: What the file holds, in words.
        program: Program that wrote it.
        format: Name and version of its format.
        bytes: Size, [bytes].
        sha256: SHA-256 of the file, in hexadecimal.
        configuration: Configuration of the training; empty for exported networks.
        inputs: Form of each input in words, by name.
        output: Form of the output in words.
        network: Group, sizes and number of parameters of the network.
        provenance: Sessions of the training, oldest first.
        results: Results that lie beside a checkpoint and belong to it, by name of the file.
    """

    path: str
    what: str
    program: str
    format: str
    bytes: int
    sha256: str
    configuration: dict[str, Any]
    inputs: dict[str, str]
    output: str
    network: dict[str, Any]
    provenance: list[Session]
    results: dict[str, dict[str, Any]] = field(default_factory=dict)

    def plain(self) -> Any:  # noqa: ANN401 - JSON values
        """Return the attributes as JSON values; numbers that are not finite become null."""
        return msgspec.json.decode(msgspec.json.encode(asdict(self)))


class Contents(NamedTuple):
    """What is read from a checkpoint depending on its kind; the attributes are those of `Inspection`."""

    what: str
    program: str
    configuration: dict[str, Any]
    inputs: dict[str, str]
    output: str
    network: dict[str, Any]


def inspect(path: Path) -> Inspection:
    """Return what is known of a trained network from its checkpoint.

    Args:
        path: A checkpoint of ``svfl-train``, or the folder of a training, whose checkpoint is inspected.

    Raises:
        FormatError: If it is neither, or a file is damaged.
    """
    if path.is_dir():
        found = inspect(path / run_folder.CHECKPOINT)
        return replace(found, provenance=record.recorded(path) or found.provenance)
    content = checkpoint_io.read(path)
    mark = checkpoint_io.mark_of(content) or {}
    kind = mark.get("format")
    if not isinstance(kind, str) or kind not in READERS:
        marked = printable(kind, 40) if mark else "no mark of svfl-train"
        raise FormatError(f"{path}: not a checkpoint of svfl-train (found {marked}; possible: {', '.join(READERS)})")
    contents = READERS[kind](path)
    sha256, version = file(path).sha256, f"{kind} {mark.get('format_version')}"
    return Inspection(
        str(path), contents.what, contents.program, version, path.stat().st_size, sha256, contents.configuration,
        contents.inputs, contents.output, contents.network, record.of_checkpoint(content, path), results(path,
        contents.configuration, sha256),
    )  # fmt: skip


def results(checkpoint: Path, configuration: Mapping[str, Any], sha256: str) -> dict[str, dict[str, Any]]:
    """Return the results of a training and of an evaluation that lie beside a checkpoint, by name of the file.

    Results of a training with another configuration, and of the evaluation of another checkpoint, are left out.

    Args:
        checkpoint: File of the checkpoint.
        configuration: Configuration of its training.
        sha256: SHA-256 of the file, in hexadecimal.

    Raises:
        FormatError: If one of the files holds no results.
    """
    found = {}
    trained = _read(checkpoint.with_name(run_folder.RESULT))
    if trained.get("config") == msgspec.to_builtins(configuration) and isinstance(trained.get("result"), dict):
        found[run_folder.RESULT] = trained["result"]
    evaluated = _read(checkpoint.with_name(run_folder.EVALUATION))
    if sha256 and _evaluated(evaluated) == sha256:
        names = ("environment", "seed", "rate", "interval", "median_steps")
        numbers = {name: evaluated[name] for name in names if name in evaluated}
        found[run_folder.EVALUATION] = numbers | {"episodes": len(evaluated.get("success") or ())}
    return found


def _read(path: Path) -> dict[str, Any]:
    try:
        content = read_json(path)
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise FormatError(f"{path}: cannot be read ({error.strerror or error})") from error
    if not isinstance(content, dict):
        raise FormatError(f"{path}: holds no results")
    return content


def _evaluated(evaluation: dict[str, Any]) -> object:
    """Return the SHA-256 of the checkpoint that an evaluation is of, if it states it."""
    inside: object = evaluation
    for name in ("provenance", "data", "checkpoint", "sha256"):
        inside = inside.get(name) if isinstance(inside, dict) else None
    return inside


def _centering(path: Path) -> Contents:
    module = load_classifier(path)
    config, trunk = configuration(module), module.classifier.trunk
    image = f"{config.image_size} x {config.image_size} px, colour and depth, view {config.view}"
    forms = {"image": _image(image, config.camera), "wrench": f"{config.window} readings", "proprio": "5 numbers"}
    described = module.hparams["network"]
    network = (
        {"latent model": described["latent_network"]["model"], "feature": trunk.width}
        if config.latent and described.get("latent_network")
        else {"group": config.group, "preset": config.preset, "widths": _widths(described)}
    )
    output = "scores of four directions" if config.target == "direction" else "offset right and up, [m]"
    return Contents(
        "block-centering network", "svfl-train centering", config.plain(),
        {name: forms[name] for name in INPUTS[config.encoder]}, output,
        network | {"parameters": _parameters(module)},
    )  # fmt: skip


def _policy(path: Path) -> Contents:
    module = load_policy(path)
    deployment, described = module.deployment, module.hparams["network"]
    kept = module.hparams["training"]
    config = msgspec.convert(kept, CloningConfig).plain() if kept else {}
    size = module.policy.trunk.image_size
    forms = {
        "v": ("image", _image(f"{size} x {size} px, colour and depth, view {module.view}", deployment.camera)),
        "f": ("wrench", f"{module.policy.trunk.window} readings"),
        "p": ("proprio", "5 numbers"),
    }
    inputs = {one.path: f"{one.kind} {_shape(one.shape)}" for one in of_plain(deployment.inputs)}
    if not inputs:
        inputs = dict(forms[letter] for letter in described.get("encoder", "vfp"))
    components = (deployment.action or {}).get("names") or ()
    output = f"action of {', '.join(map(str, components))}" if components else "planar action"
    network = {"group": module.policy.group.name, "widths": _widths(described), "parameters": _parameters(module)}
    return Contents(
        f"policy for {deployment.task}{f' of {deployment.robot}' if deployment.robot else ''}",
        "svfl-train bc", config, inputs, output, network,
    )  # fmt: skip


def _latent(path: Path) -> Contents:
    module = load_latent(path)
    kept, described = module.hparams["training"], module.hparams["network"]
    config = msgspec.convert(kept, LatentConfig).plain() if kept else {}
    forms = {
        "image": _image(f"{IMAGE_SIZE} x {IMAGE_SIZE} px, colour and depth", config.get("camera")),
        "wrench": "64 readings", "proprio": "5 numbers",
    }  # fmt: skip
    sizes = module.network.sizes
    network = {"model": described["model"], "sizes": asdict(sizes), "parameters": _parameters(module)}
    return Contents(
        "latent model", "svfl-train latent", config, {name: forms[name] for name in MODALITIES},
        f"feature of {sizes.feature} numbers", network,
    )  # fmt: skip


READERS: dict[str, Callable[[Path], Contents]] = {CENTERING: _centering, POLICY: _policy, LATENT: _latent}
"""Functions that open a checkpoint and tell what it holds, by the name of its format."""


def _image(words: str, camera: str | None) -> str:
    return f"{words}, camera {camera}" if camera else words


def _shape(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _parameters(module: nn.Module) -> int:
    """Return how many learned numbers a module has, those of a frozen encoder included."""
    return sum(parameter.numel() for parameter in module.parameters())


def _widths(described: Mapping[str, Any]) -> dict[str, Any]:
    """Return the sizes of a network's layers from the arguments that it is built with."""
    own: dict[str, Any] | None = described.get("widths")
    if own is not None:
        return own
    return widths_of(described.get("preset", "default"), described.get("group", "D4")).plain()
