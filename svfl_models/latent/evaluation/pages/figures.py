"""Figures of an evaluation."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from svfl_models.latent.evaluation.alignment import Alignment
from svfl_models.latent.evaluation.attention import Attention
from svfl_models.latent.evaluation.experts import Experts, Share
from svfl_models.latent.evaluation.missing import Remaining
from svfl_models.latent.evaluation.pages.sample_figures import reconstructions, where_contact_looks
from svfl_models.latent.evaluation.results import Evaluation, SampleFigures
from svfl_models.training.figures import WIDTH_IN, save

# Okabe and Ito's palette, as in the figures of experiments.
COLOURS = {"image": "#0072b2", "wrench": "#e69f00", "proprio": "#009e73", "prior": "#999999", "asked": "#999999"}
FEATURE, RAW, ONE, OTHER, PLAIN = "#0072b2", "#999999", "#d55e00", "#56b4e9", "#555555"
LETTERS = {"image": "I", "wrench": "W", "proprio": "P"}


def draw(out: Path, found: Evaluation, samples: SampleFigures) -> list[Path]:
    """Draw all figures that exist for the model.

    Args:
        out: Folder to write the figures into.
        found: Numbers of the evaluation.
        samples: Samples of one episode.

    Returns:
        The files that were written.
    """
    files = [reconstructions(samples, out / "reconstructions.png")]
    if samples.looked is not None:
        files.append(where_contact_looks(samples, out / "attention_over_image.png"))
    files += [curves(found, out / "curves.png"), probes(found, out / "probes.png")]
    files.append(missing(found.missing, out / "missing_modalities.png"))
    if found.attention is not None:
        files.append(attention(found.attention, out / "attention_mass.png"))
    if found.experts is not None:
        files.append(experts(found.experts, out / "experts.png"))
    return files


def curves(found: Evaluation, path: Path) -> Path:
    """Draw the fidelity of imagined images by steps ahead, and the alignment by time gap; return the file."""
    near = found.reconstruction
    figure = Figure(figsize=(WIDTH_IN, 3.4), layout="constrained")
    axes = figure.subplots(1, 3 if found.alignment else 2)
    steps = np.arange(1, len(near.imagined) + 1)
    for one, name, label in (
        (axes[0], "psnr_db", "PSNR of colour, dB"), (axes[1], "depth_mae_mm", "depth error, mm")
    ):  # fmt: skip
        values = [[getattr(item, name) for item in kind] for kind in (near.imagined, near.unmoved)]
        if None in values[0]:
            one.set_visible(False)
            continue
        one.plot(steps, values[0], "o-", color=FEATURE, label="imagined")
        one.plot(steps, values[1], "s-", color=ONE, label="last look, unmoved")
        one.axhline(getattr(near.seen, name), color=FEATURE, linestyle=":", label="seen")
        one.axhline(getattr(near.mean_image, name), color=PLAIN, linestyle="--", label="mean training image")
        one.set(xlabel="steps after the last look", ylabel=label, xticks=steps)
        one.grid(alpha=0.3)
    axes[0].legend(fontsize=8)
    if found.alignment:
        _alignment(axes[2], found.alignment)
    return save(figure, path)


def _alignment(axes: Axes, found: Alignment) -> None:
    kinds = [(str(gap), told) for gap, told in found.by_gap.items()]
    if found.other_episodes is not None:
        kinds.append(("other\nepisode", found.other_episodes))
    places = np.arange(len(kinds))
    axes.bar(places, [100 * told.rejected for _, told in kinds], color=OTHER, label="foreign wrench rejected")
    axes.axhline(100 * found.accepted, color=PLAIN, linestyle="--", label="own wrench accepted")
    axes.set_xticks(places, [name for name, _ in kinds])
    axes.set(
        xlabel="wrench from so many steps away", ylabel="share of pairs, %", ylim=(0, 125), yticks=range(0, 101, 25)
    )
    axes.legend(fontsize=8, loc="upper left")


def probes(found: Evaluation, path: Path) -> Path:
    """Draw R^2 of the probes of features beside those of raw inputs, with negative values as 0; return the file."""
    figure = Figure(figsize=(WIDTH_IN, 3.2), layout="constrained")
    axes = figure.subplots()
    places = np.arange(len(found.probes))
    for shift, name, label, colour in ((-0.2, "r2", f"feature of {found.model}", FEATURE), (0.2, "raw_r2", "raw", RAW)):
        axes.bar(places + shift, [_r2(getattr(one, name)) for one in found.probes], 0.38, label=label, color=colour)
    axes.set_xticks(places, [one.name.replace(" ", "\n", 1) for one in found.probes])
    axes.set(ylabel="R^2 (no bar: below 0)", ylim=(0, 1.02))
    axes.legend(fontsize=8, loc="upper center", bbox_to_anchor=(0.5, 1.15), ncols=2)
    axes.grid(alpha=0.3, axis="y")
    return save(figure, path)


def missing(found: list[Remaining], path: Path) -> Path:
    """Draw bars of the scores for every subset of the modalities; return the file."""
    names = ["".join(LETTERS[name] for name in one.modalities) for one in found]
    targets = [name for name in ("force", "gripper x, y", "object x, y") if name in found[0].probe_r2]
    kinds: dict[str, list[float | None]] = {
        "PSNR of colour, dB": [one.psnr_db for one in found],
        "depth error, mm": [one.depth_mae_mm for one in found],
        "contact AUROC": [one.contact_auroc for one in found],
    }
    kinds |= {f"probe of {name}, R^2": [_r2(one.probe_r2[name]) for one in found] for name in targets}
    figure = Figure(figsize=(WIDTH_IN, 4.8), layout="constrained")
    axes = figure.subplots(2, 3)
    for one in axes.flat[len(kinds) :]:
        one.set_visible(False)
    for one, (label, values) in zip(axes.flat, kinds.items(), strict=False):
        heights = [np.nan if value is None else value for value in values]
        one.bar(names, heights, color=[FEATURE, *[OTHER] * 3, *[RAW] * 3])
        one.set_title(label, fontsize=10)
        if not label.endswith(("dB", "mm")):
            one.set_ylim(0, 1.02)
        if label.endswith("AUROC"):
            one.axhline(0.5, color=PLAIN, linestyle="--", linewidth=1)  # random guesses
    figure.supxlabel("modalities that are there: I image, W wrench, P proprioception", fontsize=10)
    return save(figure, path)


def attention(found: Attention, path: Path) -> Path:
    """Draw the share of attention on each modality by layer, one panel per attending token; return the file."""
    figure = Figure(figsize=(WIDTH_IN, 3.4), layout="constrained")
    axes = figure.subplots(1, len(found.mass), sharey=True)
    for one, (looker, mass) in zip(axes, found.mass.items(), strict=True):
        columns = {"tokens": {group: share for group, share in found.tokens.items()}}
        columns |= {
            str(layer + 1): {group: values[layer] for group, values in mass.items()}
            for layer in range(len(mass["image"]))
        }
        for name, part in (("in\ncontact", found.mass_contact), ("free", found.mass_free)):
            if part is not None:
                columns[name] = {group: values[-1] for group, values in part[looker].items()}
        _stacked(one, columns)
        one.set_title(f"token: {looker}" if looker != "all" else "all tokens, mean", fontsize=10)
        one.set_xlabel("layer; last layer by contact", fontsize=9)
        one.tick_params(axis="x", labelsize=8)
    axes[0].set_ylabel("share of the attention, %")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9)
    return save(figure, path)


def experts(found: Experts, path: Path) -> Path:
    """Draw each expert's share of the precision; return the file."""
    columns = {"all frames": found.every, "in contact": found.contact, "free": found.free}
    figure = Figure(figsize=(WIDTH_IN / 2, 3.2), layout="constrained")
    axes = figure.subplots()
    _stacked(axes, {name: share for name, share in columns.items() if share is not None})
    axes.set_ylabel("share of the precision, %")
    figure.legend(loc="outside right center", fontsize=9)
    return save(figure, path)


def _stacked(axes: Axes, columns: dict[str, Share]) -> None:
    bottom = np.zeros(len(columns))
    for group in next(iter(columns.values())):
        height = np.array([100 * share[group] for share in columns.values()])
        axes.bar(list(columns), height, bottom=bottom, color=COLOURS[group], label=group)
        bottom += height
    axes.set_ylim(0, 100)


def _r2(value: float | None) -> float:
    return np.nan if value is None else max(0.0, value)
