"""A training gets the hardware that is asked for, or one line says what there is."""

import re
import subprocess
import sys

import pytest
import torch
from rich.console import Console

from svfl_data.errors import UsageError
from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.train import train_centering
from svfl_models.training import placement
from svfl_models.training.hardware import Hardware, Needs, needs_of
from svfl_models.training.placement import placed

WIDE, NARROW = needs_of("paper", "D4"), needs_of("default", "D4")


@pytest.fixture
def gpus(monkeypatch):
    """Pretends that there are as many CUDA devices as it is told; none before that."""

    def pretend(count):
        monkeypatch.setattr(torch.cuda, "device_count", lambda: count)

    pretend(0)
    return pretend


@pytest.mark.parametrize(
    ("asked", "count", "accelerator", "devices"),
    [
        (Hardware(), 0, "auto", 1),
        (Hardware(), 2, "auto", 1),
        (Hardware("cpu", devices=3), 2, "cpu", 3),
        (Hardware("cuda", devices=2), 2, "cuda", 2),
        (Hardware("1"), 2, "cuda", [1]),
    ],
)
def test_devices_are_those_that_are_asked_for(asked, count, accelerator, devices, gpus):
    gpus(count)
    found = placed(asked, NARROW)
    assert (found.accelerator, found.devices, found.precision) == (accelerator, devices, "32")
    assert found.processes == asked.devices
    assert found.on_gpu == (count > 0 and asked.device != "cpu")


@pytest.mark.parametrize(
    ("asked", "count", "words"),
    [
        (Hardware("cuda"), 0, "--device cuda: no CUDA device here; possible: auto, cpu"),
        (Hardware("0"), 0, "--device 0: no CUDA device here; possible: auto, cpu"),
        (Hardware("2"), 2, "--device 2: no such CUDA device here; possible: auto, cpu, cuda, 0, 1"),
        (Hardware("tpu"), 0, "--device tpu: not a device; possible: auto, cpu"),
        (Hardware("-1"), 1, "--device -1: not a device; possible: auto, cpu, cuda, 0"),
        (Hardware("1", devices=2), 2, "--devices 2 with --device 1: that is one device; use cuda"),
        (Hardware("cuda", devices=3), 2, "--devices 3: 2 CUDA devices here; --device cpu has no such limit"),
        (Hardware(devices=3), 2, "--devices 3: 2 CUDA devices here; --device cpu has no such limit"),
        (Hardware(devices=0), 0, "--devices 0: possible are integers of at least 1"),
        (Hardware(threads=0), 0, "--threads 0: possible are integers of at least 1"),
        (Hardware(loader_workers=-1), 0, "--loader-workers -1: possible are integers of at least 0"),
        (Hardware(precision="8"), 0, "--precision 8: possible: auto, 32, bf16, 16"),
        (Hardware(precision="16"), 0, "--precision 16: float16 needs a GPU; possible on the CPU: auto, 32, bf16"),
        (Hardware("cpu", 1, "16"), 1, "--precision 16: float16 needs a GPU; possible on the CPU: auto, 32, bf16"),
    ],
)  # fmt: skip
def test_what_is_not_there_is_one_line_and_exit_code_2(asked, count, words, gpus):
    gpus(count)
    with pytest.raises(UsageError, match=f"^{re.escape(words)}$") as raised:
        placed(asked, NARROW)
    assert raised.value.exit_code == 2


def test_what_a_training_cannot_use_is_refused():
    words = "--loader-workers 3: only 0 is possible here, for it has them"
    with pytest.raises(UsageError, match=f"^{re.escape(words)}$"):
        placed(Hardware("cpu", loader_workers=3), Needs(no_workers="it has them"))


@pytest.mark.parametrize("in_hardware", [True, False])
def test_bfloat16_is_chosen_where_it_pays(in_hardware, gpus, monkeypatch):
    """By itself only for wide networks on hardware that has it, and never unless it is asked for."""
    monkeypatch.setattr(placement, "has_cpu_bf16", lambda: in_hardware)

    def precision(asked, needs):
        return placed(Hardware("cpu", precision=asked), needs).precision

    assert placed(Hardware(), WIDE).precision == "32"
    assert precision("auto", WIDE) == ("bf16" if in_hardware else "32")
    assert precision("auto", NARROW) == "32"
    assert precision("auto", needs_of("paper", "none")) == "32"
    assert precision("bf16", NARROW) == "bf16"
    assert ("slower than 32" in placed(Hardware(precision="bf16"), WIDE).note) == (not in_hardware)


def test_a_remark_is_printed(monkeypatch, capsys):
    monkeypatch.setattr(placement, "has_cpu_bf16", lambda: False)
    placed(Hardware("cpu", precision="bf16"), WIDE).prepare(Console())
    assert "does not compute in bfloat16 itself" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    ("have", "asked", "needs", "expected"),
    [
        (16, Hardware("cpu"), NARROW, 1),
        (16, Hardware("cpu"), WIDE, 8),
        (4, Hardware("cpu"), WIDE, 4),
        (4, Hardware("cpu", devices=2), WIDE, 2),
        (1, Hardware("cpu", devices=2), WIDE, 1),
        (1, Hardware("cpu", threads=3), NARROW, 3),
        (4, Hardware("cpu"), Needs(), None),
    ],
)
def test_threads_are_those_that_pay_or_that_are_asked_for(have, asked, needs, expected, monkeypatch):
    monkeypatch.setattr(torch, "get_num_threads", lambda: have)
    assert placed(asked, needs).threads == expected


def test_options_are_described_without_loading_a_heavy_library():
    code = (
        "import sys, svfl_models.training.hardware as h\n"
        "from svfl_models.configuration.setting import settings_of\n"
        "assert all(one.help for one in settings_of(h.Hardware))\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"torch", "lightning"} & {*done.stdout.split()}


def test_the_samples_of_block_centering_are_prepared_by_the_training(tmp_path):
    with pytest.raises(UsageError, match="--loader-workers 2"):
        train_centering(TrainingConfig(str(tmp_path)), tmp_path / "out", hardware=Hardware(loader_workers=2))
    assert not (tmp_path / "out").exists()
