"""Latent experiment, which compares pretrained latent models with networks that learn from few labels only."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from svfl_data.system.printable import markdown as escaped
from svfl_models.centering.config import USES, Latent, TrainingConfig
from svfl_models.centering.data import VIEWS
from svfl_models.centering.pretrained import settings
from svfl_models.centering.report import NAMES, latent_name, pretraining
from svfl_models.experiments.figures import MODEL_COLOURS, accuracy_label, best_known, few_ticks, line, panels
from svfl_models.experiments.page import MODELS, accuracy_words, heading, markdown, tests
from svfl_models.experiments.results import Cell, Results
from svfl_models.training.figures import save

TITLE = "Block centering: pretrained latent models"
SHARE_OF_EPOCHS = {"frozen": 1.0, "fine-tuned": 0.3, "from-scratch": 0.3}
"""Number of epochs by use of a latent encoder, as a share of the epochs of the other networks."""
STYLES = {"frozen": ("^:", "#cc79a7"), "fine-tuned": ("o-", "#009e73"), "from-scratch": ("x--", "#555555")}


@dataclass(frozen=True)
class Row:
    """One row of the table, which is one network.

    Attributes:
        name: Name of the network in the table.
        latent: Pretrained encoder that the network is built on; None for a network without one.
        cells: Cells of the network, in the order of the numbers of training samples.
    """

    name: str
    latent: Latent | None
    cells: list[Cell]


def cells(
    base: TrainingConfig, train_samples: Sequence[int], latents: Sequence[Latent] = (), uses: Sequence[str] = USES
) -> list[TrainingConfig]:
    """Return the configurations of the experiment, all with seed 0.

    Args:
        base: Recipe that the configurations deviate from.
        train_samples: Sizes of the training set.
        latents: Pretrained encoders. The control without pretraining has the architecture of the first encoder of each
            kind.
        uses: Ways to use the encoders, some of `config.USES`.
    """
    networks = [replace(base, group=group) for group in MODELS.values()]
    for place, latent in enumerate(latents):
        known = latent.model in [other.model for other in latents[:place]]
        for use, share in SHARE_OF_EPOCHS.items():
            if use in uses and (use != "from-scratch" or not known):
                epochs = max(1, round(share * base.epochs))
                networks.append(replace(base, epochs=epochs, **settings(replace(latent, use=use), base.augment)))
    return [replace(network, train_samples=count) for network in networks for count in train_samples]


def table_rows(results: Results) -> list[Row]:
    """Return the rows of the table, one per network, in the order of the runs."""
    checkpoints = {(latent.model, latent.sha256) for latent in _latents(results)}
    models = [model for model, _ in checkpoints]
    found = []
    for latent in results.values("latent"):
        for group in MODELS.values():
            same = results.find(latent=latent, group=group)
            if same:
                name = latent_name(latent) if latent else heading(same[0].config)
                several = latent and latent.use != "from-scratch" and models.count(latent.model) > 1
                found.append(Row(f"{name} ({latent.sha256[:6]})" if several else name, latent, same))
    return found


def body(results: Results) -> str:
    """Return the page between title and recipe, in Markdown: the table, and what the encoders were pretrained on."""
    counts = results.values("train_samples")
    lines = []
    for row in table_rows(results):
        last = row.cells[-1]
        parameters = last.mean("parameters")
        cost = [f"{parameters.mean:,.0f}" if parameters else "-", f"{last.seconds.mean:.0f}" if last.seconds else "-"]
        for test in tests(results):
            named = test == tests(results)[0]
            words = [accuracy_words(cell, test) for cell in row.cells]
            lines.append([row.name if named else "", test, *words, *(cost if named else ["", ""])])
    header = ["network", "test", *(f"{count} samples" for count in counts), "learned", f"time, s ({counts[-1]})"]
    first = results.cells[0].config
    rate = max(latent.learning_rate for latent in _latents(results))
    return f"""\
Accuracy, %, by number of training samples. SVFL is symmetric under D4, CNN is its parameter-matched CNN baseline;
both see image and wrench window and are trained on the training samples only. The latent encoders see image,
wrench window and proprioception (the gripper's pose and opening) and encode them into one vector, from which a
linear layer scores the four directions. Its inputs are divided by their standard deviations over the training samples.

{_uses(dict.fromkeys(latent.use for latent in _latents(results)), rate, first.learning_rate)}

{markdown(header, lines)}

Learned: number of trained parameters. Time: of a training with {counts[-1]} samples, one thread; it depends on
the machine and its load.

![accuracy against training samples](latents.png)

## Pretraining

{markdown(["encoder", "pretrained on", "checkpoint", "SHA-256"], _sources(results))}

{_other_data(results)}The latents' inputs are normalised with the scales of the pretraining, those of SVFL and CNN with
the scales of their own training samples.

{_epochs(results)}
"""


def _other_data(results: Results) -> str:
    """Return a sentence on encoders that were pretrained on other data than the samples; empty if there are none."""
    data = results.cells[0].config.data
    other = sorted({latent.data for latent in _latents(results)} - {data})
    if not other:
        return ""
    return f"The samples are of {escaped(data)}, the pretraining used others: {', '.join(map(escaped, other))}. "


def _epochs(results: Results) -> str:
    """Return what was trained for how long, and the measured cost of training a whole encoder."""
    usual = results.cells[0].config.epochs
    epochs = {latent.use: results.find(latent=latent)[0].config.epochs for latent in _latents(results)}
    words = (
        f"SVFL and CNN were trained for {usual} epochs, the latents for "
        f"{', '.join(f'{count} ({NAMES[use]})' for use, count in epochs.items())}."
    )
    costs = _costs(results)
    if not costs:
        return words
    most = ", ".join(f"{NAMES[model]} {cost:.0f}" for model, cost in costs.items())
    return f"{words} An epoch that trains the whole encoder took as long as this many epochs of its head: {most}."


def _costs(results: Results) -> dict[str, float]:
    """Return how much longer an epoch lasts if the encoder is trained, for the largest training set, by model."""
    most, costs = max(results.values("train_samples")), {}
    seconds: dict[tuple[str, str], float] = {}
    for latent in _latents(results):
        (cell,) = results.find(latent=latent, train_samples=most)
        if cell.seconds and (epochs := cell.mean("epochs")):
            seconds[latent.model, latent.use] = cell.seconds.mean / epochs.mean
    for (model, use), duration in seconds.items():
        frozen = seconds.get((model, "frozen"))
        if use == "fine-tuned" and frozen:
            costs[model] = duration / frozen
    return costs


def _uses(uses: Iterable[str], encoder_rate: float, head_rate: float) -> str:
    """Return a list in Markdown that explains each use of an encoder that occurs in the experiment."""
    words = {
        "frozen": f"""\
- frozen: the encoder is not changed after its pretraining, and only the linear layer is trained. {VIEWS} crops of
  every sample are encoded once; their colours are not changed, since the encoder was not trained with such changes.""",
        "fine-tuned": f"- fine-tuned: the encoder is also trained, at a rate of {encoder_rate:g}; "
        f"the layer at {head_rate:g}.",
        "from-scratch": "- from scratch: the encoder learns from random weights, all else as for fine-tuned ones.",
    }
    return "\n".join(words[use] for use in uses)


def draw(results: Results, folder: Path) -> list[Path]:
    """Write the figure of accuracy by training samples: a panel for each kind of encoder, with SVFL and CNN in each.

    Args:
        results: Runs of the experiment.
        folder: Folder to write to.

    Returns:
        The file of the figure, in a list.
    """
    counts = results.values("train_samples")
    found = table_rows(results)
    kinds = list(dict.fromkeys(latent.model for latent in _latents(results)))
    figure, axes = panels(1, len(kinds), 4.2)
    for panel, kind in zip(axes, kinds, strict=True):
        for row in (row for row in found if row.latent is None or row.latent.model == kind):
            means = [best_known(cell, results) for cell in row.cells]
            if row.latent:
                shape, colour = STYLES[row.latent.use]
                line(panel, counts, means, fmt=shape, color=colour, label=NAMES[row.latent.use], markersize=5)
            else:
                model = row.cells[0].config.model
                line(panel, counts, means, fmt="s-", color=MODEL_COLOURS[model], label=row.name, markersize=4)
        panel.axhline(25, color="grey", linewidth=0.8, linestyle=":")
        panel.set(title=NAMES[kind], xlabel="training samples", xscale="log", ylim=(20, 102))
        few_ticks(panel, counts)
    axes[0].set_ylabel(accuracy_label(results))
    axes[0].text(counts[-1], 26, "chance", color="grey", ha="right", fontsize=8)
    named = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    if named:
        figure.legend(named.values(), named.keys(), loc="outside lower center", ncols=len(named))
    return [save(figure, folder / "latents.png")]


def _latents(results: Results) -> list[Latent]:
    return [latent for latent in results.values("latent") if latent]


def _sources(results: Results) -> list[list[str]]:
    """Return the rows of the table of pretrainings, one for each checkpoint."""
    rows = {
        latent.sha256: [NAMES[latent.model], pretraining(latent), f"`{latent.checkpoint}`", f"`{latent.sha256[:12]}`"]
        for latent in _latents(results)
    }
    return list(rows.values())
