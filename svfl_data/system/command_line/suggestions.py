"""Options that were meant by another word for them, or by one that is spelt almost the same."""

from collections.abc import Collection

from svfl_data.system.near_names import near

OTHER_WORDS = {
    "--camera": ("--camera-name", "--cam"),
    "--cameras": ("--camera",),
    "--checkpoint": ("--policy", "--model-path", "--ckpt", "--weights", "--network"),
    "--data": ("--dataset", "--data-dir", "--dataset-path", "--path", "--in", "--input"),
    "--episode": ("--index", "--episode-index", "--number"),
    "--episodes": (
        "--samples", "--trials", "--demos", "--demonstrations", "--rollouts", "--num-episodes", "--n-episodes", "--num",
    ),
    "--image-size": ("--size", "--resolution", "--px", "--width", "--height"),
    "--input-device": ("--device", "--controller", "--teleop"),
    "--layout": ("--board",),
    "--max-steps": ("--steps", "--max-episode-steps", "--horizon"),
    "--out": ("--output", "--save", "--dst", "--to", "--out-dir", "--output-dir", "--file", "--run"),
    "--quiet": ("--silent", "--no-progress"),
    "--seed": ("--random-seed", "--random-state"),
    "--split": ("--name", "--split-name"),
    "--task": ("--env", "--environment"),
    "--test-episodes": ("--trials", "--eval-episodes", "--test-samples"),
    "--workers": ("--jobs", "--num-workers", "--processes", "--n-jobs"),
}  # fmt: skip
"""Words that people know from elsewhere, or from earlier commands, for each of our options."""
DATASET_WORDS = ("--data", *OTHER_WORDS["--data"])


def option_instead(asked: str, options: Collection[str]) -> str:
    """Return the option that was meant, if that can be told from another word for it or from its spelling, else "".

    Args:
        asked: Option that does not exist, such as ``--samples``.
        options: Options that exist.
    """
    known = [option for option, words in OTHER_WORDS.items() if asked in words and option in options]
    alike = known or near(asked, options)
    return f"did you mean {' or '.join(alike)}?" if alike else ""
