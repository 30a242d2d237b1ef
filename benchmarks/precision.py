"""Training in bfloat16 beside float32: CPU time of a step, and the losses of a short training in both.

    .venv/bin/python benchmarks/precision.py [--part steps losses] [--preset default paper] [--group D4 none]

All times are CPU times of one thread, medians of steps that alternate between the two number formats, so that other
load on the machine affects both. A step is forward, backward and Adam on 64 samples. bfloat16 is PyTorch's autocast,
as in ``svfl-train --precision bf16``: the weights, their gradients and Adam stay in float32. The losses are those of
two networks that start alike and see the same samples, whose direction is that of a noisy force; the images are noise.
"""

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from models import BATCH, WINDOW, alternating, commit, cpu_name, row, table
from torch import Tensor, nn
from torch.nn import functional

from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry.groups import GROUPS
from svfl_models.training.placement import has_cpu_bf16

Context = Callable[[], AbstractContextManager[object]]
FORMATS: dict[str, Context] = {
    "32": nullcontext,
    "bf16": partial(torch.autocast, "cpu", torch.bfloat16),
}
HELD_OUT = 256
LAST = 5
SIGNAL = 0.15
"""Force in the direction of a sample, in units of the noise of a reading: so small that learning takes a while."""


def steps(asked: argparse.Namespace) -> None:
    """CPU time of a training step."""
    table("preset", "group", "32, ms", "bf16, ms", "bf16 / 32")
    for preset in asked.preset:
        for group in asked.group:
            batch = samples(BATCH, torch.Generator().manual_seed(0))
            rivals = [step(CenteringClassifier("vf", group, preset), context) for context in FORMATS.values()]
            usual, short = alternating([partial(one, batch) for one in rivals], asked.seconds)
            row(preset, group, f"{1e3 * usual:.0f}", f"{1e3 * short:.0f}", f"{short / usual:.2f}")


def losses(asked: argparse.Namespace) -> None:
    """Losses of a short training, and accuracy on held-out samples, which are tested in float32."""
    table("preset", "group", "format", "steps", f"mean loss of the last {LAST}", "held-out loss", "held-out accuracy")
    test = samples(HELD_OUT, torch.Generator().manual_seed(1))
    for preset in asked.preset:
        for group in asked.group:
            for name, context in FORMATS.items():
                torch.manual_seed(0)
                network, generator = CenteringClassifier("vf", group, preset), torch.Generator().manual_seed(2)
                train = step(network, context)
                history = [train(samples(BATCH, generator)) for _ in range(asked.steps)]
                loss, accuracy = tested(network, test)
                last = sum(history[-LAST:]) / LAST
                row(preset, group, name, asked.steps, f"{last:.4f}", f"{loss:.4f}", f"{100 * accuracy:.1f} %")


def step(network: nn.Module, context: Context) -> Callable[[dict[str, Tensor]], float]:
    """Return a function that does a training step in a number format and returns the loss."""
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)

    def run(batch: dict[str, Tensor]) -> float:
        optimizer.zero_grad()
        with context():
            loss = functional.cross_entropy(network(batch), batch["direction"])
        loss.backward()
        optimizer.step()
        return float(loss.detach())

    return run


def samples(count: int, generator: torch.Generator) -> dict[str, Tensor]:
    """Return random samples, whose force points in the sample's direction."""
    direction = torch.randint(4, (count,), generator=generator)
    angle = direction * torch.pi / 2
    wrench = torch.randn(count, WINDOW, 6, generator=generator)
    wrench[..., :2] += SIGNAL * torch.stack([angle.cos(), angle.sin()], dim=-1)[:, None]
    return {"image": torch.rand(count, 4, 64, 64, generator=generator), "wrench": wrench, "direction": direction}


@torch.no_grad()
def tested(network: nn.Module, batch: dict[str, Tensor]) -> tuple[float, float]:
    """Return the loss and the accuracy of a network in eval mode, in float32."""
    network.eval()
    parts = [
        {name: values[start : start + BATCH] for name, values in batch.items()} for start in range(0, HELD_OUT, BATCH)
    ]
    scores = torch.cat([network(part) for part in parts])
    accuracy = (scores.argmax(dim=1) == batch["direction"]).float().mean()
    return float(functional.cross_entropy(scores, batch["direction"])), float(accuracy)


PARTS = {part.__name__: part for part in (steps, losses)}


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--preset", nargs="+", choices=PRESETS, default=["default", "paper"])
    parser.add_argument("--group", nargs="+", choices=list(GROUPS), default=["D4", "none"])
    parser.add_argument("--seconds", type=float, default=30.0, help="duration of each comparison of a pair, s")
    parser.add_argument("--steps", type=int, default=30, help="steps of a short training (default: %(default)s)")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{cpu_name()}, bfloat16 in hardware: {'yes' if has_cpu_bf16() else 'no'}, torch {torch.__version__}, "
          f"one thread, commit {commit()}, load {os.getloadavg()[0]:.1f}")  # fmt: skip
    print(f"`{' '.join(['python benchmarks/precision.py', *sys.argv[1:]])}`")
    for name in asked.part:
        print(f"\n{PARTS[name].__doc__}")
        PARTS[name](asked)


if __name__ == "__main__":
    main()
