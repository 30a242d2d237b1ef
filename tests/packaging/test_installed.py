"""An installed wheel is used from another folder: alone in a clean environment, and with all libraries for the demo."""

import os
import re

import pytest

from tests.helpers.installed import PIP, Installed
from tests.helpers.tracked import ROOT

pytestmark = pytest.mark.slow

RECORD = """
import numpy as np
import svfl_data

assert "site-packages" in svfl_data.__file__, svfl_data.__file__
dataset = svfl_data.Dataset.create_or_resume("mine", task="wiping", seed=0, config={})
for episode in range(4):
    meta = svfl_data.Meta("wiping", svfl_data.NEXT, 0, "robot", success=bool(episode % 2))
    with svfl_data.EpisodeWriter(dataset, meta, {"streams/wrench/tare": np.zeros(6)}) as writer:
        wrench = np.random.default_rng(episode).normal(0, 1, (500, 6)).astype(np.float32)
        writer.append("streams/wrench", t_ns=np.arange(500) * 2_000_000, wrench=wrench)
        writer.append("observations", t_ns=np.arange(11) * 50_000_000 + 400_000_000)
        writer.append("actions", action=np.tile(np.float32([1, 0.01, 0, 0, 0]), (10, 1)))
        writer.seal(success=meta.success)
"""
LEARN = """
import svfl_data

dataset = svfl_data.open_dataset("mine")
assert len(dataset) == 4
samples = svfl_data.Samples(dataset, windows={"streams/wrench/wrench": 64})
assert samples[0]["streams/wrench/wrench"].shape == (64, 6)
"""


@pytest.fixture(scope="module")
def base(wheel, tmp_path_factory) -> Installed:
    """A clean environment with the base installation, from the package registry."""
    folder = tmp_path_factory.mktemp("base")
    made = Installed(folder / "environment", folder / "elsewhere")
    asked = made.run("python", *PIP, "--constraint", ROOT / "constraints.txt", wheel)
    if asked.returncode and "CI" not in os.environ and re.search(r"connection|resolv|retries", asked.stderr, re.I):
        pytest.skip("no package registry can be reached")
    assert asked.returncode == 0, asked.stderr
    return made


def test_the_base_installation_does_a_days_work_with_data(base):
    base.done("python", "-c", RECORD)
    base.done("svfl-data", "validate", "mine")
    assert "wiping" in base.done("svfl-data", "info", "mine")
    base.done("svfl-data", "split", "mine", "--ratios", "train=0.5", "test=0.5")
    base.done("svfl-data", "stats", "mine")
    base.done("svfl-data", "filter", "mine", "good", "--success", "yes")
    base.done("svfl-data", "merge", "good", "mine", "both", "--once")
    base.done("svfl-data", "pack", "mine", "packed")
    base.done("svfl-data", "unpack", "packed", "unpacked")
    base.done("svfl-data", "validate", "unpacked")
    base.done("python", "-c", LEARN)


def test_the_base_installation_says_which_extra_the_rest_needs(base):
    for words in (
        ("svfl-collect", "centering", "--episodes", "1", "--seed", "0", "--out", "new"),
        ("svfl-train", "centering", "--data", "new", "--out", "trained"),
        ("svfl-data", "view", "mine", "--out", "view.rrd"),
    ):
        ended = base.run(*words)
        assert (ended.returncode, ended.stdout) == (1, ""), words
        assert re.fullmatch(rf"{words[0]}: {words[1]} needs .*svfl\[\w+\].*\n", ended.stderr), ended.stderr


def test_the_demo_runs_with_the_wheel(wheel, tmp_path):
    installed = Installed(tmp_path / "environment", tmp_path / "elsewhere")
    installed.borrow_libraries()
    installed.done("python", *PIP, "--no-deps", "--no-index", wheel)
    found = installed.done(
        "python", "-c", "import collectors, svfl_models; print(collectors.__file__, svfl_models.__file__)"
    )
    assert found.count(str(tmp_path / "environment")) == 2
    installed.done("svfl-collect", "centering", "--episodes", "8", "--seed", "0", "--out", "samples")
    installed.done(
        "svfl-collect", "expert", "--task", "household_picking", "--episodes", "1", "--seed", "0", "--out", "picked"
    )
    for dataset in ("samples", "picked"):
        installed.done("svfl-data", "validate", dataset)
    few = ["--train-samples", "4", "--test-samples", "4", "--epochs", "1", "--preset", "tiny"]
    installed.done("svfl-train", "centering", "--data", "samples", *few, "--seed", "0", "--out", "trained")
    installed.done("svfl-train", "check", "trained/checkpoint.ckpt", "--data", "samples")
    installed.done("svfl-data", "view", "samples", "--checkpoint", "trained/checkpoint.ckpt", "--out", "view.rrd")
    assert (installed.work / "view.rrd").stat().st_size > 0
