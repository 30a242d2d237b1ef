"""Ablation experiment: the torque's type, augmentation instead of symmetry, the view, and the sensor's noise."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.report import NAMES
from svfl_models.experiments.figures import (
    ENCODER_COLOURS,
    MODEL_COLOURS,
    accuracy_label,
    best_known,
    legend,
    line,
    panels,
)
from svfl_models.experiments.page import MODELS, accuracy_words, heading, markdown, tests
from svfl_models.experiments.results import Cell, Results
from svfl_models.networks.inputs import ENCODERS
from svfl_models.training.figures import save  # fmt: skip

TITLE = "Block centering: ablations"
SVFL: dict[str, Any] = {"group": MODELS["svfl"]}
CNN: dict[str, Any] = {"group": MODELS["cnn"]}
VARIANTS = {
    "SVFL": (SVFL, ENCODERS),
    "SVFL, torque polar": (SVFL | {"torque": "polar"}, ("f", "vf")),
    "SVFL, view from above": (SVFL | {"view": "top"}, ("v", "vf")),
    "SVFL, crops only": (SVFL | {"augment": False}, ("v", "vf")),
    "CNN": (CNN, ENCODERS),
    "CNN, rotated and mirrored samples": (CNN | {"rotate": True}, ENCODERS),
    "CNN, view from above": (CNN | {"view": "top"}, ("v", "vf")),
    "CNN, crops only": (CNN | {"augment": False}, ("v", "vf")),
}
"""The variants by name: the settings in which each deviates, and the encoders for which the deviation has an effect."""
NOISES = (0.0, 1.0, 3.0, 10.0, 30.0)
"""Levels of the noise that is added to readings, in multiples of the sensor's own noise."""


def cells(base: TrainingConfig, train_samples: Sequence[int]) -> list[TrainingConfig]:
    """Return the configurations of the experiment, all with seed 0.

    The noise is varied for the largest training set only.

    Args:
        base: Recipe that the configurations deviate from.
        train_samples: Sizes of the training set.
    """
    variants = [
        replace(base, encoder=encoder, train_samples=count, **changes)
        for changes, encoders in VARIANTS.values()
        for encoder in encoders
        for count in train_samples
    ]
    noisy = [
        replace(base, encoder=encoder, train_samples=max(train_samples), noise=noise, **network)
        for encoder in ("f", "vf")
        for network in (SVFL, CNN)
        for noise in NOISES
    ]
    return list(dict.fromkeys([*variants, *noisy]))  # runs with noise 0 are variants, too


def usual(results: Results) -> dict[str, Any]:
    """Return the settings that a variant has unless it deviates in them, which are those of the first run."""
    return {name: getattr(results.runs[0].config, name) for name in ("torque", "view", "augment", "rotate")}


def variant(results: Results, name: str, encoder: str) -> list[Cell]:
    """Return the cells of a variant for one encoder, in the order of the numbers of training samples.

    Args:
        results: Runs of the experiment.
        name: Name of the variant, one of `VARIANTS`.
        encoder: Inputs of the network, one of `inputs.ENCODERS`.

    Returns:
        The cells; none if the variant's deviation has no effect for this encoder.
    """
    changes, encoders = VARIANTS[name]
    return results.find(encoder=encoder, **(usual(results) | {"noise": 0.0} | changes)) if encoder in encoders else []


def noise_cells(results: Results, encoder: str, network: dict[str, Any]) -> list[Cell]:
    """Return the cells of one encoder and network with the largest training set, in the order of the noise levels.

    Args:
        results: Runs of the experiment.
        encoder: Inputs of the network, one of `inputs.ENCODERS`.
        network: Settings of the network, `SVFL` or `CNN`.
    """
    most = max(results.values("train_samples"))
    return results.find(encoder=encoder, train_samples=most, **usual(results), **network)


def body(results: Results) -> str:
    """Return the page between title and recipe, in Markdown: the tables of the variants and of the noise."""
    counts = results.values("train_samples")
    rows = []
    for name in VARIANTS:
        label = name
        for test in tests(results):
            row = [label, test]
            for encoder in ENCODERS:
                words = [accuracy_words(cell, test) for cell in variant(results, name, encoder)]
                row += words or [""] * len(counts)
            rows.append(row)
            label = ""
    header = ["network", "test", *(f"{NAMES[encoder]}, {count}" for encoder in ENCODERS for count in counts)]
    return f"""\
Accuracy, %, by input and number of training samples; empty where a variant does not differ. For SVFL a torque is an
axial vector; polar is the paper's representation, which is correct for rotations and wrong for reflections. Rotated and
mirrored samples are transformed by random elements of D4, the usual alternative to a symmetric network. In the view
from above, rotating the image is rotating the scene; in an oblique view this holds only approximately. Crops only:
images are augmented as in the paper, without random colours and larger shifts.

{markdown(header, rows)}

![ablations](ablation.png)

## Noise of the sensor

White Gaussian noise added to every reading of training and test samples, in multiples of the wrist sensor's own
(docs/simulation.md, "white, standard deviation"), with {max(counts)} training samples:

{_noise_table(results)}

![noise](ablation_noise.png)
"""


def _noise_table(results: Results) -> str:
    rows = []
    for encoder in ("f", "vf"):
        for network in (SVFL, CNN):
            found = noise_cells(results, encoder, network)
            label = heading(found[0].config)
            for test in tests(results):
                rows.append([label, test, *(accuracy_words(cell, test) for cell in found)])
                label = ""
    return markdown(["network", "test", *(f"{noise:g} x" for noise in NOISES)], rows)


def draw(results: Results, folder: Path) -> list[Path]:
    """Write the figures of the variants, with a panel for every training set, and of the noise.

    Args:
        results: Runs of the experiment.
        folder: Folder to write to.

    Returns:
        The files of the figures.
    """
    counts = results.values("train_samples")
    figure, axes = panels(1, len(counts), 4.4)
    for panel, count in zip(axes, counts, strict=True):
        for place, name in enumerate(VARIANTS):
            for step, encoder in enumerate(ENCODERS):
                for cell in variant(results, name, encoder):
                    mean = best_known(cell, results)
                    if cell.config.train_samples == count and mean:
                        label = NAMES[encoder] if place == 0 else None
                        panel.errorbar(
                            mean.mean, place + 0.25 * (step - 1), xerr=mean.error or 0, fmt="o", capsize=3,
                            markersize=6, color=ENCODER_COLOURS[encoder], label=label,
                        )  # fmt: skip
        panel.set(title=f"{count} training samples", xlabel=accuracy_label(results), ylim=(len(VARIANTS) - 0.5, -0.5))
        panel.set_yticks(range(len(VARIANTS)), list(VARIANTS))
        panel.grid(alpha=0.3)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(ENCODERS))
    return [save(figure, folder / "ablation.png"), _draw_noise(results, folder / "ablation_noise.png")]


def _draw_noise(results: Results, path: Path) -> Path:
    figure, axes = panels(1, 2, 3.4)
    for panel, encoder in zip(axes, ("f", "vf"), strict=True):
        for network in (SVFL, CNN):
            found = noise_cells(results, encoder, network)
            model = found[0].config.model
            means = [best_known(cell, results) for cell in found]
            line(panel, range(len(NOISES)), means, fmt="o-", color=MODEL_COLOURS[model], label=NAMES[model])
        panel.set(title=NAMES[encoder], xlabel="added noise, times the sensor's own")
        panel.set_xticks(range(len(NOISES)), [f"{noise:g}" for noise in NOISES])
        panel.grid(alpha=0.3)
    axes[0].set_ylabel(accuracy_label(results))
    legend(axes[0], "lower left")
    return save(figure, path)
