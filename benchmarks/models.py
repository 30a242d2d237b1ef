"""Cost of symmetric networks in building, training and inference, beside ordinary layers of the same channel counts.

    .venv/bin/python benchmarks/models.py [--part construction steps force inference]
    .venv/bin/python benchmarks/models.py --part memory first
    .venv/bin/python benchmarks/models.py --part steps --group D8 --preset default

All times are CPU times of one thread. A step is forward, backward and Adam on 64 random samples. Ratios come from steps
that alternate, so that other load on the machine affects both; times are medians. The network of ordinary layers has
the layers of the symmetric network with their expanded kernels as weights: the remaining difference is the cost of
symmetry itself. `memory` and `first`, which builds on an empty cache, run in new processes and only if they are asked
for.
"""

import argparse
import multiprocessing
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import median
from unittest.mock import patch

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch
from torch import Tensor, nn
from torch.nn import functional

from svfl_data.symmetry import WRENCH_PARTS
from svfl_models.centering.classifier import CenteringClassifier
from svfl_models.networks.encoders import ForceEncoder
from svfl_models.networks.inputs import ENCODERS
from svfl_models.networks.layer_factory import SymmetricLayers
from svfl_models.networks.presets import PRESETS
from svfl_models.symmetry import planar_escnn  # must be imported before escnn
from svfl_models.symmetry.groups import GROUPS
from svfl_models.symmetry.layers import SymmetricConv
from svfl_models.symmetry.ordinary import plain
from svfl_models.symmetry.representations import stored
from svfl_models.training.trainer import parameter_count

from escnn.nn import GeometricTensor, R2Conv  # isort: skip

BATCH, WINDOW = 64, 64


def construction(asked: argparse.Namespace) -> None:
    """CPU seconds to build each network, in a process that has imported everything and built nothing."""
    table("group", *(f"{preset}, s" for preset in PRESETS))
    for group in GROUPS:
        row(group, *(f"{in_child(built, group, preset):.2f}" for preset in PRESETS))


def built(group: str, preset: str) -> float:
    """Return the CPU seconds that building a network takes.

    Args:
        group: Name of the symmetry group.
        preset: Name of the preset.
    """
    start = time.process_time()
    CenteringClassifier("vf", group, preset)
    return time.process_time() - start


def first(asked: argparse.Namespace) -> None:
    """CPU seconds to build the first network of a group, without the tables that escnn caches."""
    table("group", "first network, s", "files", "MiB")
    for group in [group for group in GROUPS if group != "none"]:
        with tempfile.TemporaryDirectory() as folder:
            seconds = fresh(f"built({group!r}, 'default')", XDG_CACHE_HOME=folder)
            files = [file for file in Path(folder).rglob("*") if file.is_file()]
            size = sum(file.stat().st_size for file in files) / 2**20
        row(group, f"{seconds:.1f}", len(files), f"{size:.1f}")


def memory(asked: argparse.Namespace) -> None:
    """Growth of the peak memory by a training step, in a process that has built the network."""
    table("preset", "group", "encoder", "MiB", "ordinary, MiB")
    for preset in asked.preset:
        for group in asked.group:
            for encoder in asked.encoder:
                network = f"CenteringClassifier({encoder!r}, {group!r}, {preset!r})"
                rivals = (network, f"plain({network}).train().requires_grad_(True)")
                row(preset, group, encoder, *(f"{fresh(f'grown({one})'):.0f}" for one in rivals))


def steps(asked: argparse.Namespace) -> None:
    """Time of a training step of the whole classifier."""
    table("preset", "group", "encoder", "parameters", "expanded", "step, ms", "ordinary, ms", "ratio")
    for preset in asked.preset:
        for group in asked.group:
            for encoder in asked.encoder:
                network = CenteringClassifier(encoder, group, preset)
                ordinary = plain(network).train().requires_grad_(True)
                ours, theirs = alternating([step(network), step(ordinary)], asked.seconds)
                counts = (f"{parameter_count(one):,}" for one in (network, ordinary))
                times = (f"{1e3 * ours:.1f}", f"{1e3 * theirs:.1f}", f"{ours / theirs:.2f}")
                row(preset, group, encoder, *counts, *times)


def force(asked: argparse.Namespace) -> None:
    """Time of a training step of the force encoder alone, beside the same widths wired as in the reference code."""
    table("preset", "group", "step, ms", "reference wiring, ms", "times faster")
    for preset in asked.preset:
        for group in asked.group:
            widths = PRESETS[preset]["svfl"]
            sizes = (WINDOW, widths.force, widths.heads, widths.latent)
            layers = SymmetricLayers(GROUPS[group])
            rivals = (ForceEncoder(layers, WRENCH_PARTS, *sizes), ReferenceForceEncoder(layers, *sizes))
            wrench = torch.randn(BATCH, WINDOW, 6)
            ours, theirs = alternating([encoder_step(one, wrench) for one in rivals], asked.seconds)
            row(preset, group, f"{1e3 * ours:.1f}", f"{1e3 * theirs:.1f}", f"{theirs / ours:.1f}")


class ReferenceForceEncoder(nn.Module):
    """Attention over readings as Kohler et al. (CoRL 2023) published it: every map is a 1 x 1 convolution of escnn.

    Readings are processed one by one as (B * T, C, 1, 1); the readout takes the window as the channels of one pixel.
    """

    def __init__(self, layers: SymmetricLayers, window: int, width: int, heads: int, latent: int) -> None:
        super().__init__()
        self.heads = heads
        hidden = layers.hidden(width)
        self.embed = escnn_map(layers.vector(WRENCH_PARTS), hidden)
        self.query, self.key, self.value, self.out = (escnn_map(hidden, hidden) for _ in range(4))
        self.readout = escnn_map(layers.hidden(window * width), layers.hidden(latent))

    def forward(self, wrench: Tensor) -> Tensor:
        """Return the features (B, C) of wrench windows (B, T, 6)."""
        x = functional.relu(per_reading(self.embed, stored(WRENCH_PARTS, wrench)))
        query, key, value = (
            per_reading(one, x).unflatten(-1, (self.heads, -1)).transpose(1, 2)
            for one in (self.query, self.key, self.value)
        )
        scores = query @ key.transpose(-1, -2) / query.shape[-1] ** 0.5
        mixed = (scores.softmax(-1) @ value).transpose(1, 2).flatten(2)
        return functional.relu(one_pixel(self.readout, per_reading(self.out, mixed).flatten(1)))


def escnn_map(source: planar_escnn.FieldType, target: planar_escnn.FieldType) -> R2Conv:
    """Return a 1 x 1 convolution of escnn, without its slow initialization, which is not to be measured."""
    layer = R2Conv(source, target, kernel_size=1, initialize=False)
    nn.init.normal_(layer.weights, std=0.1)
    return layer


def one_pixel(layer: R2Conv, x: Tensor) -> Tensor:
    """Apply a layer to features (B, C) as images of one pixel, and return (B, C')."""
    return layer(GeometricTensor(x[:, :, None, None], layer.in_type)).tensor[:, :, 0, 0]


def per_reading(layer: R2Conv, x: Tensor) -> Tensor:
    """Apply a layer to features (B, T, C), with each reading as an image of one pixel, and return (B, T, C')."""
    return one_pixel(layer, x.flatten(0, 1)).unflatten(0, x.shape[:2])


@torch.no_grad()
def inference(asked: argparse.Namespace) -> None:
    """Inference of one sample in eval mode, and the share of its time that combines kernels into filters."""
    table("preset", "group", "as trained, ms", "filters, share", "exported, ms")
    for preset in asked.preset:
        for group in asked.group:
            network, batch = CenteringClassifier("vf", group, preset).eval(), random_batch(1)
            ordinary = plain(network)
            combine, combining = SymmetricConv.expand_parameters, []

            def clocked(layer: SymmetricConv) -> tuple[Tensor, Tensor]:
                start = time.process_time()
                combined = combine(layer)  # noqa: B023 - called in this round only
                combining.append(time.process_time() - start)  # noqa: B023
                return combined

            whole, exported = alternating((lambda: network(batch), lambda: ordinary(batch)), asked.seconds)  # noqa: B023
            with patch.object(SymmetricConv, "expand_parameters", clocked):
                start = time.process_time()
                for _ in range(10):
                    network(batch)
                share = sum(combining) / (time.process_time() - start)
            row(preset, group, f"{1e3 * whole:.1f}", f"{100 * share:.0f} %", f"{1e3 * exported:.1f}")


def random_batch(samples: int) -> dict[str, Tensor]:
    """Return random inputs of the right shapes."""
    return {"image": torch.rand(samples, 4, 64, 64), "wrench": torch.randn(samples, WINDOW, 6)}


def step(network: nn.Module) -> Callable[[], None]:
    """Return a function that does a training step of a classifier."""
    batch, direction = random_batch(BATCH), torch.arange(BATCH) % 4
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)

    def run() -> None:
        optimizer.zero_grad()
        functional.cross_entropy(network(batch), direction).backward()
        optimizer.step()

    return run


def encoder_step(encoder: nn.Module, wrench: Tensor) -> Callable[[], None]:
    """Return a function that does a training step of an encoder on wrench windows, (B, T, 6)."""
    optimizer = torch.optim.Adam(encoder.parameters(), lr=1e-3)

    def run() -> None:
        optimizer.zero_grad()
        encoder(wrench).square().mean().backward()
        optimizer.step()

    return run


def grown(network: nn.Module) -> float:
    """Return the growth of this process's peak memory by a training step, [MiB]."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    step(network)()
    return (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024


def alternating(rivals: Iterable[Callable[[], object]], seconds: float) -> list[float]:
    """Return the median CPU seconds of each function, run in turn until the time is up, at least twice.

    Args:
        rivals: Functions to time, whose first run does not count.
        seconds: CPU seconds that all runs may take together.
    """
    rivals = list(rivals)
    times: list[list[float]] = [[] for _ in rivals]
    start = time.process_time()
    while len(times[0]) < 3 or time.process_time() - start < seconds:
        for rival, taken in zip(rivals, times, strict=True):
            begun = time.process_time()
            rival()
            taken.append(time.process_time() - begun)
    return [median(taken[1:]) for taken in times]


def fresh(expression: str, **environment: str) -> float:
    """Return the value of an expression over this file's names, evaluated in a new process.

    Args:
        expression: Python expression of a number.
        environment: Environment variables to set in the new process.
    """
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); from models import *; print({expression})"
    command, env = [sys.executable, "-c", code], {**os.environ, **environment}
    return float(subprocess.run(command, env=env, stdout=subprocess.PIPE, text=True, check=True).stdout)


def in_child(function: Callable[..., float], *arguments: object) -> float:
    """Return the result of a function that runs in a forked process, so that it leaves nothing behind in this one."""
    context = multiprocessing.get_context("fork")
    with context.Pool(1) as pool:
        return pool.apply(function, arguments)


def table(*heads: str) -> None:
    """Print the head of a Markdown table."""
    print("\n" + "| " + " | ".join(heads) + " |\n" + "| --- " * len(heads) + "|", flush=True)


def row(*cells: object) -> None:
    """Print a row of a Markdown table."""
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def cpu_name() -> str:
    """Return the name of the processor, as Linux gives it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def commit() -> str:
    """Return the short name of the current commit, followed by ``+`` if files have been changed since."""
    git = ("git", "-C", str(Path(__file__).parent))
    name = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
    return name + "+" * bool(subprocess.run([*git, "diff", "--quiet", "HEAD"]).returncode)


PARTS = {part.__name__: part for part in (construction, steps, force, inference, memory, first)}
SLOW = ("memory", "first")


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--part", nargs="+", choices=PARTS, default=[part for part in PARTS if part not in SLOW])
    parser.add_argument("--preset", nargs="+", choices=PRESETS, default=["default", "paper"])
    parser.add_argument("--group", nargs="+", choices=[group for group in GROUPS if group != "none"], default=["D4"])
    parser.add_argument("--encoder", nargs="+", choices=ENCODERS, default=list(ENCODERS))
    parser.add_argument("--seconds", type=float, default=2.0, help="duration of each comparison of a pair, s")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    print(f"{cpu_name()}, torch {torch.__version__}, one thread, commit {commit()}, load {os.getloadavg()[0]:.1f}")
    print(f"`{' '.join(['python benchmarks/models.py', *sys.argv[1:]])}`")
    for name, part in PARTS.items():  # construction comes first, before anything has been built
        if name in asked.part:
            print(f"\n{part.__doc__}")
            part(asked)


if __name__ == "__main__":
    main()
