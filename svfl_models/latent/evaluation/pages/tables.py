"""Tables of the numbers of an evaluation, for the page and the terminal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from svfl_models.latent.evaluation.contact import Detection
from svfl_models.latent.evaluation.following import NextHand
from svfl_models.latent.evaluation.results import Evaluation

NONE = "-"


@dataclass(frozen=True)
class Table:
    """Table with a heading.

    Attributes:
        title: Heading of the table.
        columns: Names of the columns.
        rows: Rows of the table, with one text per column.
        note: Explanation below the table; empty for none.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    note: str = ""

    def markdown(self) -> str:
        """Return the table in Markdown, with its heading and note."""
        lines = [self.columns, ("---",) * len(self.columns), *self.rows]
        body = "\n".join(f"| {' | '.join(row)} |" for row in lines)
        return f"## {self.title}\n\n{body}\n" + (f"\n{self.note}\n" if self.note else "")


def number(value: float | None, digits: int = 2) -> str:
    """Return a number with `digits` decimal places, or `NONE` for None and NaN."""
    return NONE if value is None or math.isnan(value) else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """Return a share as a percentage, or `NONE` for None and NaN."""
    return NONE if value is None or math.isnan(value) else f"{value:.1%}"


def tables(found: Evaluation) -> list[Table]:
    """Return the tables of everything that was evaluated."""
    made = [
        _reconstruction(found),
        _contact(found),
        _alignment(found),
        _next_gripper(found.next_gripper),
        _probes(found),
    ]
    made += [_missing(found), _attention(found), _experts(found), _symmetry(found)]
    return [one for one in made if one is not None]


def _reconstruction(found: Evaluation) -> Table:
    one = found.reconstruction
    named = [("seen: posterior state", one.seen), ("mean training image", one.mean_image)]
    named += [(f"imagined, step {step}", near) for step, near in enumerate(one.imagined, 1)]
    named += [(f"last look, unmoved, step {step}", near) for step, near in enumerate(one.unmoved, 1)]
    rows = [(name, number(near.psnr_db, 1), number(near.depth_mae_mm, 1)) for name, near in named]
    note = "Mean over frames; depth where there is a measurement. Steps count from the last look, actions given."
    return Table("Reconstruction", ("picture", "PSNR of colour, dB", "depth error, mm"), rows, note)


def _contact(found: Evaluation) -> Table | None:
    named: list[tuple[str, Detection | None]] = [
        ("this frame, from the encoder", found.contact), ("the next frame, from state and action", found.next_contact),
    ]  # fmt: skip
    rows = [
        (name, number(one.auroc, 3), number(one.f1, 3), number(one.always_f1, 3), percent(one.base_rate))
        for name, one in named
        if one is not None
    ]
    columns = ("contact of", "AUROC", "F1", "F1 of always yes", "base rate")
    return Table("Contact", columns, rows) if rows else None


def _alignment(found: Evaluation) -> Table | None:
    one = found.alignment
    if one is None:
        return None
    kinds = [(f"{gap} step{'s' * (gap > 1)} away", told) for gap, told in one.by_gap.items()]
    if one.other_episodes is not None:
        kinds.append(("another episode", one.other_episodes))
    rows = [(name, percent(told.rejected), number(told.auroc, 3), str(told.pairs)) for name, told in kinds]
    note = f"Own pairs accepted: {percent(one.accepted)} of all frames"
    note += "." if one.accepted_touching is None else f", {percent(one.accepted_touching)} of those in contact."
    if kinds:
        note += " Of a foreign pair at least one frame is in contact: two frames free of contact feel the same."
    return Table("Alignment", ("wrench from", "rejected", "AUROC against own", "pairs"), rows, note)


def _next_gripper(found: NextHand | None) -> Table | None:
    if found is None:
        return None
    named = (("predicted", found.predicted), ("unchanged", found.unchanged), ("as commanded", found.commanded))
    rows = [
        (name, number(one.opening, 3), number(one.xy_mm), number(one.z_mm), number(one.yaw_deg)) for name, one in named
    ]
    return Table("Next gripper, mean absolute error", ("guess", "opening", "x, y, mm", "z, mm", "yaw, deg"), rows)


def _probes(found: Evaluation) -> Table:
    rows = [
        (
            one.name,
            number(one.r2, 3),
            number(one.raw_r2, 3),
            *_errors(one.error, one.raw_error, one.mean_error),
            one.unit,
        )
        for one in found.probes
    ]
    note = (
        f"Ridge regression on {found.learned_frames} training frames, evaluated on held-out episodes. Raw: the same "
        "from 4 x 16 x 16 pixels, 9 wrenches and the gripper, so that what is an input itself is read off at once."
    )
    columns = ("linear probe", "R^2", "R^2, raw", "error", "error, raw", "error of the mean", "unit")
    return Table("Probes", columns, rows, note)


def _errors(*errors: float) -> tuple[str, ...]:
    return tuple(f"{error:.3g}" for error in errors)


def _missing(found: Evaluation) -> Table:
    shown = [
        name for name in ("force", "gripper x, y", "object x, y", "object yaw") if name in found.missing[0].probe_r2
    ]
    columns = (
        "modalities",
        "PSNR, dB",
        "depth error, mm",
        "contact AUROC",
        "contact F1",
        *(f"{name}, R^2" for name in shown),
    )
    rows = [
        (" + ".join(one.modalities), number(one.psnr_db, 1), number(one.depth_mae_mm, 1), number(one.contact_auroc, 3),
         number(one.contact_f1, 3), *(number(one.probe_r2[name]) for name in shown))
        for one in found.missing
    ]  # fmt: skip
    way = "PoE leaves the others out" if found.model == "poe" else "the mean training input stands for the others"
    note = f"In {found.missing_episodes} episodes; {way}. Probes are fitted on each subset's own features."
    return Table("Missing modalities", columns, rows, note)


def _attention(found: Evaluation) -> Table | None:
    one = found.attention
    if one is None:
        return None
    rows: list[tuple[str, ...]] = [("share of the tokens", "", *map(percent, one.tokens.values()))]
    frames = (("all", one.mass), ("in contact", one.mass_contact), ("free", one.mass_free))
    for name, mass in frames:
        for looker, groups in (mass or {}).items():
            layers = len(next(iter(groups.values())))
            picked = range(layers) if name == "all" else [layers - 1]
            rows += [
                (f"{looker}, layer {layer + 1}", name, *(percent(values[layer]) for values in groups.values()))
                for layer in picked
            ]
    note = "Mean over heads; `asked` are the tokens of contact and alignment."
    if one.mass_contact or one.mass_free:
        note += " By contact: the last layer alone."
    return Table("Attention mass", ("token that looks", "frames", *one.tokens), rows, note)


def _experts(found: Evaluation) -> Table | None:
    one = found.experts
    if one is None:
        return None
    named = [("all", one.every), ("in contact", one.contact), ("free", one.free)]
    rows = [(name, *map(percent, share.values())) for name, share in named if share is not None]
    note = "Mean over the feature's components: how much each expert's mean weighs in the product's."
    return Table("Share of the precision", ("frames", *one.every), rows, note)


def _symmetry(found: Evaluation) -> Table:
    named = [
        *found.symmetry.elements.items(),
        *((f"mean of {name}", one) for name, one in found.symmetry.groups.items()),
    ]
    rows = [
        (name, number(one.not_linear, 3), number(one.change), number(one.contact, 3), number(one.alignment, 3))
        for name, one in named
    ]
    columns = ("world", "1 - R^2", "change of the feature", "change of contact", "change of alignment")
    note = (
        "1 - R^2 of the best linear map from features to features of the transformed world: 0 if the transformation "
        "acts linearly. Changes: of the feature in units of the distance of two frames at random, of the probabilities "
        "absolute; contact and alignment should not change."
    )
    return Table("Symmetry", columns, rows, note)


def compact(found: Evaluation) -> Sequence[tuple[str, str]]:
    """Return the most important numbers for a terminal, as pairs of name and text."""
    near, r2 = found.reconstruction, {one.name: one for one in found.probes}
    last = near.imagined[-1]
    rows = [
        ("reconstruction", f"{near.seen.psnr_db:.1f} dB, depth {number(near.seen.depth_mae_mm, 1)} mm"),
        ("  mean image", f"{near.mean_image.psnr_db:.1f} dB, depth {number(near.mean_image.depth_mae_mm, 1)} mm"),
        (f"  imagined {len(near.imagined)} steps", f"{last.psnr_db:.1f} dB, depth {number(last.depth_mae_mm, 1)} mm"),
    ]
    for name, one in (("contact", found.contact), ("next contact", found.next_contact)):
        if one is not None:
            words = f"AUROC {number(one.auroc, 3)}, F1 {number(one.f1, 3)} (always yes {number(one.always_f1, 3)})"
            rows.append((name, words))
    if found.alignment is not None and (told := found.alignment.other_episodes) is not None:
        words = f"own accepted {percent(found.alignment.accepted)}, other episodes' rejected {percent(told.rejected)}"
        rows.append(("alignment", words))
    if found.next_gripper is not None:
        gripper, still = found.next_gripper.predicted, found.next_gripper.unchanged
        rows.append(("next gripper", f"x, y {gripper.xy_mm:.1f} mm off (unchanged {still.xy_mm:.1f} mm)"))
    rows += [(f"probe: {name}", f"R^2 {number(one.r2)}, {one.error:.3g} {one.unit} off") for name, one in r2.items()]
    if found.experts is not None:
        shares = ", ".join(f"{name} {percent(share)}" for name, share in found.experts.every.items())
        rows.append(("precision", shares))
    if found.attention is not None:
        mass = found.attention.mass["contact"]
        shares = ", ".join(f"{name} {percent(values[-1])}" for name, values in mass.items())
        rows.append(("contact looks at", shares))
    group = found.symmetry.groups["D4"]
    rows.append(("symmetry, D4", f"1 - R^2 {number(group.not_linear)}, contact changes by {group.contact:.3f}"))
    return rows
