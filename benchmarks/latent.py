"""Cost of a step of latent pretraining, beside the published code of VTT, PoE and concatenation.

    .venv/bin/python benchmarks/latent.py [--model vtt poe concat] [--preset svfl_2023] [--steps 5] [--parts]
    .venv/bin/python benchmarks/latent.py --against CHECKOUT [--rounds 5]
    .venv/bin/python benchmarks/latent.py --against CHECKOUT --losses 200 --sequences 4

All figures are CPU time of one thread, since wall time depends on what else the machine does. A step is forward,
backward and Adam on 32 random sequences of 9 frames, including pairs with a foreign wrench. The published code was
timed on a shared Milan-class EPYC with torch 2.13 (two runs, up to 35 % apart). "Adapted" code has a decoder for this
package's images and one wrench reading per frame; there the foreign pairs, as many as the true ones, are a second step.
`--parts` also prints where the time goes. Peak memory is measured in a process of its own.

`--against` takes a working tree of another commit: each round times a process of that tree in float32, one of this tree
in float32 and one in bfloat16, and the ratios are medians over the rounds. With `--losses` both trees train from the
same weights on the same batches instead, and the differences of their losses are printed.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from torch.profiler import ProfilerActivity, profile

from svfl_models.latent.config import MODELS, PRESETS, LatentConfig
from svfl_models.latent.module import LatentModule
from svfl_models.training.trainer import parameter_count

FRAMES = 9
HERE = Path(__file__).resolve().parent.parent
PUBLISHED = {  # CPU seconds: step (mean of two runs), step of the foreign pairs
    "vtt": ("adapted", (10.6 + 13.1) / 2, 10.4),
    "poe": ("adapted", (2.4 + 2.6) / 2, 0.79),
    "concat": ("84 px", (4.6 + 5.2) / 2, 1.12),
}


def batch(sequences: int) -> dict[str, torch.Tensor]:
    """Return a batch of random sequences, in which half of the frames are in contact."""
    shape, actions = (sequences, FRAMES), (sequences, FRAMES - 1)
    return {
        "image": torch.rand(*shape, 4, 64, 64) + 0.01,
        "wrench": torch.randn(*shape, 64, 6),
        "proprio": torch.rand(*shape, 5),
        "action": (torch.rand(*actions, 5) - 0.5) * 0.04,
        "reward": torch.zeros(actions),
        "contact": (torch.rand(shape) > 0.5).float(),
        "next_contact": (torch.rand(actions) > 0.5).float(),
        "touching": torch.rand(shape) > 0.5,
        "episode": torch.arange(sequences),
        "step": torch.arange(FRAMES).expand(shape),
    }


def measured(model: str, preset: str, precision: str, steps: int, sequences: int, parts: bool) -> dict[str, Any]:
    """Train a few steps in this process; return their times, losses, the numbers of parameters and the peak memory.

    Args:
        model: Model to train, one of `MODELS`.
        preset: Preset of the model, one of `PRESETS`.
        precision: Number format, ``32`` or ``bf16`` (mixed, as Lightning trains).
        steps: Number of steps after a first one that warms up.
        sequences: Number of sequences of a batch.
        parts: Whether to print a profile of one more step.
    """
    torch.set_num_threads(1)
    torch.manual_seed(0)
    config = LatentConfig("", model, preset)
    module = LatentModule(config.network(), config.objective())
    configured: Any = module.configure_optimizers()
    adam = configured["optimizer"] if isinstance(configured, dict) else configured
    batches = [batch(sequences) for _ in range(10)]

    def step(number: int) -> float:
        torch.manual_seed(number)
        with torch.autocast("cpu", torch.bfloat16, enabled=precision == "bf16"):
            terms = module.objective.terms(module.network, batches[number % len(batches)])
            loss = torch.stack([module.objective.weighted(name, term) for name, term in terms.items()]).sum()
        adam.zero_grad()
        loss.backward()
        adam.step()
        return float(loss.detach())

    losses = [step(0)]
    cpu, wall = [], []
    for number in range(steps):
        starts = time.process_time(), time.perf_counter()
        losses.append(step(number + 1))
        cpu.append(time.process_time() - starts[0])
        wall.append(time.perf_counter() - starts[1])
    if parts:
        with profile(activities=[ProfilerActivity.CPU]) as seen:
            step(0)
        print(seen.key_averages().table(sort_by="self_cpu_time_total", row_limit=10, max_name_column_width=40))
    return {
        "cpu": median(cpu), "wall": median(wall), "losses": losses,
        "encoder": parameter_count(module.network.encoder), "all": parameter_count(module.network),
        "MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }  # fmt: skip


def child(tree: Path, *arguments: object) -> dict[str, Any]:
    """Return what `measured` gives in a process that imports the package of a working tree.

    Args:
        tree: Root folder of the working tree.
        arguments: Arguments of `measured`.
    """
    environment = os.environ | {"PYTHONPATH": str(tree)}
    command = [sys.executable, __file__, "--child", json.dumps(arguments)]
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, text=True, check=True)
    *printed, last = done.stdout.splitlines()
    print(*printed, sep="\n", end="\n" if printed else "")
    found: dict[str, Any] = json.loads(last)
    return found


def beside_published(asked: argparse.Namespace) -> None:
    """Print a table with one row for each model, beside the published code."""
    print("| model | encoder | all | frames | CPU s | wall s | published CPU s | share | share per frame | MiB |")
    print("| --- " * 10 + "|")
    for model in asked.model:
        own = child(HERE, model, asked.preset, "32", asked.steps, asked.sequences, asked.parts)
        kind, true, foreign = PUBLISHED[model]
        frames, pairs = asked.sequences * FRAMES, asked.sequences * PRESETS[asked.preset].negatives
        per_frame = own["cpu"] / (frames + pairs) / ((true + foreign) / (2 * frames))
        print(
            f"| {model} | {own['encoder']:,} | {own['all']:,} | {frames} + {pairs} "
            f"| {own['cpu']:.2f} | {own['wall']:.2f} | {true:.2f} + {foreign:.2f} ({kind}) "
            f"| {own['cpu'] / (true + foreign):.0%} ({own['cpu'] / true:.0%} of the true pairs' step) "
            f"| {per_frame:.0%} | {own['MiB']:.0f} |"
        )


def beside_tree(asked: argparse.Namespace) -> None:
    """Print a table with the times of another working tree and of this one, in rounds."""
    print("| model | before, CPU s | float32, CPU s | ratio | bfloat16, CPU s | ratio |")
    print("| --- " * 6 + "|")
    kinds = ((asked.against, "32"), (HERE, "32"), (HERE, "bf16"))
    for model in asked.model:
        times: list[list[float]] = [[], [], []]
        for _ in range(asked.rounds):
            for one, (tree, precision) in zip(times, kinds, strict=True):
                own = child(tree, model, asked.preset, precision, asked.steps, asked.sequences, False)
                one.append(own["cpu"])
        before, full, half = (median(one) for one in times)
        ratios = [median(new / old for new, old in zip(one, times[0], strict=True)) for one in times[1:]]
        print(f"| {model} | {before:.2f} | {full:.2f} | {ratios[0]:.2f} | {half:.2f} | {ratios[1]:.2f} |", flush=True)


def beside_losses(asked: argparse.Namespace) -> None:
    """Print by how much the losses of two working trees differ that train on the same batches."""
    print("| model | losses | first | last | largest relative difference, float32 | bfloat16 |")
    print("| --- " * 6 + "|")
    for model in asked.model:
        kinds = ((asked.against, "32"), (HERE, "32"), (HERE, "bf16"))
        before, full, half = (
            child(tree, model, asked.preset, precision, asked.losses - 1, asked.sequences, False)["losses"]
            for tree, precision in kinds
        )
        shares = [max(abs(a / b - 1) for a, b in zip(one, before, strict=True)) for one in (full, half)]
        print(
            f"| {model} | {len(before)} | {before[0]:.0f} | {before[-1]:.0f} | {shares[0]:.1e} | {shares[1]:.1e} |",
            flush=True,
        )


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description="Time of a step of latent pretraining.")
    parser.add_argument("--model", nargs="+", choices=MODELS, default=MODELS)
    parser.add_argument("--preset", choices=tuple(PRESETS), default="svfl_2023")
    parser.add_argument("--steps", type=int, default=5)
    parser.add_argument("--sequences", type=int, default=32)
    parser.add_argument("--parts", action="store_true")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--losses", type=int, default=0)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.child:
        print(json.dumps(measured(*json.loads(asked.child))))
        return
    print(f"{platform.processor() or platform.machine()}, torch {torch.__version__}, preset {asked.preset}\n")
    compared = beside_losses if asked.losses else beside_tree
    (compared if asked.against else beside_published)(asked)


if __name__ == "__main__":
    main()
