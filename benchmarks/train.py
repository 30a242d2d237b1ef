"""Training step times and parameter counts of the block-centering classifier, SVFL beside its plain twin.

    python benchmarks/train.py [--threads N] [--repeats N] [--preset default|paper]

A step is forward, backward and Adam on 64 samples, random data; the fastest of the repeats counts. `expanded` is the
number of channels of the widest layer: what the convolutions cost is quadratic in it.
"""

import argparse
import time

import torch
from torch.nn import functional

from svfl_models.classifier import Batch, CenteringClassifier, parameter_count
from svfl_models.config import ENCODERS, MODELS
from svfl_models.presets import PRESETS

BATCH = 64


def random_batch() -> Batch:
    """Inputs of the right shapes."""
    return {"image": torch.rand(BATCH, 4, 64, 64), "wrench": torch.randn(BATCH, 64, 6)}


def step_seconds(network: CenteringClassifier, repeats: int) -> float:
    """Fastest training step of several, in [s]."""
    batch, direction = random_batch(), torch.arange(BATCH) % 4
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    times = []
    for _ in range(repeats + 1):  # the first one warms up
        start = time.perf_counter()
        optimizer.zero_grad()
        functional.cross_entropy(network(batch), direction).backward()
        optimizer.step()
        times.append(time.perf_counter() - start)
    return min(times[1:])


def main() -> None:
    """Print one line per preset, encoder and model."""
    parser = argparse.ArgumentParser(description="Training step times and parameter counts.")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--preset", choices=tuple(PRESETS), action="append")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    print(f"batch {BATCH}, {options.threads} threads, fastest of {options.repeats} steps")
    print(f"{'preset':<9}{'encoder':<9}{'model':<7}{'parameters':>11}{'construction':>14}{'step':>10}{'ratio':>8}")
    for preset in options.preset or PRESETS:
        for encoder in ENCODERS:
            steps = {}
            for model in MODELS:
                start = time.perf_counter()
                network = CenteringClassifier(encoder, model, preset)
                built = time.perf_counter() - start
                steps[model] = step_seconds(network, options.repeats)
                ratio = f"{steps['svfl'] / steps[model]:.2f}"
                print(
                    f"{preset:<9}{encoder:<9}{model:<7}{parameter_count(network):>11,}"
                    f"{built:>12.2f} s{1000 * steps[model]:>7.0f} ms{ratio:>8}"
                )


if __name__ == "__main__":
    main()
