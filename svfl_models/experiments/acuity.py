"""Visual acuity experiment, which measures how much force helps where the image is coarse."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from svfl_models.centering.config import TrainingConfig
from svfl_models.centering.report import NAMES
from svfl_models.experiments.figures import ENCODER_COLOURS, accuracy_label, best_known, few_ticks, legend, line, panels
from svfl_models.experiments.page import MODELS, accuracy_words, markdown, tests
from svfl_models.experiments.results import Results
from svfl_models.training.figures import save

TITLE = "Block centering: visual acuity"
SIZES = (64, 32, 16, 8)


def cells(base: TrainingConfig, train_samples: Sequence[int]) -> list[TrainingConfig]:
    """Return the configurations of the experiment, all with seed 0.

    The networks that take force alone, and so no image, are for comparison.

    Args:
        base: Recipe that the configurations deviate from.
        train_samples: Sizes of the training set.
    """
    found = []
    for count in train_samples:
        for group in MODELS.values():
            one = replace(base, group=group, train_samples=count)
            found += [replace(one, encoder=encoder, image_size=size) for encoder in ("v", "vf") for size in SIZES]
            found.append(replace(one, encoder="f"))
    return found


def body(results: Results) -> str:
    """Return the page between title and recipe, in Markdown: the table of accuracy by image size."""
    rows = []
    for count in results.values("train_samples"):
        for encoder in ("v", "vf", "f"):
            for model, group in MODELS.items():
                found = results.find(encoder=encoder, group=group, train_samples=count)
                name = [NAMES[encoder], NAMES[model], count]
                for test in tests(results):
                    words = [accuracy_words(cell, test) for cell in found]
                    rows.append([*name, test, *(words * len(SIZES) if encoder == "f" else words)])
                    name = ["", "", ""]
    return f"""\
The crop of the camera's image is rescaled bilinearly, with the pixels in between averaged, to a square of 64, 32, 16 or
8 pixels, as in the paper (Kohler et al., CoRL 2023, "Role of Force Feedback When Visual Acuity is Degraded"). The
paper varies acuity for its policies only, and in a figure without numbers, so there are no figures to compare.
F does not use the image: its accuracy is the same in all columns.

{markdown(["input", "network", "training samples", "test", *(f"{size} px" for size in SIZES)], rows)}

![accuracy against image size](acuity.png)
"""


def draw(results: Results, folder: Path) -> list[Path]:
    """Write the figure of accuracy against image size, for the largest training set.

    Args:
        results: Runs of the experiment.
        folder: Folder to write to.

    Returns:
        The file of the figure, in a list.
    """
    count = max(results.values("train_samples"))
    figure, axes = panels(1, 2, 4.0)
    for panel, (model, group) in zip(axes, MODELS.items(), strict=True):
        for encoder in ("vf", "v", "f"):
            found = results.find(encoder=encoder, group=group, train_samples=count)
            means = [best_known(cell, results) for cell in found] * (len(SIZES) if encoder == "f" else 1)
            style = {"color": ENCODER_COLOURS[encoder], "label": NAMES[encoder], "markersize": 5}
            line(panel, SIZES, means, fmt="--" if encoder == "f" else "o-", **style)
        panel.set(title=f"{NAMES[model]}, {count} training samples", xlabel="image size, pixels")
        panel.set_xscale("log", base=2)
        few_ticks(panel, SIZES)
    axes[0].set_ylabel(accuracy_label(results))
    legend(axes[0], "lower right")
    return [save(figure, folder / "acuity.png")]
