"""The sound dataset that all kinds are made of."""

import shutil
import sys
from pathlib import Path
from unittest import mock

from svfl_data.cli import main
from tests.helpers.demonstrations import demonstrations

EPISODES = 10


def sound_dataset(folder: Path) -> Path:
    """Ten demonstrations with labels, an index, a split and statistics: every command ends well on it."""
    demonstrations(folder, EPISODES, size=76)
    for words in (["info"], ["split"], ["stats"]):
        with mock.patch.object(sys, "argv", ["svfl-data", words[0], str(folder), *words[1:]]):
            assert main() == 0
    return folder


def simulated_dataset(folder: Path) -> Path:
    """One short simulated episode, for commands that simulate it again."""
    from collectors.recording.worker import Worker
    from collectors.sources.expert import ExpertCollector
    from tests.helpers.collectors import SMALL

    collector = ExpertCollector(0, "block_picking", world=SMALL)
    worker = Worker(collector, folder, "block_picking", 0, collector.config())
    worker.dataset()
    worker.collect(0)
    collector.opened.close()
    return folder


def sound_models(campaign, folder: Path) -> Path:
    """A trained network of each kind, an exported policy and a replay buffer, made by the commands themselves."""
    from svfl_data.datasets.dataset import Dataset
    from svfl_data.replay import ReplayBuffer
    from tests.hostile.commands import COMMANDS, Command

    shutil.rmtree(folder, ignore_errors=True)  # of an attempt that failed
    folder.mkdir()
    by_name = {one.name: one for one in COMMANDS}
    campaign.prepare(None)
    for name in ("centering", "bc", "latent"):
        ended = campaign.run(by_name[name])
        assert ended.code == 0, (name, ended)
        made = campaign.box / "out" / "made"
        shutil.copy(made / "checkpoint.ckpt", folder / f"{name}.ckpt")
        shutil.copytree(made, folder / f"{name}_run")
    shutil.copy(folder / "bc.ckpt", campaign.template / "bc.ckpt")
    ended = campaign.run(
        Command("export", ("svfl-train", "export", "bc.ckpt", "--out", "out/m.pt2"), frozenset(), heavy=True)
    )
    assert ended.code == 0, ended.err
    shutil.copy(campaign.box / "out" / "m.pt2", folder / "policy.pt2")
    ReplayBuffer.from_demos(Dataset.open(campaign.sound), 4).save(folder / "buffer.replay")
    return folder
