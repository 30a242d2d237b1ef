"""Pretrains a latent model: loads and splits the episodes, fits the model and writes the results."""

from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import lightning.pytorch as pl
from rich.console import Console
from torch.utils.data import DataLoader

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError
from svfl_data.sampling.named_camera import camera_of_dataset
from svfl_data.system.printable import printable
from svfl_models.latent.checkpoint import load_latent, read_latent
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.data import Leg, Sequences, fit, sequences_of
from svfl_models.latent.module import LatentModule
from svfl_models.latent.progress import LegsFile, StepsBar
from svfl_models.latent.report import LatentResult, write_report
from svfl_models.symmetry.actions import Batch
from svfl_models.training import run_folder
from svfl_models.training.trainer import parameter_count, run, storage_errors
from svfl_models.training.writing import write_json


def train_latent(config: LatentConfig, out: Path, resume: bool = False, console: Console | None = None) -> LatentResult:
    """Pretrain one model; the same configuration gives the same result on the same machine, interrupted or not.

    Args:
        config: Configuration of the model, the data and the training.
        out: Folder for the checkpoint, metrics, result, learning curves and report.
        resume: Whether to resume from the checkpoint in `out`. The configuration must be the same except for the number
            of steps.
        console: Console that progress is printed on; standard output by default.

    Returns:
        The outcome, which is also written to ``result.json``.

    Raises:
        SvflError: If the data, the configuration or the folder cannot be used, or the training diverges.
        KeyboardInterrupt: If the user stopped the training; ``checkpoint.ckpt`` holds the last complete leg.

    Example:
        >>> from pathlib import Path
        >>> config = LatentConfig("data/block_picking", "poe", steps=10_000)
        >>> train_latent(config, Path("out/latent_poe"))  # doctest: +SKIP
    """
    console = console or Console()
    config = replace(config, camera=camera_of_dataset(Dataset.open(config.data), config.camera))
    earlier = _earlier(config, out) if resume else None
    if not resume:
        _expect_none(out)
    train, valid, split = sequences_of(config)
    pl.seed_everything(config.seed, verbose=False)
    module = LatentModule(
        config.network(), config.objective(), config.learning_rate, config.seed, config.plain(), split.parts
    )
    if earlier is None:
        fit(module.network.inputs, train.recordings)
    else:
        module.go_on(earlier)
    parts = {name: parameter_count(part) for name, part in module.network.named_children() if name != "inputs"}
    with run_folder.held(out):
        if earlier is None:
            run_folder.claim(out, config.plain())
        else:
            write_json(out / run_folder.CONFIG, config.plain())
        _announce(config, train, valid, console)
        metrics = LegsFile(out / run_folder.METRICS, module.steps)
        data, watching = LatentData(train, valid, config, module), [metrics, StepsBar(config.steps, console)]
        left = config.steps - module.steps
        with storage_errors(out):
            run(module, data, out, watching, max_epochs=-1, max_steps=left, reload_dataloaders_every_n_epochs=1)
        last = metrics.rows[-1]
        result = LatentResult(int(last["step"]), last["seconds"], parts, len(train), len(valid), last)
        with storage_errors(out):
            write_report(out, config, result, metrics.rows)
        write_json(out / run_folder.RESULT, {"config": config.plain(), "result": asdict(result)})
    return result


class LatentData(pl.LightningDataModule):
    """Batches of a pretraining, one leg at a time; an epoch of Lightning is one leg.

    Args:
        train: Sequences to train on.
        valid: Sequences to validate on after each leg.
        config: Configuration that gives the number of steps, the batch size, the seed and the length of a leg.
        module: Module that is trained; it gives the number of steps done so far.
    """

    def __init__(self, train: Sequences, valid: Sequences, config: LatentConfig, module: LatentModule) -> None:
        super().__init__()
        self.train, self.valid, self.config, self.module = train, valid, config, module

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of the batches of the next leg."""
        config, first = self.config, self.module.steps
        steps = range(first, min(first + config.checkpoint_every, config.steps))
        return DataLoader(
            self.train, sampler=Leg(len(self.train), config.batch_size, config.seed, steps), batch_size=None
        )

    def val_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of all held-out sequences, in their order."""
        size, count = self.config.batch_size, len(self.valid)
        batches = [list(range(start, min(start + size, count))) for start in range(0, count, size)]
        return DataLoader(self.valid, sampler=batches, batch_size=None)


def _expect_none(out: Path) -> None:
    """Refuse an output folder that already holds a checkpoint, whose training could be resumed."""
    checkpoint = out / run_folder.CHECKPOINT
    if checkpoint.exists():
        raise TrainingError(f"{checkpoint} exists; --resume goes on from there, or choose another --out")


def _earlier(config: LatentConfig, out: Path) -> dict[str, Any]:
    """Return the content of the checkpoint to resume from.

    Raises:
        TrainingError: If the checkpoint has another configuration, or already has as many steps as asked for.
        FormatError: If there is no sound checkpoint.
    """
    checkpoint = out / run_folder.CHECKPOINT
    load_latent(checkpoint)  # reports a damaged checkpoint before the training starts
    found = read_latent(checkpoint)
    before, now = {"camera": config.camera} | found["hyper_parameters"]["training"], config.plain()
    changed = [
        f"{name} = {before.get(name)!r}, now {value!r}"
        for name, value in now.items()
        if name != "steps" and before.get(name) != value
    ]
    if changed:
        raise TrainingError(f"{checkpoint} is of a training with {'; '.join(changed)}; choose another --out")
    done = found["svfl"]["steps"]
    if done >= config.steps:
        raise TrainingError(f"{checkpoint} was trained for {done} steps already; asked for {config.steps}")
    return found


def _announce(config: LatentConfig, train: Sequences, valid: Sequences, console: Console) -> None:
    pressed, touched = (
        sum(int(getattr(one, name).sum()) for one in train.recordings)
        / sum(len(getattr(one, name)) for one in train.recordings)
        for name in ("pressed", "touched")
    )
    lines = [
        f"{config.model}, preset {config.preset}: {len(train)} sequences of {len(train.recordings)} episodes, "
        f"{len(valid)} of {len(valid.recordings)} held out",
        f"force above {config.contact_n:g} N in {pressed:.0%} of the frames, contact in {touched:.0%} of the steps",
    ]
    if short := train.left_out + valid.left_out:
        lines.append(f"{short} episodes have fewer than {config.sequence} steps and are left out")
    for line in lines:
        console.print(printable(line), highlight=False, markup=False)
