"""Records a video of a policy, and logs an evaluation to the experiment trackers of the training."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from svfl_data.errors import TrainingError
from svfl_data.system.atomic_io import write_atomically
from svfl_models.cloning.checkpoint import load_policy
from svfl_models.cloning.evaluate import Evaluation, Trial, environment_of
from svfl_models.training import run_folder
from svfl_models.training.checkpoint_io import read
from svfl_models.training.trackers.trackers import opened

FRAME_MS = 50
"""Duration of a frame, one step of the policy at 20 Hz, [ms]."""
SIDE = 228
"""Largest side of a film to which small camera images are enlarged by a whole number, [px]."""


def film(checkpoint: Path, file: Path, seed: int = 0, index: int = 0, robot: str | None = None) -> Path:
    """Run one episode of an evaluation and write its camera images as an animated GIF; return the file.

    Args:
        checkpoint: Checkpoint file of the policy.
        file: GIF file to write; an existing one is replaced.
        seed: Seed of the scenes, as in `evaluate`.
        index: Number of the episode.
        robot: Name of the simulated robot that acts. By default the one of the demonstrations.

    Raises:
        TrainingError: If the policy cannot be run, or its environment has no images.
        StorageError: If the file cannot be written.
    """
    task = load_policy(checkpoint).deployment.task
    trial = Trial(checkpoint, environment_of(task), seed, robot, render_mode="rgb_array")
    frames: list[np.ndarray] = []

    def watch() -> None:
        if isinstance(image := trial.environment.render(), np.ndarray):
            frames.append(image)

    try:
        trial(index, watch)
    finally:
        trial.environment.close()
    write_atomically(file, _animated(frames, f"{checkpoint}"))
    return file


def log_evaluation(found: Evaluation, loggers: Sequence[str], robot: str | None = None) -> None:
    """Log an evaluation and the film of its first episode to trackers, in the folder of the policy's training.

    The film is written there as well. Runs that the training has logged are continued.

    Args:
        found: The evaluation.
        loggers: Names of the trackers.
        robot: Name of the simulated robot that has acted. By default the one of the demonstrations.

    Raises:
        UsageError: If a tracker does not exist or its library is not installed.
        TrainingError: If a tracker cannot be opened, or the policy's environment has no images.
        StorageError: If the film cannot be written.
    """
    checkpoint = Path(found.checkpoint)
    low, high = found.interval
    with opened(loggers, checkpoint.parent, go_on=True) as trackers:
        values = {"success_rate": found.rate, "success_rate_low": low, "success_rate_high": high}
        steps = read(checkpoint).get("global_step")
        trackers.numbers(values, steps if isinstance(steps, int) else 0)
        file = film(checkpoint, checkpoint.with_name(run_folder.ROLLOUT), found.seed, robot=robot)
        trackers.picture("rollout", file)


def _animated(frames: Sequence[np.ndarray], name: str) -> bytes:
    """Return images (H, W, 3) uint8 as an animated GIF that repeats for ever."""
    if not frames:
        raise TrainingError(f"{name}: cannot be filmed, for its environment has no images")
    scale = max(1, SIDE // max(frames[0].shape[:2]))
    height, width = (side * scale for side in frames[0].shape[:2])
    first, *others = (Image.fromarray(frame).resize((width, height), Image.Resampling.NEAREST) for frame in frames)
    buffer = io.BytesIO()
    first.save(buffer, "GIF", save_all=True, append_images=others, duration=FRAME_MS, loop=0)
    return buffer.getvalue()
