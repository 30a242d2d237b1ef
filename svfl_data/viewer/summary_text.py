"""The text that the viewer shows beside an episode."""

import numpy as np

from svfl_data.sampling.windows import WINDOW
from svfl_data.schema.clocks import mean_hz
from svfl_data.schema.rates import declared_hz
from svfl_data.symmetry import DIRECTIONS
from svfl_data.system.printable import markdown
from svfl_data.viewer.episode_source import TARE, TIMES, WRENCH_TIMES, EpisodeSource
from svfl_data.viewer.predictions import Prediction
from svfl_data.viewer.scene import METRES_PER_NEWTON, METRES_PER_NEWTON_METRE


def summary_text(shown: EpisodeSource, peak: float, prediction: Prediction | None = None) -> str:
    """Return the text that the viewer shows beside an episode, in Markdown.

    Args:
        shown: Episode that is shown.
        peak: Largest norm of the filtered force, [N], which has the brightest colour of the TCP's path.
        prediction: Prediction of a network on the episode. None if no network is shown.
    """
    meta, t_ns, tare = shown.meta, shown[TIMES], shown[TARE]
    seconds = (t_ns[-1] - t_ns[0]) / 1e9
    versions = ", ".join(markdown(f"{name} {version}") for name, version in meta.software.items())
    lines = [f"{len(shown)} steps, {seconds:.2f} s; source {markdown(meta.source)}, seed {meta.seed}."]
    if "labels/offset" in shown and "labels/direction" in shown:
        dx, dy = shown["labels/offset"] * 1e3
        direction = DIRECTIONS[int(shown["labels/direction"])]
        lines.append(
            f"**Label** (yellow): the gripper must move **{direction}** as the image shows it; exactly "
            f"({dx:+.1f}, {dy:+.1f}) mm along base x, y."
        )
    if prediction:
        lines.append(f"**Network** (orange on the picture): {_prediction_words(shown, prediction)}")
    lines += [
        f"**Arrows at the wrist:** force orange, {METRES_PER_NEWTON * 1e3:.0f} mm per N; torque pink, "
        f"{METRES_PER_NEWTON_METRE * 1e3:.0f} mm per N m. Path of the TCP: dark without force, bright at {peak:.1f} N.",
        f"**Wrench:** load of the environment on the gripper, base axes, torque about the sensor origin; "
        f"{_rate(shown)} "
        f"Thick: the last {WINDOW} before the cursor, what a network gets when it is at an observation.",
        f"**Tare:** {_vector(tare[:3])} N, {_vector(tare[3:])} N m. "
        f"**Recorded with** {versions or 'unknown software'}.",
    ]
    if "streams/object/pose" in shown and "streams/object/half_extents" not in shown:
        lines.append("**Object** (blue): size not recorded, drawn as a 5 cm cube.")
    title = f"**{markdown(meta.task)}, episode {meta.index}: {'success' if meta.success else 'no success'}**; "
    return title + lines.pop(0) + "\n\n" + "\n".join(f"- {line}" for line in lines)


def _prediction_words(shown: EpisodeSource, prediction: Prediction) -> str:
    if prediction.probabilities is None:
        outlined = "; outlined: the part of the picture that it sees" if prediction.crop is not None else ""
        return f"{markdown(prediction.name)}; its actions (pale) are beside the commanded ones{outlined}."
    last = prediction.probabilities[-1]
    words = f"{markdown(prediction.name)}; at the last step **{DIRECTIONS[int(last.argmax())]}** with {last.max():.1%}."
    if "labels/direction" in shown:
        words += f" The true direction has {last[int(shown['labels/direction'])]:.1%}."
    return words


def _rate(shown: EpisodeSource) -> str:
    t_ns = shown[WRENCH_TIMES]
    if len(t_ns) < 2:
        return f"{len(t_ns)} readings."
    declared = declared_hz(shown.meta.config, "streams/wrench")
    return f"{len(t_ns)} readings at {declared or mean_hz(t_ns):.0f} Hz{' as declared' if declared else ' on average'}."


def _vector(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:z.2f}" for value in values) + ")"
