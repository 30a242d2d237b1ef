"""A working command line for every command of the three programs, on small data, for laws that hold for all of them."""

from pathlib import Path

from svfl_data.datasets.dataset import Dataset
from svfl_data.storage.store import write_episode
from tests.helpers.builders import make_episode
from tests.helpers.version_1 import version_1


def make_data(folder: Path, episodes: int = 3) -> Path:
    """A dataset of synthetic block-centering episodes; beside it one of format 1.0, which ``upgrade`` asks for."""
    dataset = Dataset.create_or_resume(folder, "centering", 0, {})
    for index in range(episodes):
        write_episode(make_episode(index), dataset.episode_path(index))
    version_1(folder.with_name("version_1"))
    return folder


def data_commands(data: Path, out: Path) -> dict[str, list[str]]:
    """The words of every command of ``svfl-data``, in an order that works: ``stats`` asks for a split."""
    own = {
        "split": ["--ratios", "train=0.6", "test=0.4"],
        "stats": [],
        "info": [],
        "validate": [],
        "repair": [],
        "card": ["--out", f"{out}/card.md"],
        "plot": ["--out", f"{out}/plot.png"],
        "topdown": ["--out", f"{out}/above.png"],
        "view": ["--out", f"{out}/view.rrd"],
        "relabel": ["--episode", "0", "--success", "no"],
        "filter": [f"{out}/filtered", "--success", "yes"],
        "merge": [f"{out}/merged"],
        "pack": [f"{out}/packed"],
        "unpack": [f"{out}/unpacked"],
    }
    upgrade = ["upgrade", str(data.with_name("version_1")) if data.name else "", f"{out}/upgraded"]
    others = {"upgrade": upgrade, "completion": ["completion", "bash"]}
    return {command: [command, str(data), *words] for command, words in own.items()} | others


def train_commands(data: Path, out: Path) -> dict[str, list[str]]:
    """The words of every command of ``svfl-train``; the checkpoints that some need do not exist."""
    network, latent = f"{out}/network.ckpt", f"{out}/latent.ckpt"
    run = out / "run" / "run.yaml"
    run.parent.mkdir(parents=True, exist_ok=True)
    run.write_text(f"program: bc\ndata: {data}\n")
    table = ["--data", str(data), "--seeds", "1", "--epochs", "1", "--preset", "tiny", "--workers", "1"]
    few = ["--train-samples", "1", "--test-samples", "1"]
    return {
        "centering": ["centering", "--data", str(data), *few, "--epochs", "1", "--out", f"{out}/centering"],
        "check": ["check", network, "--data", str(data)],
        **{
            command: [command, *table, *few, "--out", f"{out}/{command}"]
            for command in ("centering-table", "centering-acuity", "centering-groups", "centering-ablation")
        },
        "centering-latents": ["centering-latents", *table, *few, "--latents", latent, "--out", f"{out}/latents"],
        "export": ["export", network, "--out", f"{out}/network.pt2"],
        "bc": ["bc", "--data", str(data), "--epochs", "1", "--out", f"{out}/bc"],
        "bc-table": ["bc-table", *table, "--episodes", "2", "--test-episodes", "1", "--out", f"{out}/bc_table"],
        "evaluate": ["evaluate", network, "--episodes", "1"],
        "latent": ["latent", "--model", "poe", "--data", str(data), "--steps", "1", "--out", f"{out}/latent"],
        "rerun": ["rerun", f"{out}/run"],
        "latent-eval": ["latent-eval", latent, "--data", str(data)],
        "info": ["info", network],
    }


def collect_commands(data: Path, out: Path) -> dict[str, list[str]]:
    """The words of every command of ``svfl-collect``; the policy that one needs does not exist."""
    task = ["--task", "block_picking"]
    return {
        "expert": ["expert", *task, "--episodes", "1", "--image-size", "16", "--out", f"{out}/expert"],
        "centering": ["centering", "--episodes", "1", "--image-size", "16", "--out", f"{out}/collected"],
        "policy": ["policy", *task, "--checkpoint", f"{out}/policy.pt2", "--episodes", "1", "--out", f"{out}/policy"],
        "replay": ["replay", str(data)],
        "teleop": ["teleop", *task, "--input-device", "keyboard", "--out", f"{out}/teleop"],
        "tags": ["tags", "--count", "2", "--out", f"{out}/tags.pdf"],
        "calibrate": [
            "calibrate", str(data), "--layout", f"{out}/board.json", "--board-pose", "0.45,-0.1,0,90",
            "--out", f"{out}/calibration.json",
        ],
    }  # fmt: skip


COMMANDS = {"svfl-data": data_commands, "svfl-train": train_commands, "svfl-collect": collect_commands}


def commands_of(program: str) -> set[str]:
    """All commands that a program has."""
    from collectors.cli import build_parser as collect
    from svfl_data.cli import build_parser as data
    from svfl_models.cli import build_parser as train

    root = {"svfl-data": data, "svfl-train": train, "svfl-collect": collect}[program]()
    (commands,) = (action.choices for action in root._actions if action.dest == "command_name")
    return set(commands or ())
