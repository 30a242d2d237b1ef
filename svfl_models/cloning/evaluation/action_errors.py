"""Measures how far a policy's actions are from those of held-out demonstrations, without simulator.

The actions are those that a training learns (the expert's where they were recorded), and the observations are cut as in
training, so that on the demonstrations that a training holds out the errors are those of its last validation.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.special import stdtrit

from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import DatasetError
from svfl_data.sampling.split import split_episodes
from svfl_data.system.printable import markdown
from svfl_data.system.progress import progress
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.config import CloningConfig
from svfl_models.cloning.data import VALID_BATCH, Demonstrations, successful
from svfl_models.cloning.evaluation.recorded_as_learned import expect_fitting
from svfl_models.cloning.module import CloningModule
from svfl_models.cloning.own_data import OwnDemonstrations
from svfl_models.training.writing import write_json, write_text

LEVEL = 0.95
WORDS = {
    "gripper": ("gripper wrong", 100.0, "%"),
    "xy_mm": ("(dx, dy) off", 1.0, "mm"),
    "z_mm": ("dz off", 1.0, "mm"),
    "turn_deg": ("dtheta off", 1.0, "deg"),
    "error": ("action off", 100.0, "% of half the range between its bounds"),
}
"""Words, factor and unit of each error, by its name in `module.CloningModule.action_errors`."""


@dataclass(frozen=True)
class Mean:
    """Mean of an error over episodes.

    Attributes:
        mean: Mean of the episodes' means.
        interval: Ends of its 95 % interval for other episodes of the same kind (Student's t, episodes as the unit);
            None for a single episode.
    """

    mean: float
    interval: tuple[float, float] | None


@dataclass(frozen=True)
class ActionErrors:
    """Errors of a policy's actions on the episodes of a dataset.

    Attributes:
        checkpoint: Path of the policy's checkpoint.
        data: Path of the dataset.
        task: Task of the episodes.
        learned_task: Task that the policy has learned.
        held_out: Whether episodes of the dataset were left out because the policy has learned from them.
        episodes: Index of each episode.
        steps: Number of steps of each episode.
        errors: Mean of each error over the steps of each episode, by the names of `WORDS`; for an action of the user's
            own also of each component, as a share of half the range between its bounds, by the component's name.
    """

    checkpoint: str
    data: str
    task: str
    learned_task: str
    held_out: bool
    episodes: list[int]
    steps: list[int]
    errors: dict[str, list[float]]

    @property
    def means(self) -> dict[str, Mean]:
        """Mean of each error over the episodes, by its name."""
        return {name: mean_of(values) for name, values in self.errors.items()}

    def __str__(self) -> str:
        words = ", ".join(f"{_words(name)[0]} {_value(name, mean)}" for name, mean in self._headline().items())
        return f"{self.checkpoint}: {self._extent()}: {words}"

    def plain(self) -> dict[str, Any]:
        """Return the attributes and the means over the episodes as JSON values."""
        return asdict(self) | {"means": {name: asdict(mean) for name, mean in self.means.items()}}

    def save(self, file: Path) -> Path:
        """Write the errors as JSON, and as a Markdown page beside it.

        Args:
            file: JSON file to write.

        Returns:
            The page, which has the name of the file with the suffix ``.md``.

        Raises:
            StorageError: If a file cannot be written.
        """
        page = file.with_suffix(".md")
        write_json(file, self.plain())
        write_text(page, self.page())
        return page

    def page(self) -> str:
        """Return the errors as a page in Markdown: the mean over the episodes, then each episode."""
        names = list(self.errors)
        heads = [f"{markdown(_words(name)[0])}, {_words(name)[2]}" for name in names]
        means = [_value(name, mean, unit=False) for name, mean in self.means.items()]
        rows = [["all, mean (95 % interval)", str(sum(self.steps)), *means]]
        for place, (index, steps) in enumerate(zip(self.episodes, self.steps, strict=True)):
            values = [f"{_words(name)[1] * self.errors[name][place]:.1f}" for name in names]
            rows.append([str(index), str(steps), *values])
        lines = [["episode", "steps", *heads], ["---"] * (len(names) + 2), *rows]
        table = "\n".join(f"| {' | '.join(line)} |" for line in lines)
        other = self.task != self.learned_task
        tasks = f" The policy has learned another task, {markdown(self.learned_task)}.\n" if other else ""
        single = " Of one episode the spread between episodes is unknown.\n" if len(self.episodes) == 1 else ""
        return (
            f"# Action errors of {markdown(self.checkpoint)}\n\n"
            f"{self._extent()[0].upper()}{self._extent()[1:]}.{tasks}{single}\n\n{table}\n"
        )

    def _extent(self) -> str:
        count = len(self.episodes)
        some = f"{count} episode{'s' * (count > 1)}"
        kind = "that it has not learned from " if self.held_out else ""
        return f"{some} {kind}of {markdown(self.data)} ({markdown(self.task)}), {sum(self.steps)} steps"

    def _headline(self) -> dict[str, Mean]:
        """Return the errors of a line: those in common units, or the mean over the components."""
        names = [name for name in self.errors if name in WORDS and (name != "error" or "xy_mm" not in self.errors)]
        return {name: mean for name, mean in self.means.items() if name in names}


def _words(name: str) -> tuple[str, float, str]:
    return WORDS.get(name, (name, 100.0, "% of half its range"))


def _value(name: str, found: Mean, unit: bool = True) -> str:
    _, factor, of = _words(name)
    ends = "" if found.interval is None else " ({:.1f} to {:.1f})".format(*(factor * end for end in found.interval))
    return f"{factor * found.mean:.1f}{ends}" + (f" {of}" if unit else "")


def mean_of(values: Sequence[float]) -> Mean:
    """Return the mean of the episodes' errors with its interval, whose lower end is at least 0.

    Args:
        values: Mean error of each episode.
    """
    mean, count = float(np.mean(values)), len(values)
    if count == 1:
        return Mean(mean, None)
    reach = float(stdtrit(count - 1, (1 + LEVEL) / 2) * np.std(values, ddof=1) / np.sqrt(count))
    return Mean(mean, (max(0.0, mean - reach), mean + reach))


def action_errors(checkpoint: Path, data: Path, episodes: int | None = None) -> ActionErrors:
    """Compare the actions of a policy with those of demonstrations that it has not learned from.

    Episodes that failed are left out, as in training. If the dataset is the one that the policy has learned from, so
    are the episodes that it has learned from.

    Args:
        checkpoint: Checkpoint file that ``svfl-train bc`` has written.
        data: Dataset folder.
        episodes: Largest number of episodes to use, the first ones; None for all.

    Raises:
        FormatError: If the file is not a checkpoint of a policy.
        DatasetError: If no episode is left, or the episodes do not have what the policy has learned from: its camera,
            inputs, action or control rate.
        FieldError: If an episode lacks a field.
    """
    module, dataset = load_policy(checkpoint), Dataset.open(data)
    config = configuration(module, str(data))
    chosen, left_out = _unseen(module, dataset)
    chosen = chosen[:episodes]
    if not chosen:
        raise DatasetError(
            f"{dataset.path}: no successful episodes" + (" but those that the policy has learned from" * left_out)
        )
    deployment = expect_fitting(module, dataset, chosen, config)
    kind = OwnDemonstrations if deployment.inputs else Demonstrations
    steps: list[int] = []
    errors: dict[str, list[float]] = {}
    for index in progress(chosen, "comparing episodes"):
        part = kind(dataset, [index], deployment, config, random=False)
        steps.append(len(part))
        for name, value in _of_episode(module, part).items():
            errors.setdefault(name, []).append(value)
    return ActionErrors(
        checkpoint=str(checkpoint),
        data=str(data),
        task=dataset.episode(chosen[0]).meta.task,
        learned_task=module.deployment.task,
        held_out=left_out,
        episodes=chosen,
        steps=steps,
        errors=errors,
    )


def configuration(module: CloningModule, data: str) -> CloningConfig:
    """Return the configuration that a policy was trained with, for another dataset and without random changes.

    Args:
        module: The trained policy.
        data: Dataset folder that takes the place of the training's one.
    """
    trained: dict[str, Any] = dict(module.hparams["training"] or {"view": module.view})
    names = {one.name for one in fields(CloningConfig)} - {"inputs", "action"}
    network = {name: value for name, value in module.hparams["network"].items() if name in names}
    return CloningConfig(**network | trained | {"data": data})


def _unseen(module: CloningModule, dataset: Dataset) -> tuple[list[int], bool]:
    """Return the successful episodes that a policy has not learned from, and whether others were left out."""
    found = [index for index in dataset.indices if dataset.episode(index).meta.success]
    trained = module.hparams["training"]
    if not trained or Path(trained["data"]).resolve() != dataset.path.resolve():
        return found, False
    config = CloningConfig(**trained)
    shares = {"train": 1 - config.valid, "valid": config.valid}
    learned = set(split_episodes(successful(dataset, config.episodes), shares, config.seed)["train"])
    return [index for index in found if index not in learned], True


@torch.inference_mode()
def _of_episode(module: CloningModule, part: Demonstrations | OwnDemonstrations) -> dict[str, float]:
    """Return the mean of each error over the steps of an episode."""
    sums: dict[str, float] = {}
    for first in range(0, len(part), VALID_BATCH):
        keys = range(first, min(first + VALID_BATCH, len(part)))
        batch = part.batch(keys)
        said = module(batch)
        found = module.action_errors(said, batch["action"])
        if module.deployment.inputs:
            space = said.space
            off = (space.to_unit(said.mode) - space.to_unit(batch["action"])).abs().mean(dim=0)
            names = space.names or tuple(map(str, range(len(space))))
            found |= dict(zip(names, off, strict=True))
        for name, value in found.items():
            sums[name] = sums.get(name, 0.0) + len(keys) * float(value)
    return {name: value / len(part) for name, value in sums.items()}
