"""Pretrains a latent model: loads and splits the episodes, fits the model and writes the results."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import lightning.pytorch as pl
from rich.console import Console
from torch.utils.data import DataLoader

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import TrainingError
from svfl_data.sampling.named_camera import camera_of_dataset
from svfl_data.system.printable import printable
from svfl_data.system.progress import progress_console
from svfl_models.latent.checkpoint import load_latent, read_latent
from svfl_models.latent.config import LatentConfig
from svfl_models.latent.data import Leg, Sequences, fit, sequences_of
from svfl_models.latent.evaluation.evaluate import sample_figures
from svfl_models.latent.evaluation.frames import follow
from svfl_models.latent.evaluation.pages.sample_figures import reconstructions
from svfl_models.latent.module import LatentModule
from svfl_models.latent.progress import LegsFile, StepsBar
from svfl_models.latent.report import LatentResult, write_report
from svfl_models.symmetry.actions import Batch
from svfl_models.training import run_folder
from svfl_models.training.hardware import Hardware, Needs
from svfl_models.training.placement import placed
from svfl_models.training.provenance.callback import ProvenanceRecord
from svfl_models.training.provenance.session import dataset
from svfl_models.training.run_settings import settings_of_run
from svfl_models.training.trackers.names import check_trackers
from svfl_models.training.trackers.trackers import Trackers, opened
from svfl_models.training.trainer import parameter_count, run, storage_errors
from svfl_models.training.writing import write_json

PROGRAM = "latent"
NEEDS = Needs(wide=True)


def train_latent(
    config: LatentConfig,
    out: Path,
    console: Console | None = None,
    *,
    hardware: Hardware = Hardware(),  # noqa: B008 - a value, frozen
    loggers: Sequence[str] = (),
) -> LatentResult:
    """Pretrain one model; the same configuration gives the same result on the same machine, interrupted or not.

    Args:
        config: Configuration of the model, the data and the training.
        out: Folder for the checkpoint, metrics, result, learning curves and report. If it holds an unfinished training
            of the same configuration, or a finished one with fewer steps and a constant learning rate, that training is
            resumed after its last checkpoint.
        console: Console that progress is shown on; standard error by default.
        hardware: Devices, number format, threads and loader processes.
        loggers: Names of experiment trackers to log to, beside the metrics file (`training.trackers`).

    Returns:
        The outcome, which is also written to ``result.json``.

    Raises:
        UsageError: If the hardware or a tracker is not there.
        SvflError: If the data, the configuration or the folder cannot be used, or the training diverges.
        KeyboardInterrupt: If the user stopped the training; ``checkpoint.ckpt`` holds the last complete leg.

    Example:
        >>> from pathlib import Path
        >>> config = LatentConfig("data/block_picking", "poe", steps=10_000)
        >>> train_latent(config, Path("out/latent_poe"))  # doctest: +SKIP
    """
    console = console or progress_console()
    check_trackers(loggers)
    placement = placed(hardware, NEEDS)
    placement.prepare(console)
    config = replace(config, camera=camera_of_dataset(Dataset.open(config.data), config.camera))
    earlier = _earlier(config, out)
    rebuild = partial(built, config, earlier, hardware.loader_workers)
    module, data = rebuild()
    train, valid = data.train, data.valid
    parts = {name: parameter_count(part) for name, part in module.network.named_children() if name != "inputs"}
    beside = settings_of_run(hardware, loggers)
    with run_folder.held(out):
        if earlier is None:
            run_folder.claim(out, PROGRAM, config.plain(), beside)
        else:
            run_folder.write_config(out, PROGRAM, config.plain(), beside)
        _announce(config, train, valid, console)
        metrics = LegsFile(out / run_folder.METRICS, module.steps)
        provenance = ProvenanceRecord(out, {"data": dataset(config.data)}, [config.seed])
        watching, left = [metrics, StepsBar(config.steps, console), provenance], config.steps - module.steps
        with storage_errors(out), opened(loggers, out, earlier is not None, module.steps) as trackers:
            trackers.configuration(config.plain())
            run(
                module, data, out, watching, placement=placement, trackers=trackers, rebuild=rebuild,
                max_epochs=-1, max_steps=left, reload_dataloaders_every_n_epochs=1,
            )  # fmt: skip
            if trackers:
                _log_reconstructions(module, valid, out, trackers)
        last = metrics.rows[-1]
        result = LatentResult(int(last["step"]), last["seconds"], parts, len(train), len(valid), last)
        with storage_errors(out):
            write_report(out, config, result, metrics.rows, provenance.sessions)
        content = {"config": config.plain(), "result": asdict(result), "hardware": placement.plain()}
        write_json(out / run_folder.RESULT, content)
    return result


class LatentData(pl.LightningDataModule):
    """Batches of a pretraining, one leg at a time; an epoch of Lightning is one leg.

    Args:
        train: Sequences to train on.
        valid: Sequences to validate on after each leg.
        config: Configuration that gives the number of steps, the batch size, the seed and the length of a leg.
        module: Module that is trained; it gives the number of steps done so far.
        loader_workers: Number of processes that prepare training batches; the batches are the same with any number.
    """

    def __init__(
        self, train: Sequences, valid: Sequences, config: LatentConfig, module: LatentModule, loader_workers: int = 0
    ) -> None:
        super().__init__()
        self.train, self.valid, self.config, self.module = train, valid, config, module
        self.loader_workers = loader_workers

    def train_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of the batches of the next leg."""
        config, first = self.config, self.module.steps
        steps = range(first, min(first + config.checkpoint_every, config.steps))
        leg = Leg(len(self.train), config.batch_size, config.seed, steps)
        return DataLoader(self.train, sampler=leg, batch_size=None, num_workers=self.loader_workers)

    def val_dataloader(self) -> DataLoader[Batch]:
        """Return a loader of all held-out sequences, in their order."""
        size, count = self.config.batch_size, len(self.valid)
        batches = [list(range(start, min(start + size, count))) for start in range(0, count, size)]
        return DataLoader(self.valid, sampler=batches, batch_size=None)


def built(config: LatentConfig, earlier: Path | None, loader_workers: int = 0) -> tuple[LatentModule, LatentData]:
    """Load the episodes and build the model; the same configuration gives the same in every process.

    Args:
        config: Configuration of the model, the data and the training.
        earlier: Checkpoint to resume from; None if the training begins anew.
        loader_workers: Number of processes that prepare batches.

    Raises:
        SvflError: If the data, the configuration or the checkpoint cannot be used.
    """
    train, valid, split = sequences_of(config)
    pl.seed_everything(config.seed, verbose=False)
    module = LatentModule(
        config.network(), config.objective(), config.learning_rate, config.seed, config.plain(), split.parts,
        config.schedule, config.steps,
    )  # fmt: skip
    if earlier is None:
        fit(module.network.inputs, train.recordings)
    else:
        module.go_on(read_latent(earlier))
    return module, LatentData(train, valid, config, module, loader_workers)


def _log_reconstructions(module: LatentModule, valid: Sequences, out: Path, trackers: Trackers) -> None:
    """Log originals and reconstructions of frames of a held-out episode."""
    network = module.network.eval()
    samples = sample_figures(network, follow(network, valid.recordings[:1]))
    trackers.picture("reconstructions", reconstructions(samples, out / run_folder.RECONSTRUCTIONS))


def _earlier(config: LatentConfig, out: Path) -> Path | None:
    """Return the checkpoint to resume from; None if the training begins anew.

    It does so without a checkpoint, and after a finished training with as many steps. The number of steps may only
    grow, and only if the learning rate is constant: any other one has taken its course over the steps.

    Raises:
        TrainingError: If the checkpoint has another configuration, or already has as many steps as asked for.
        FormatError: If there is no sound checkpoint.
    """
    checkpoint = out / run_folder.CHECKPOINT
    if not checkpoint.exists() or run_folder.read_config(out) is None:
        return None  # `run_folder.claim` reports what is wrong
    load_latent(checkpoint)  # reports a damaged checkpoint before the training starts
    found = read_latent(checkpoint)
    before, now = {"camera": config.camera} | found["hyper_parameters"]["training"], config.plain()
    free = ("steps",) if config.schedule == "constant" else ()
    changed = [
        f"{name} = {before.get(name)!r}, now {value!r}"
        for name, value in now.items()
        if name not in free and before.get(name) != value
    ]
    if changed:
        raise TrainingError(f"{checkpoint} is of a training with {'; '.join(changed)}; choose another --out")
    done = found["svfl"]["steps"]
    if done > config.steps:
        raise TrainingError(f"{checkpoint} was trained for {done} steps already; asked for {config.steps}")
    return checkpoint if done < config.steps else None


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
