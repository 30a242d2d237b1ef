"""``svfl-train export``: a trained network as a file that runs without this package."""

import argparse
from pathlib import Path

from svfl_data.cli import Commands

EXAMPLE = """\
svfl-train export out/centering/checkpoint.ckpt --out out/centering/classifier.pt2
svfl-train export out/centering/checkpoint.ckpt --out out/centering/classifier.onnx"""


def add(commands: Commands) -> None:
    """Put the verb on the command line."""
    verb = commands.add_parser(
        "export", help="write a trained network as a file that runs without svfl and escnn", example=EXAMPLE,
        description="Write a trained block-centering network as a torch.export program (.pt2) or as ONNX (.onnx), and "
        "try the file against the network first.",
    )  # fmt: skip
    verb.add_argument("checkpoint", type=Path, help="checkpoint.ckpt written by svfl-train centering")
    verb.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="ends in .pt2 or .onnx; replaced if it exists"
    )
    verb.set_defaults(command=run)


def run(arguments: argparse.Namespace) -> None:
    """Export one network and say how exact the file is."""
    from svfl_models import checkpoint, export  # torch, lightning and escnn take seconds to import

    save = export.saver(arguments.out)
    module = checkpoint.load_centering(arguments.checkpoint)
    difference = save(module.classifier, arguments.out, checkpoint.configuration(module).view)
    print(f"{arguments.out}: outputs differ from the network's by {difference:.1g} of the largest output, at most")
