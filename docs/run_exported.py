"""Run an exported network on one episode, without escnn and the training code: an example for your own program.

.venv/bin/python docs/run_exported.py out/centering/classifier.onnx --data data/centering --episode 3
"""

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from svfl_data.sampling.centering_samples import load_centering

FACTS = "svfl_centering.json"  # entry of the exported file with the facts about the network
Network = Callable[[dict[str, np.ndarray]], np.ndarray]


def load_program(path: Path) -> tuple[Network, dict[str, Any]]:
    """Load a ``.pt2`` file with torch and the one module of svfl_models that reads such files.

    `torch.export.load` can also open a file of your own, but never use it for a file from elsewhere, because it runs
    whatever Python code somebody has put into the file.

    Args:
        path: File to load.

    Returns:
        The network as a function, and the facts about it.
    """
    import torch

    from svfl_models.programs.program import read

    program, facts = read(path, FACTS)

    def network(inputs: dict[str, np.ndarray]) -> np.ndarray:
        with torch.inference_mode():
            return program(*map(torch.from_numpy, inputs.values()))[0].numpy()

    return network, json.loads(facts)


def load_onnx(path: Path) -> tuple[Network, dict[str, Any]]:
    """Load an ``.onnx`` file with nothing but onnxruntime, which reads no data from outside the file's folder.

    Args:
        path: File to load.

    Returns:
        The network as a function, and the facts about it.
    """
    import onnxruntime

    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    facts = json.loads(session.get_modelmeta().custom_metadata_map[FACTS])
    return lambda inputs: session.run(None, inputs)[0], facts


def cropped(image: np.ndarray, facts: dict[str, Any]) -> np.ndarray:
    """Return the central crop of images at the network's image size.

    Args:
        image: Images, (B, 4, H, H).
        facts: Facts about the network.
    """
    size = facts["image_size"]
    side = max(size, round(facts["crop"]["share"] * image.shape[-1]))
    start = (image.shape[-1] - side) // 2
    image = image[..., start : start + side, start : start + side]
    if side == size:
        return image
    import torch  # any bilinear filter with antialiasing will do

    scaled = torch.nn.functional.interpolate(torch.from_numpy(image), (size, size), mode="bilinear", antialias=True)
    return scaled.numpy()


def main() -> None:
    """Print the network's output and the label."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", type=Path, help="file written by svfl-train export")
    parser.add_argument("--data", type=Path, required=True, help="dataset folder")
    parser.add_argument("--episode", type=int, default=0, help="number of the episode (default: %(default)s)")
    options = parser.parse_args()
    try:
        network, facts = (load_onnx if options.network.suffix == ".onnx" else load_program)(options.network)
    except Exception as error:  # any error that the libraries raise for an invalid file
        parser.error(f"{options.network}: {' '.join(str(error).split())}")

    # The samples have the units and axes that the facts name: vectors in image-aligned axes, depth in metres.
    shapes = {name: one["shape"] for name, one in facts["inputs"].items()}
    window = shapes["wrench"][1] if "wrench" in shapes else 1
    samples = load_centering(options.data, window, facts["view"], shapes, facts.get("camera"))
    sample = samples.take(np.flatnonzero(samples.episode == options.episode))
    if not len(sample):
        parser.error(f"{options.data} has no episode {options.episode}")
    inputs = {}
    if "image" in shapes:
        inputs["image"] = np.ascontiguousarray(cropped(sample.image, facts))  # (1, 4, size, size)
    if "wrench" in shapes:
        inputs["wrench"] = sample.wrench  # (1, readings, 6)

    (output,), (offset,), (direction,) = network(inputs), sample.offset, sample.direction
    if facts["target"] == "direction":
        print(f"network: {facts['directions'][output.argmax()]}, scores {' '.join(f'{score:.3f}' for score in output)}")
    else:
        print(f"network: {millimetres(output)}")
    print(f"label:   {facts['directions'][direction]}, {millimetres(offset)}")


def millimetres(offset: np.ndarray) -> str:
    """Return an offset [m] as text in millimetres."""
    return f"{1000 * offset[0]:.1f} mm right, {1000 * offset[1]:.1f} mm up"


if __name__ == "__main__":
    main()
