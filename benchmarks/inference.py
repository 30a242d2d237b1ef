"""Time of one decision of the exported block-centering classifier, with batch size 1 and one thread.

    python benchmarks/inference.py [--preset default|paper] [--repeats N]

The networks have random weights and random inputs. The figures are the median and the 95th percentile of the repeats,
after some repeats for warming up. `network` is the symmetric network itself, which expands its kernels in every call;
`plain` is its copy made of ordinary layers; `.pt2` and `.onnx` are the exported files as `docs/run_exported.py` runs
them.
"""

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime
import torch

from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.deployment.export import random_batch, save_onnx, save_program
from svfl_models.networks.inputs import ENCODERS
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry.ordinary import plain

WARM_UP = 20


def milliseconds(decide: Callable[[], object], repeats: int) -> np.ndarray:
    """Return the times of single calls, (repeats,), [ms], after `WARM_UP` calls that do not count."""
    times = []
    for _ in range(WARM_UP + repeats):
        start = time.perf_counter()
        decide()
        times.append(time.perf_counter() - start)
    return 1000 * np.array(times[WARM_UP:])


def ways(classifier: CenteringClassifier, folder: Path) -> dict[str, Callable[[], object]]:
    """Return all ways to run the network on a random input, by name.

    Args:
        classifier: Network in eval mode.
        folder: Folder to write the exported files to.
    """
    batch = random_batch(classifier, 1)
    copied = plain(classifier)
    save_program(classifier, folder / "network.pt2")
    program = torch.export.load(folder / "network.pt2").module()
    save_onnx(classifier, folder / "network.onnx")
    one_thread = onnxruntime.SessionOptions()
    one_thread.intra_op_num_threads = 1
    session = onnxruntime.InferenceSession(folder / "network.onnx", one_thread, providers=["CPUExecutionProvider"])
    arrays = {name: values.numpy() for name, values in batch.items()}
    return {
        "network": lambda: classifier(batch),
        "plain": lambda: copied(batch),
        ".pt2": lambda: program(batch),
        ".onnx": lambda: session.run(None, arrays),
    }


@torch.inference_mode()
def main() -> None:
    """Print one line for each preset, encoder and way to run."""
    parser = argparse.ArgumentParser(description="Inference times of the exported classifier.")
    parser.add_argument("--preset", choices=tuple(PRESETS), action="append")
    parser.add_argument("--repeats", type=int, default=300)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(f"batch 1, one thread, {options.repeats} repeats")
    print(f"{'preset':<9}{'encoder':<9}{'way':<9}{'median':>10}{'95 %':>10}")
    for preset in options.preset or ("default", "paper"):
        for encoder in ENCODERS:
            with tempfile.TemporaryDirectory() as folder, torch.inference_mode(False):
                found = ways(CenteringClassifier(encoder, "D4", preset).eval(), Path(folder))
            for name, decide in found.items():
                times = milliseconds(decide, options.repeats)
                median, high = np.percentile(times, (50, 95))
                print(f"{preset:<9}{encoder:<9}{name:<9}{median:>7.2f} ms{high:>7.2f} ms")


if __name__ == "__main__":
    main()
