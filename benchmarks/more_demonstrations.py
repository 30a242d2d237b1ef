"""Whether a policy gets worse with more demonstrations, and why: success of each seed in four settings.

    python benchmarks/more_demonstrations.py --data data/perturbed/drawer_closing --seeds 3 4 5 --out out/more

Trained are policies on the first 25, on the last 25 and on all of 50 demonstrations with equally many optimiser steps,
as in `svfl-train bc-table`, and on 50 with twice as many steps, which is as many epochs as those on 25 have. Finished
policies are kept, so the same command goes on after an interruption, and can be given further seeds.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from svfl_models.cloning.config import NETWORKS, CloningConfig
from svfl_models.experiments.cloning_table import Run
from svfl_models.experiments.runs.folder import RUNS
from svfl_models.experiments.seed_intervals import difference, success_rate
from svfl_models.training.figures import save

SETTINGS = {
    "first 25": ("first", 25, 120),
    "last 25": ("last", 25, 120),
    "50": ("first", 50, 60),
    "50, twice\nthe steps": ("first", 50, 120),
}
"""Which demonstrations, how many, and number of epochs, by name."""


def last_half(data: Path, out: Path) -> Path:
    """A dataset of the demonstrations 25 to 49 of another one, made unless it is there already."""
    source = Dataset.open(data)
    half = Dataset.create_or_resume(out / "last", source.info["task"], source.info["seed"], source.info["config"])
    for place, index in enumerate(source.indices[25:50]):
        if place not in half.indices:
            episode = source.read(index)
            write_episode(replace(episode, meta=replace(episode.meta, index=place)), half.episode_path(place))
    return half.path


def runs_of(arguments: argparse.Namespace) -> dict[str, list[Run]]:
    """The policies of each setting, one for each seed."""
    data = {"first": arguments.data, "last": last_half(arguments.data, arguments.out)}
    found = {}
    for name, (which, episodes, epochs) in SETTINGS.items():
        one = CloningConfig(str(data[which]), episodes, epochs=epochs, **NETWORKS[arguments.network])
        found[name] = [
            Run(
                replace(one, seed=seed),
                arguments.out / RUNS / f"{which}_{episodes}x{epochs}_seed{seed}",
                arguments.test_episodes,
            )
            for seed in arguments.seeds
        ]
    return found


def draw(tables: dict[str, np.ndarray], title: str, file: Path) -> None:
    """Draw the success of each seed and the mean with its interval, by setting."""
    figure = Figure(figsize=(5.6, 3.6), layout="constrained")
    axes = figure.subplots()
    for place, trials in enumerate(tables.values()):
        one, seeds = success_rate(trials), 100 * trials.mean(axis=1)
        spread = [[100 * (one.value - one.low)], [100 * (one.high - one.value)]]
        axes.errorbar(place, 100 * one.value, spread, fmt="_", color="black", capsize=4, markersize=22)
        axes.plot(place + np.linspace(-0.16, 0.16, len(seeds)), seeds, "o", color="#d55e00", markersize=5)
    axes.set_xticks(range(len(tables)), list(tables))
    axes.set(ylabel="success, % (dots: seeds)", ylim=(0, 100), title=title, xlim=(-0.5, len(tables) - 0.5))
    axes.grid(axis="y", alpha=0.3)
    save(figure, file)


def main() -> None:
    """Train and evaluate what is missing, and print and draw what is known."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="demonstrations of one task, at least 50")
    parser.add_argument("--network", choices=tuple(NETWORKS), default="cnn")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], metavar="S")
    parser.add_argument(
        "--test-episodes", type=int, default=50, metavar="N", help="scenes in which each policy is tried"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER")
    arguments = parser.parse_args()
    runs = runs_of(arguments)
    for of_seed in zip(*runs.values(), strict=True):
        for run in of_seed:
            if run.outcome() is None:
                run()
            print(run.folder.name, run.words(), flush=True)
    tables = {
        name: np.array([outcome["success"] for run in some if (outcome := run.outcome())], dtype=float)
        for name, some in runs.items()
    }
    for name, trials in tables.items():
        one = success_rate(trials)
        each = ", ".join(f"{100 * rate:.0f}" for rate in trials.mean(axis=1))
        print(f"{name!r}: {100 * one.value:.0f} % ({100 * one.low:.0f} to {100 * one.high:.0f}), seeds {each}")
    first, *others = tables
    for name in others:
        one = difference(tables[name], tables[first])
        print(f"{name!r} minus {first!r}: {100 * one.value:+.0f} ({100 * one.low:+.0f} to {100 * one.high:+.0f})")
    title = f"{arguments.data.name.replace('_', ' ')}, {arguments.network.upper()}, {len(arguments.seeds)} seeds"
    draw(tables, title, arguments.out / "more_demonstrations.png")


if __name__ == "__main__":
    main()
