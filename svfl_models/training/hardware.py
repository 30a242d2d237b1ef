"""The hardware that a training is asked to use, in plain values; importing this module loads no heavy library.

`svfl_models.training.placement` says whether this machine has it, and what it means for a training.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, get_args

from svfl_models.configuration.setting import option

Precision = Literal["auto", "32", "bf16", "16"]
MOST_THREADS = {"paper": 8}
"""Most threads of a training by preset of the network; 1 for all others. Networks as narrow as those of the default
preset gain little from a second thread. They lose much on a shared machine, because OpenMP's threads wait by spinning:
10 epochs took 5 s with one thread and 32 s with two."""
WIDE = ("paper",)
"""Presets whose symmetric networks are wide enough for bfloat16 to pay on a CPU (docs/benchmarks.md)."""


@dataclass(frozen=True)
class Hardware:
    """Devices, number format, threads and loader processes of a training.

    Example:
        >>> Hardware(devices=2).precision
        '32'
    """

    device: Annotated[str, option(
        "where the network is trained: auto (a GPU if there is one), cpu, cuda, or the number of a CUDA device",
        metavar="NAME")] = "auto"  # fmt: skip
    devices: Annotated[int, option(
        "number of devices, each with a process of its own that takes an equal share of every batch; on the CPU the "
        "number of processes", ge=1)] = 1  # fmt: skip
    precision: Annotated[Precision, option(
        "number format of the arithmetic: 32; bf16 or 16, with weights in float32 (mixed precision); auto is bf16 for "
        "wide networks where the hardware computes in it, else 32", choices=get_args(Precision))] = "32"  # fmt: skip
    threads: Annotated[int, option(
        "threads of each process; without it one, and up to eight for the preset paper",
        ge=1)] | None = None  # fmt: skip
    loader_workers: Annotated[int, option(
        "processes that prepare batches beside each training process", ge=0)] = 0  # fmt: skip


@dataclass(frozen=True)
class Needs:
    """What a kind of training can use, beside which the `Hardware` that is asked for is checked.

    Attributes:
        wide: Whether the network is wide enough for bfloat16 to pay on a CPU.
        most_threads: Most threads that a process uses unless set otherwise; None leaves PyTorch's own number.
        no_workers: Why the training has no loader processes, as the end of a message; empty if it can have them.
    """

    wide: bool = False
    most_threads: int | None = None
    no_workers: str = ""


def needs_of(preset: str, group: str, no_workers: str = "") -> Needs:
    """Return what the training of a visual-force network can use.

    Args:
        preset: Name of the network's layer sizes, a key of `networks.presets.PRESETS`.
        group: Name of the network's symmetry group; ``none`` for ordinary layers.
        no_workers: Why the training has no loader processes, if it has none.
    """
    return Needs(preset in WIDE and group != "none", MOST_THREADS.get(preset, 1), no_workers=no_workers)
