"""Where and how a training runs on this machine: the hardware that is asked for, checked against what there is."""

from dataclasses import asdict, dataclass
from typing import Any

import torch
from rich.console import Console

from svfl_data.errors import UsageError
from svfl_data.system.printable import printable
from svfl_models.training.hardware import Hardware, Needs

CUDA = "cuda"
PRECISIONS = {"32": "32-true", "bf16": "bf16-mixed", "16": "16-mixed"}
"""Lightning's name of each number format."""


@dataclass(frozen=True)
class Placement:
    """Devices, number format and threads of a training, all of which this machine has.

    Attributes:
        accelerator: Lightning's kind of device.
        devices: Number of devices, or the numbers of CUDA devices.
        precision: Number format: ``32``, ``bf16`` or ``16``.
        threads: Number of threads of each process; None leaves PyTorch's own number.
        on_gpu: Whether the devices are GPUs.
        processes: Number of processes that share every batch.
        note: Remark for the user in one line; empty if there is none.
    """

    accelerator: str
    devices: int | list[int]
    precision: str
    threads: int | None
    on_gpu: bool = False
    processes: int = 1
    note: str = ""

    def trainer(self) -> dict[str, Any]:
        """Return the arguments of Lightning's Trainer."""
        return {"accelerator": self.accelerator, "devices": self.devices, "precision": PRECISIONS[self.precision]}

    def plain(self) -> dict[str, Any]:
        """Return what the training used as plain values, for its result."""
        return {name: value for name, value in asdict(self).items() if name != "note"}

    def prepare(self, console: Console) -> None:
        """Print the remark, if there is one, and set PyTorch's number of threads in this process."""
        if self.note:
            console.print(self.note, highlight=False, markup=False)
        self.use_threads()

    def use_threads(self) -> None:
        """Set PyTorch's number of threads in this process."""
        if self.threads is not None:
            torch.set_num_threads(self.threads)


def placed(hardware: Hardware, needs: Needs) -> Placement:
    """Decide where a training runs.

    Args:
        hardware: Hardware that is asked for.
        needs: What the kind of training can use.

    Raises:
        UsageError: If this machine, or the kind of training, does not have what is asked for.
    """
    _check_counts(hardware, needs)
    cuda = torch.cuda.device_count()
    accelerator, devices = _devices(hardware, cuda)
    on_gpu = accelerator == CUDA or (accelerator == "auto" and cuda > 0)
    precision, note = _precision(hardware, needs, on_gpu)
    return Placement(accelerator, devices, precision, _threads(hardware, needs), on_gpu, hardware.devices, note)


def has_cpu_bf16() -> bool:
    """Return whether this processor computes in bfloat16 (AVX512-BF16 or AMX) instead of converting to float32."""
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()


def _check_counts(hardware: Hardware, needs: Needs) -> None:
    for name, least in (("devices", 1), ("threads", 1), ("loader_workers", 0)):
        value = getattr(hardware, name)
        if value is not None and value < least:
            raise UsageError(f"--{name.replace('_', '-')} {value}: possible are integers of at least {least}")
    if hardware.loader_workers and needs.no_workers:
        raise UsageError(f"--loader-workers {hardware.loader_workers}: only 0 is possible here, for {needs.no_workers}")


def _devices(hardware: Hardware, cuda: int) -> tuple[str, int | list[int]]:
    """Return Lightning's kind of device and the devices, of the `cuda` CUDA devices that there are."""
    asked, numbers = hardware.device, [str(number) for number in range(cuda)]
    possible = ", ".join(["auto", "cpu", *([CUDA] if cuda else []), *numbers])
    if asked not in ("auto", "cpu", CUDA) and not (asked.isascii() and asked.isdigit()):
        raise UsageError(f"--device {printable(asked, 40)}: not a device; possible: {possible}")
    if asked not in possible.split(", "):
        what = "no CUDA device" if not cuda else "no such CUDA device"
        raise UsageError(f"--device {asked}: {what} here; possible: {possible}")
    if asked in numbers:
        if hardware.devices > 1:
            raise UsageError(f"--devices {hardware.devices} with --device {asked}: that is one device; use {CUDA}")
        return CUDA, [int(asked)]
    if hardware.devices > max(1, cuda) and (asked == CUDA or (asked == "auto" and cuda)):
        raise UsageError(f"--devices {hardware.devices}: {cuda} CUDA devices here; --device cpu has no such limit")
    return asked, hardware.devices


def _precision(hardware: Hardware, needs: Needs, on_gpu: bool) -> tuple[str, str]:
    """Return the number format, and a remark about it or an empty text."""
    asked = hardware.precision
    if asked not in ("auto", *PRECISIONS):
        raise UsageError(f"--precision {printable(asked, 40)}: possible: auto, {', '.join(PRECISIONS)}")
    if asked == "16" and not on_gpu:
        raise UsageError("--precision 16: float16 needs a GPU; possible on the CPU: auto, 32, bf16")
    if asked in ("32", "16"):
        return asked, ""
    in_hardware = torch.cuda.is_bf16_supported(including_emulation=False) if on_gpu else has_cpu_bf16()
    if asked == "auto":
        return ("bf16" if needs.wide and in_hardware else "32"), ""
    where = "GPU" if on_gpu else "processor"
    slow = f"this {where} does not compute in bfloat16 itself: bf16 will be slower than 32"
    return asked, "" if in_hardware else slow


def _threads(hardware: Hardware, needs: Needs) -> int | None:
    """Return the number of threads of each process; without a number of the user's, no more than there are now."""
    if hardware.threads is not None or needs.most_threads is None:
        return hardware.threads
    return min(max(1, torch.get_num_threads() // hardware.devices), needs.most_threads)
