"""Figures of the samples of one episode."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from svfl_models.latent.evaluation.results import SampleFigures
from svfl_models.training.figures import DPI
from svfl_models.training.writing import write_figure


def reconstructions(samples: SampleFigures, path: Path) -> Path:
    """Draw original colour and depth images above the model's reconstructions of them; return the file."""
    original, picture = samples.original.numpy(), samples.picture.numpy()
    measured = original[:, 3][original[:, 3] > 0]
    low, high = (measured.min(), measured.max()) if measured.size else (0.0, 1.0)
    rows = (("colour", original), ("reconstructed", picture), ("depth", original), ("reconstructed", picture))
    count = len(samples.step)
    figure = Figure(figsize=(1.45 * count + 1.3, 6.4), layout="constrained")
    axes = figure.subplots(4, count, squeeze=False)
    for number, (label, images) in enumerate(rows):
        for column, one in enumerate(axes[number]):
            _bare(one)
            if number < 2:
                one.imshow(images[column, :3].clip(0, 1).transpose(1, 2, 0))
            else:
                depth = np.where(images[column, 3] > 0, images[column, 3], np.nan)  # white: no measurement
                shown = one.imshow(depth, vmin=low, vmax=high, cmap="viridis")
        axes[number, 0].set_ylabel(label)
    for column, one in enumerate(axes[0]):
        one.set_title(_title(samples, column), fontsize=9)
    figure.colorbar(shown, ax=axes[2:], label="depth, m", shrink=0.8)
    figure.suptitle(f"Episode {samples.episode}: originals, and what the posterior states make of them", fontsize=11)
    write_figure(figure, path, DPI)
    return path


def where_contact_looks(samples: SampleFigures, path: Path) -> Path:
    """Draw the attention of the contact token in the last layer over the images; return the file."""
    assert samples.looked is not None
    looked = 100 * samples.looked.numpy()
    count, size = len(samples.step), samples.original.shape[-1]
    figure = Figure(figsize=(1.45 * count + 1.3, 3.5), layout="constrained")
    axes = figure.subplots(2, count, squeeze=False)
    for column in range(count):
        above, below = axes[:, column]
        picture = samples.original[column, :3].numpy().transpose(1, 2, 0)
        for one in (above, below):
            _bare(one)
        above.imshow(picture)
        below.imshow(picture.mean(axis=2), cmap="gray", extent=(0, size, size, 0))
        shown = below.imshow(
            looked[column], vmin=0, vmax=looked.max(), cmap="inferno", alpha=0.6, extent=(0, size, size, 0)
        )
        total = looked[column].sum()
        below.set_xlabel(f"image {total:.0f} %", fontsize=9)
        above.set_title(_title(samples, column), fontsize=9)
    figure.colorbar(shown, ax=axes[:, -1], label="share of attention, %", shrink=0.9)
    figure.suptitle(
        f"Episode {samples.episode}: where the contact token looks, last layer, mean over heads", fontsize=11
    )
    write_figure(figure, path, DPI)
    return path


def _title(samples: SampleFigures, column: int) -> str:
    return f"step {int(samples.step[column])}" + (", contact" if samples.contact[column] else "")


def _bare(axes: Axes) -> None:
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
