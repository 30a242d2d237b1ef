"""The text that the viewer shows beside an episode."""

import numpy as np

from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.clocks import mean_hz
from svfl_data.schema.field_words import assumed_words, camera_pose, own, title
from svfl_data.schema.rates import declared_hz
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.printable import markdown, printable
from svfl_data.viewer.entities.episode_source import ACTION, PROPRIO, TARE, TIMES, WRENCH, WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.entities.fields import left_out
from svfl_data.viewer.entities.scene import METRES_PER_NEWTON, METRES_PER_NEWTON_METRE
from svfl_data.viewer.predictions import Prediction, true_direction

SAID = ("instruction", "robot", "operator")
MOST_NUMBERS, MOST_LINES = 16, 30
"""Largest number of numbers of one array, and of lines of one kind, that the text gives."""


def summary_text(shown: EpisodeSource, peak: float, prediction: Prediction | None = None) -> str:
    """Return the text that the viewer shows beside an episode, in Markdown.

    Args:
        shown: Episode that is shown.
        peak: Largest norm of the filtered force, [N], which has the brightest colour of the TCP's path.
        prediction: Prediction of a network on the episode. None if no network is shown.
    """
    meta, t_ns = shown.meta, shown[TIMES]
    seconds = (t_ns[-1] - t_ns[0]) / 1e9
    lines = [f"{len(shown)} steps, {seconds:.2f} s; source {markdown(meta.source)}, seed {meta.seed}."]
    said = [f"**{name.capitalize()}:** {markdown(text)}" for name in SAID if (text := getattr(meta, name))]
    if said:
        lines.append("; ".join(said) + ".")
    if "labels/offset" in shown and "labels/direction" in shown:
        dx, dy = shown["labels/offset"] * 1e3
        direction = DIRECTIONS[int(shown["labels/direction"])]
        lines.append(
            f"**Label** (yellow): the gripper must move **{direction}** as the image shows it; exactly "
            f"({dx:+.1f}, {dy:+.1f}) mm along base x, y."
        )
    if prediction:
        lines.append(f"**Network** (orange on the picture): {_prediction_words(shown, prediction)}")
    lines += _wrench_lines(shown, peak)
    if "streams/object/pose" in shown and "streams/object/half_extents" not in shown:
        lines.append("**Object** (blue): size not recorded, drawn as a 5 cm cube.")
    lines += [*_camera_lines(shown), *_constants(shown), *_assumed(shown)]
    if number := left_out(shown):
        lines.append(f"{number} further field{'s are' if number > 1 else ' is'} not drawn.")
    versions = ", ".join(markdown(f"{name} {version}") for name, version in meta.software.items())
    lines.append(f"**Recorded with** {versions or 'unknown software'}.")
    head = f"**{markdown(meta.task)}, episode {meta.index}: {'success' if meta.success else 'no success'}**; "
    return head + lines.pop(0) + "\n\n" + "\n".join(f"- {line}" for line in lines)


def _prediction_words(shown: EpisodeSource, prediction: Prediction) -> str:
    if prediction.probabilities is None:
        outlined = "; outlined: the part of the picture that it sees" if prediction.crop is not None else ""
        how = "pale" if shown.planar and prediction.action == ACTION else "thin"
        return f"{markdown(prediction.name)}; its actions ({how}) are beside the commanded ones{outlined}."
    last = prediction.probabilities[-1]
    words = f"{markdown(prediction.name)}; at the last step **{DIRECTIONS[int(last.argmax())]}** with {last.max():.1%}."
    if (true := true_direction(shown, prediction)) is not None:
        words += f" The true direction has {last[true]:.1%}."
    return words


def _wrench_lines(shown: EpisodeSource, peak: float) -> list[str]:
    """Return what the arrows, the curves of the wrench and its tare mean; nothing if there is no wrench."""
    if WRENCH not in shown:
        return []
    where = "wrist" if PROPRIO in shown else "TCP"
    lines = [
        f"**Arrows at the {where}:** force orange, {METRES_PER_NEWTON * 1e3:.0f} mm per N; torque pink, "
        f"{METRES_PER_NEWTON_METRE * 1e3:.0f} mm per N m. Path of the TCP: dark without force, bright at {peak:.1f} N."
    ]
    lines = lines if shown.positions() else []
    lines.append(
        f"**Wrench:** load of the environment on the gripper, base axes, torque about the sensor origin; "
        f"{_rate(shown)} "
        f"Thick: the last {WINDOW} before the cursor, what a network gets when it is at an observation."
    )
    tare = shown.get(TARE)
    words = "not recorded, so the readings are shown as they are"
    lines.append(f"**Tare:** {words if tare is None else f'{_vector(tare[:3])} N, {_vector(tare[3:])} N m'}.")
    return lines


def _camera_lines(shown: EpisodeSource) -> list[str]:
    """Return a line for each camera without a fixed known pose."""
    lines = []
    for camera in shown.cameras:
        pose = camera_pose(camera, shown.arrays)
        if not shown.placed(camera):
            lacks = "its pose" if pose == "no pose" else "the pose of the TCP" if pose else "its intrinsics"
            if f"cameras/{camera}/intrinsics" not in shown and pose != "no pose":
                lacks = "its intrinsics"
            lines.append(f"**Camera {markdown(camera)}** is shown as a picture only: {lacks} was not recorded.")
        elif pose:
            lines.append(f"**Camera {markdown(camera)}** {'moves' if pose == 'moves' else 'is on the gripper'}.")
    return [line.replace("intrinsics was", "intrinsics were") for line in lines]


def _constants(shown: EpisodeSource) -> list[str]:
    """Return a line for each field of the user's own that the episode has once, such as a label."""
    lines = []
    for field in own(shown.arrays, shown.declarations):
        if field.grows or field.image:
            continue
        values = np.asarray(shown[field.path]).reshape(-1)
        if values.dtype.kind == "S":
            words = ", ".join(markdown(printable(one.decode(errors="replace"), 200)) for one in values[:MOST_NUMBERS])
        else:
            words = ", ".join(f"{value:.6g}" for value in values[:MOST_NUMBERS].tolist())
        more = f" and {len(values) - MOST_NUMBERS} more" if len(values) > MOST_NUMBERS else ""
        lines.append(f"**{markdown(title(field))}:** {words}{more}")
    return lines[:MOST_LINES]


def _assumed(shown: EpisodeSource) -> list[str]:
    """Return a line for each array of which something is assumed, such as ``wrench: axes are assumed``."""
    fields = [field for path in shown.arrays if (field := shown.declarations.at(path)) and field.assumed]
    lines = [f"{markdown(field.path)}: {markdown(', '.join(assumed_words(field)))}." for field in fields]
    more = [f"{len(lines) - MOST_LINES} more arrays of which something is assumed."] if len(lines) > MOST_LINES else []
    return [*lines[:MOST_LINES], *more]


def _rate(shown: EpisodeSource) -> str:
    t_ns = shown[WRENCH_TIMES]
    if len(t_ns) < 2:
        return f"{len(t_ns)} readings."
    declared = declared_hz(shown.meta.config, "streams/wrench")
    return f"{len(t_ns)} readings at {declared or mean_hz(t_ns):.0f} Hz{' as declared' if declared else ' on average'}."


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:z.2f}" for value in values) + ")"
