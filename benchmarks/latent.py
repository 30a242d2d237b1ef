"""Cost of a step of latent pretraining, beside the published code of VTT, PoE and concatenation.

    .venv/bin/python benchmarks/latent.py [--model vtt poe concat] [--preset svfl_2023] [--steps 5] [--parts]

All figures are CPU time of one thread, since wall time depends on what else the machine does. A step is forward,
backward and Adam on 32 random sequences of 9 frames, including pairs with a foreign wrench. The published code was
timed on a shared Milan-class EPYC with torch 2.13 (two runs, up to 35 % apart). "Adapted" code has a decoder for this
package's images and one wrench reading per frame; there the foreign pairs, as many as the true ones, are a second step.
`--parts` also prints where the time goes. Peak memory is measured in a process of its own.
"""

import argparse
import multiprocessing
import os
import platform
import resource
import time
from statistics import median

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from torch.profiler import ProfilerActivity, profile

from svfl_models.latent.config import MODELS, PRESETS, LatentConfig
from svfl_models.latent.losses import Objective
from svfl_models.latent.networks.network import LatentNetwork
from svfl_models.training.trainer import parameter_count

BATCH, FRAMES = 32, 9
PUBLISHED = {  # CPU seconds: step (mean of two runs), step of the foreign pairs
    "vtt": ("adapted", (10.6 + 13.1) / 2, 10.4),
    "poe": ("adapted", (2.4 + 2.6) / 2, 0.79),
    "concat": ("84 px", (4.6 + 5.2) / 2, 1.12),
}


def batch() -> dict[str, torch.Tensor]:
    """Return a batch of random sequences, in which half of the frames are in contact."""
    shape, actions = (BATCH, FRAMES), (BATCH, FRAMES - 1)
    return {
        "image": torch.rand(*shape, 4, 64, 64) + 0.01,
        "wrench": torch.randn(*shape, 64, 6),
        "proprio": torch.rand(*shape, 5),
        "action": (torch.rand(*actions, 5) - 0.5) * 0.04,
        "reward": torch.zeros(actions),
        "contact": (torch.rand(shape) > 0.5).float(),
        "next_contact": (torch.rand(actions) > 0.5).float(),
        "touching": torch.rand(shape) > 0.5,
        "episode": torch.arange(BATCH),
        "step": torch.arange(FRAMES).expand(shape),
    }


def measured(model: str, preset: str, steps: int, parts: bool) -> dict[str, float]:
    """Return the CPU and wall seconds of a step, the numbers of parameters and frames, and the peak memory [MiB].

    Args:
        model: Model to train, one of `MODELS`.
        preset: Preset of the model, one of `PRESETS`.
        steps: Number of steps to time after a first one that warms up.
        parts: Whether to print a profile of one more step.
    """
    torch.set_num_threads(1)
    torch.manual_seed(0)
    config = LatentConfig("", model, preset)
    network, objective, drawn = LatentNetwork(**config.network()), Objective(**config.objective()), batch()
    adam = torch.optim.Adam(network.parameters(), lr=1e-4)

    def step() -> None:
        terms = objective.terms(network, drawn)
        adam.zero_grad()
        torch.stack([objective.weighted(name, term) for name, term in terms.items()]).sum().backward()
        adam.step()

    step()
    cpu, wall = [], []
    for _ in range(steps):
        starts = time.process_time(), time.perf_counter()
        step()
        cpu.append(time.process_time() - starts[0])
        wall.append(time.perf_counter() - starts[1])
    if parts:
        with profile(activities=[ProfilerActivity.CPU]) as seen:
            step()
        print(seen.key_averages().table(sort_by="self_cpu_time_total", row_limit=10, max_name_column_width=40))
    return {
        "cpu": median(cpu), "wall": median(wall),
        "encoder": parameter_count(network.encoder), "all": parameter_count(network),
        "frames": BATCH * FRAMES, "foreign": BATCH * PRESETS[preset].negatives,
        "MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }  # fmt: skip


def main() -> None:
    """Print a table with one row for each model."""
    parser = argparse.ArgumentParser(description="Time of a step of latent pretraining.")
    parser.add_argument("--model", nargs="+", choices=MODELS, default=MODELS)
    parser.add_argument("--preset", choices=tuple(PRESETS), default="svfl_2023")
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--parts", action="store_true")
    asked = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, torch {torch.__version__}, preset {asked.preset}\n")
    print("| model | encoder | all | frames | CPU s | wall s | published CPU s | share | share per frame | MiB |")
    print("| --- " * 10 + "|")
    with multiprocessing.get_context("spawn").Pool(1, maxtasksperchild=1) as child:
        for model in asked.model:
            own = child.apply(measured, (model, asked.preset, asked.steps, asked.parts))
            kind, true, foreign = PUBLISHED[model]
            per_frame = own["cpu"] / (own["frames"] + own["foreign"]) / ((true + foreign) / (2 * own["frames"]))
            print(
                f"| {model} | {own['encoder']:,} | {own['all']:,} | {own['frames']} + {own['foreign']} "
                f"| {own['cpu']:.2f} | {own['wall']:.2f} | {true:.2f} + {foreign:.2f} ({kind}) "
                f"| {own['cpu'] / (true + foreign):.0%} ({own['cpu'] / true:.0%} of the true pairs' step) "
                f"| {per_frame:.0%} | {own['MiB']:.0f} |"
            )


if __name__ == "__main__":
    main()
