"""The command ``svfl-train export``, which writes a trained network as a file that runs without this package."""

import argparse
from pathlib import Path

from svfl_data.system.command_line import Commands, add_json, report

EXAMPLE = """\
svfl-train export out/centering/checkpoint.ckpt --out out/centering/classifier.pt2
svfl-train export out/centering/checkpoint.ckpt --out out/centering/classifier.onnx
svfl-train export out/bc/checkpoint.ckpt --out out/bc/policy.pt2"""


def add(commands: Commands) -> None:
    """Add the command to the command line.

    Args:
        commands: Commands of ``svfl-train``, to which this one is added.
    """
    parser = commands.add_parser(
        "export", help="write a trained network as a file that runs without svfl and escnn", example=EXAMPLE,
        description="Write a trained block-centering network as a torch.export program (.pt2) or in the ONNX format "
        "(.onnx), or a trained policy as a .pt2 file that svfl-collect policy can run. Before the file is written, its "
        "outputs are compared with those of the network.",
    )  # fmt: skip
    parser.add_argument(
        "checkpoint", type=Path, metavar="CHECKPOINT", help="checkpoint.ckpt of svfl-train centering or svfl-train bc"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE",
        help="file to write, replaced if it exists; its name ends in .pt2, or for a block-centering network in .pt2 or "
        ".onnx",
    )  # fmt: skip
    add_json(parser)
    parser.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Export one network, and print how much the outputs of the file differ from those of the network.

    Args:
        arguments: Options of the command.

    Raises:
        UsageError: If the suffix of the file names no format.
        SvflError: If the checkpoint cannot be read or exported, or the file cannot be written.
    """
    from svfl_models.centering import checkpoint  # torch, lightning and escnn take seconds to import
    from svfl_models.cloning import acting
    from svfl_models.cloning.checkpoint import is_policy, load_policy
    from svfl_models.deployment import export

    if is_policy(arguments.checkpoint):
        kept = _texts(arguments.checkpoint)
        difference = acting.export(load_policy(arguments.checkpoint), arguments.out, kept)
        words = f"actions differ from the network's by {difference:.1g} of their bounds, at most"
        report(arguments.json, {"file": arguments.out, "difference": difference}, f"{arguments.out}: {words}")
        return
    save = export.saver(arguments.out)
    module = checkpoint.load_classifier(arguments.checkpoint)
    trained = checkpoint.configuration(module)
    kept = _texts(arguments.checkpoint)
    difference = save(module.classifier, arguments.out, trained.view, trained.camera, kept)
    words = f"outputs differ from the network's by {difference:.1g} of the largest output, at most"
    report(arguments.json, {"file": arguments.out, "difference": difference}, f"{arguments.out}: {words}")


def _texts(checkpoint: Path) -> dict[str, str]:
    """Return the provenance of an exported file as the text that goes into it, by its name.

    It is that of the checkpoint and, at the end, that of the export, which has the SHA-256 of the checkpoint.

    Raises:
        FormatError: If the checkpoint holds something else in its place.
    """
    from svfl_models.training.checkpoint_io import read
    from svfl_models.training.provenance.record import TEXT, as_text, of_checkpoint
    from svfl_models.training.provenance.session import file, session

    trained = of_checkpoint(read(checkpoint), checkpoint)
    return {TEXT: as_text([*trained, session({"checkpoint": file(checkpoint)})])}
