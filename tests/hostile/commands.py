"""Every command that is given a dataset, with what it reads of it, and where it may succeed on a spoilt one."""

from dataclasses import dataclass, field

from tests.hostile.kind import Kind

EPISODE = frozenset({"episode", "damage", "info", "folder"})
"""What a command reads that opens the first episode of a dataset folder."""
ALL = EPISODE | {"shard", "index"}
ONE_FILE = frozenset({"episode", "damage"})
ORDER = frozenset({"order"})
"""Read by what trains: time stamps that do not ascend; ``order_aside`` are those that no training reads."""
CHECKED = frozenset({"order", "order_aside"})


@dataclass(frozen=True)
class Command:
    """A command.

    Attributes:
        name: Of the command, for reports.
        words: Of the command line; ``data`` is the dataset, ``out`` an empty folder.
        reads: The concerns of `Kind` that it reads; where it does not read what is spoilt it may succeed.
        spared: Concerns that it reads, and why it may nevertheless succeed.
        changes: Whether it changes the dataset itself, as it is asked to.
        codes: With which it fails.
        heavy: Whether it needs torch or the simulation.
        binary: Whether its output is no text.
    """

    name: str
    words: tuple[str, ...]
    reads: frozenset[str]
    spared: dict[str, str] = field(default_factory=dict)
    changes: bool = False
    codes: frozenset[int] = frozenset({1, 2})
    heavy: bool = False
    binary: bool = False

    def may_succeed(self, kind: Kind) -> str:
        """Why it may succeed on a kind; empty if it must not."""
        if kind.legal:
            return kind.legal
        if kind.concern not in self.reads:
            return f"it does not read this: {kind.concern}"
        return self.spared.get(kind.concern, "")


FILE = "data/episode_000000.hdf5"
TOLD = "it lists what it cannot read"
ENTRIES = "it reads the episodes that it was asked for, or those of the training part"


def _data(name: str, *words: str, reads: frozenset[str] = ALL, **options) -> Command:
    return Command(name, ("svfl-data", *words), reads, **options)


TINY = ("--preset", "tiny", "--epochs", "1")
CHECKED_LATER = "it copies bytes as they are; what they hold is checked by whoever reads the copy"
COPIES = {"episode": CHECKED_LATER, "split": CHECKED_LATER}
LISTED = {"episode": TOLD, "damage": TOLD, "folder": TOLD}
ONE = {"folder": ENTRIES}
COMMANDS = (
    _data("info", "info", "data", spared=LISTED),
    _data("info_json", "info", "data", "--json", spared=LISTED),
    _data("info_episode", "info", "data", "--episode", "0", reads=EPISODE | {"shard"}, spared=ONE),
    _data("info_file", "info", FILE, reads=ONE_FILE),
    _data("validate", "validate", "data", reads=ALL | CHECKED),
    _data("validate_json", "validate", "data", "--json", reads=ALL | CHECKED),
    _data("validate_file", "validate", FILE, reads=ONE_FILE | CHECKED),
    _data("plot", "plot", "data", "--episode", "0", "--out", "out/p.png", reads=EPISODE | {"shard"}, spared=ONE),
    _data("plot_file", "plot", FILE, "--out", "out/p.png", reads=ONE_FILE),
    _data("topdown", "topdown", "data", "--episode", "0", "--out", "out/t.png", reads=EPISODE | {"shard"}, spared=ONE),
    _data("view", "view", "data", "--episode", "0", "--out", "out/v.rrd", reads=EPISODE | {"shard"}, spared=ONE),
    _data("view_file", "view", FILE, "--out", "out/v.rrd", reads=ONE_FILE),
    _data("compare", "view", "data", "--compare", "data", "--out", "out/v.rrd"),
    _data("card", "card", "data", "--out", "out/card.md"),
    _data("card_inside", "card", "data", changes=True),
    _data("relabel", "relabel", "data", "--episode", "0", "--success", "no", "--remove", "slip", "--contact",
          reads=EPISODE | {"shard"}, spared=ONE, changes=True),
    _data("relabel_file", "relabel", FILE, "--annotate", "slip", "0.05", "0.06", reads=ONE_FILE, changes=True),
    _data("filter", "filter", "data", "out/made", "--where", "steps>=0", "--where", "source=expert"),
    _data("merge", "merge", "data", "out/made"),
    _data("pack", "pack", "data", "out/made", reads=ALL | {"split"}, spared=COPIES),
    _data("unpack", "unpack", "data", "out/made", reads=ALL | {"split"}, spared=COPIES),
    _data("split", "split", "data", reads=frozenset({"info", "folder", "split", "shard"}), changes=True),
    _data("stats", "stats", "data", reads=EPISODE | ORDER | {"shard", "split"}, spared=ONE, changes=True),
    _data("repair", "repair", "data", reads=frozenset({"info", "damage", "journal"}), changes=True,
          codes=frozenset({1, 2, 3}), spared={"damage": "what it can set aside is dealt with", "journal": "likewise"}),
    Command("importer", ("rerun-importer-svfl", FILE), frozenset({"episode"}), binary=True),
    *(
        Command(name, ("library", name, "data"), reads, heavy=name == "torch_samples", spared=ONE)
        for name, reads in (
            ("samples", EPISODE | ORDER | {"shard"}), ("torch_samples", EPISODE | ORDER | {"shard"}),
            ("buffer", EPISODE | ORDER | {"shard"}), ("buffer_of_inputs", EPISODE | ORDER | {"shard"}),
            ("words", EPISODE | {"shard"}), ("load_statistics", frozenset({"info", "split", "statistics"})),
        )
    ),
    Command("centering", ("svfl-train", "centering", "--data", "data", "--encoder", "vf", "--model", "cnn",
            "--train-samples", "2", "--test-samples", "8", *TINY, "--out", "out/made"),
            EPISODE | ORDER | {"shard"}, heavy=True, spared=ONE),
    Command("bc", ("svfl-train", "bc", "--data", "data", "--episodes", "10", "--model", "cnn", "--batch-size", "8",
            *TINY, "--out", "out/made"), EPISODE | ORDER | {"shard"}, heavy=True, spared=ONE),
    Command("latent", ("svfl-train", "latent", "--model", "poe", "--preset", "vtt_2022", "--contact-n", "0.5", "--data",
            "data", "--split", "default", "--steps", "1", "--batch-size", "1", "--sequence", "2", "--out", "out/made",
            "--quiet"), EPISODE | ORDER | {"shard", "split"}, heavy=True, spared=ONE),
)  # fmt: skip
BY_NAME = {one.name: one.words for one in COMMANDS}
VIEWED = ("svfl-data", "view", "data", "--episode", "0", "--out", "out/v.rrd", "--checkpoint")
MODEL_COMMANDS = tuple(
    Command(name, words, frozenset({file}), heavy=True)
    for name, file, words in (
        ("check", "centering.ckpt", ("svfl-train", "check", "centering.ckpt", "--data", "data")),
        ("export_centering", "centering.ckpt", ("svfl-train", "export", "centering.ckpt", "--out", "out/m.pt2")),
        ("view_centering", "centering.ckpt", (*VIEWED, "centering.ckpt")),
        ("evaluate", "bc.ckpt", ("svfl-train", "evaluate", "bc.ckpt", "--episodes", "1", "--out", "out/e.json")),
        ("export_bc", "bc.ckpt", ("svfl-train", "export", "bc.ckpt", "--out", "out/m.pt2")),
        ("view_bc", "bc.ckpt", (*VIEWED, "bc.ckpt")),
        ("policy_bc", "bc.ckpt", ("svfl-collect", "policy", "--task", "block_picking", "--checkpoint", "bc.ckpt",
         "--episodes", "1", "--image-size", "76", "--out", "out/made")),
        ("policy", "policy.pt2", ("svfl-collect", "policy", "--task", "block_picking", "--checkpoint", "policy.pt2",
         "--episodes", "1", "--image-size", "76", "--out", "out/made")),
        ("view_policy", "policy.pt2", (*VIEWED, "policy.pt2")),
        ("latent_eval", "latent.ckpt", ("svfl-train", "latent-eval", "latent.ckpt", "--data", "data", "--episodes", "1",
         "--out", "out/made")),
        ("centering_latent", "latent.ckpt", ("svfl-train", "centering", "--data", "data", "--latent", "latent.ckpt",
         "--use", "frozen", "--train-samples", "2", "--test-samples", "8", "--epochs", "1", "--out", "out/made")),
        ("info_centering", "centering.ckpt", ("svfl-train", "info", "centering.ckpt")),
        ("info_bc", "bc.ckpt", ("svfl-train", "info", "bc.ckpt", "--json")),
        ("info_latent", "latent.ckpt", ("svfl-train", "info", "latent.ckpt")),
        ("info_policy", "policy.pt2", ("svfl-train", "info", "policy.pt2")),
        ("info_run", "bc.ckpt_run", ("svfl-train", "info", "out/made")),
        ("load_buffer", "buffer.replay", ("library", "load_buffer", "buffer.replay")),
        ("bc_again", "bc.ckpt_run", BY_NAME["bc"]),
        ("latent_again", "latent.ckpt_run", (*BY_NAME["latent"], "--steps", "2")),
    )
)  # fmt: skip
REPLAY = Command("replay", ("svfl-collect", "replay", "data", "--episode", "0"), frozenset({"config"}), heavy=True)
URDF = _data(
    "view_arm", "view", "data", "--episode", "0", "--urdf", "arm.urdf", "--out", "out/v.rrd", reads=frozenset({"urdf"})
)
EVERY = (*COMMANDS, *MODEL_COMMANDS, REPLAY, URDF)
