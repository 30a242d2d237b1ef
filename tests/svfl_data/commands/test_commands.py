"""The commands of ``svfl-data``: what they print, what they leave, and how they refuse."""

import dataclasses
import json
import re
import subprocess
import sys

import numpy as np
import pytest

from svfl_data.checks import Finding
from svfl_data.cli import COMMANDS
from svfl_data.datasets.dataset import Dataset
from svfl_data.schema.episode import Episode, Meta
from svfl_data.signals.contact import ContactRule, contact_annotations
from svfl_data.signals.transforms import processed_wrench
from svfl_data.storage.store import read_episode, write_episode
from tests.helpers.builders import episode_arrays

pytestmark = pytest.mark.slow

NAMES = (
    "info", "view", "plot", "validate", "repair", "relabel", "filter", "merge", "split", "stats", "pack", "unpack",
    "card", "topdown", "upgrade", "completion",
)  # fmt: skip


def episode(index, task="centering", source="expert", success=True, seed=0, config=None, **kwargs):
    arrays = episode_arrays(np.random.default_rng([seed, index]), **kwargs) | {"extra/own": np.arange(3.0)}
    return Episode(Meta(task, index, seed, source, success, config or {}, {"svfl": "0"}), arrays)


def make_dataset(folder, *episodes, seed=0):
    dataset = Dataset.create_or_resume(folder, episodes[0].meta.task, seed, {"by": folder.name})
    for one in episodes:
        write_episode(one, dataset.episode_path(one.meta.index))
    return dataset


@pytest.fixture
def week(tmp_path):
    """Four episodes of different kinds, numbered 2 to 5."""
    return make_dataset(
        tmp_path / "week",
        episode(2, source="expert", config={"drawn": {"friction": 0.4}}),
        episode(3, source="teleop", success=False, config={"drawn": {"friction": 0.8}}),
        episode(4, source="teleop", steps=7),
        episode(5, source="expert", success=False),
    )


def same_arrays(one, other):
    return one.arrays.keys() == other.arrays.keys() and all(
        np.array_equal(one.arrays[path], other.arrays[path]) for path in one.arrays
    )


def one_line(text):
    return text.startswith("svfl-data") and text.endswith("\n") and text.count("\n") == 1


def test_every_command_is_known(command):
    _, out, _ = command("--help")
    assert all(f"\n    {name} " in out for name in NAMES)
    assert len(COMMANDS) == len(NAMES) - 1  # pack and unpack share a module


def test_help_is_light():
    script = """
import sys
from svfl_data.cli import main
sys.argv = ["svfl-data", "--help"]
try:
    main()
finally:
    heavy = [name for name in ("matplotlib", "rerun", "torch", "scipy", "rich") if name in sys.modules]
    print("heavy:", heavy)
"""
    shown = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert "heavy: []" in shown.stdout


def test_mistakes_are_one_line_with_their_exit_code(command, week, tmp_path):
    file, new = week.episode_path(2), tmp_path / "new"
    for code, said, *words in (
        (2, "COMMAND"),
        (2, "no command 'polish'", "polish", week.path),
        (1, "no such folder", "info", tmp_path / "nowhere"),
        (1, "no such folder", "validate", tmp_path / "nowhere"),
        (1, "no episode 9", "info", week.path, "--episode", 9),
        (2, "chooses from a dataset", "info", file, "--episode", 2),
        (2, "must end in .png", "plot", week.path, "--out", "a.jpg"),
        (2, "must end in .md", "card", week.path, "--out", "a.html"),
        (2, "name a condition", "filter", week.path, new),
        (2, "is not KEY=VALUE", "filter", week.path, new, "--where", "friction"),
        (2, "neither yes nor no", "filter", week.path, new, "--success", "maybe"),
        (1, "of 4 episodes 2 have success=true, sources are expert, teleop", "filter", week.path, new, "--task", "x"),
        (1, "no episode meets task=\"picking\"", "filter", week.path, new, "--task", "picking"),
        (1, "not empty", "filter", week.path, week.path, "--success", "yes"),
        (1, "not empty", "merge", week.path, week.path),
        (2, "say what to change", "relabel", week.path),
        (2, "need --episode N", "relabel", week.path, "--success", "yes"),
        (2, "need --contact", "relabel", week.path, "--episode", 2, "--threshold", 3),
        (2, "needs 0 <= start <= end <=", "relabel", week.path, "--episode", 2, "--annotate", "slip", 3, 99),
        (2, "not a time", "relabel", week.path, "--episode", 2, "--annotate", "slip", "now", 1),
        (2, "0 < release <= threshold", "relabel", week.path, "--contact", "--threshold", 1, "--release", 2),
        (2, "none of tare", "relabel", week.path, "--transforms", "kalman"),
        (2, "must be positive", "relabel", week.path, "--transforms", "low_pass=-3"),
        (2, "is not PART=RATIO", "split", week.path, "--ratios", "train"),
        (1, "no split", "stats", week.path, "--split", "other"),
    ):  # fmt: skip
        found, _, err = command(*words)
        assert found == code, (words, err)
        assert one_line(err), (words, err)
        assert said in err, words
    assert not new.exists()


def test_info_of_a_dataset(command, week):
    code, out, _ = command("info", week.path)
    assert code == 0
    for said in (
        "4 episodes, 19 steps", "success   2 of 4 (50.0%)", "expert (2), teleop (2)", "centering (4)",
        "wrench: 500 Hz", "[N, N m]", "front: 16 x 16 px, 20 Hz", "2.0 (4)", "svfl 0",
    ):  # fmt: skip
        assert said in out, said
    facts = json.loads(command("info", week.path, "--json")[1])
    assert (facts["episodes"], facts["steps"], facts["successes"]) == (4, 19, 2)
    assert facts["seconds"] == pytest.approx(19 * 0.05)
    assert facts["bytes"] == sum(week.episode_path(index).stat().st_size for index in week.indices)


def test_info_of_one_episode(command, week):
    command("relabel", week.path, "--episode", 4, "--annotate", "slip", 0.1, 0.25)
    for words in ((week.path, "--episode", 4), (week.episode_path(4),)):
        code, out, _ = command("info", *words)
        assert code == 0
        assert "streams/wrench/wrench float32 (275, 6) [N, N, N, N m, N m, N m] at 500.0 Hz" in out
        assert "slip from 0.100 to 0.250 s" in out
        facts = json.loads(command("info", *words, "--json")[1])
        assert facts["steps"] == 7
        assert facts["meta"]["annotations"][0]["name"] == "slip"
        clock = facts["arrays"]["streams/wrench/t_ns"]
        assert (clock["shape"], clock["dtype"], clock["unit"]) == ([275], "int64", "ns")
        assert clock["rate_hz"] == pytest.approx(500)
        wrench = facts["arrays"]["streams/wrench/wrench"]
        assert (wrench["axes"], wrench["about"], wrench["assumed"]) == ("base", "sensor origin", [])
        assert wrench["parts"][0] == ["vector", [0, 1]]


def test_info_names_what_is_damaged(command, week):
    week.episode_path(3).write_bytes(b"text")
    code, out, _ = command("info", week.path)
    assert code == 0
    assert "3 episodes" in out
    assert "damaged" in out
    assert "episode_000003.hdf5" in out


def test_validate_succeeds_on_what_is_sound_and_fails_with_1_on_an_error(command, week):
    code, out, err = command("validate", week.path)
    assert (code, err) == (0, "")
    assert "4 episodes, 0 errors, 0 warnings, 0 notes" in out
    arrays = dict(week.read(4).arrays)
    arrays["streams/wrench/t_ns"] = arrays["streams/wrench/t_ns"].copy()
    arrays["streams/wrench/t_ns"][5] = arrays["streams/wrench/t_ns"][4]
    write_episode(Episode(week.read(4).meta, arrays), week.episode_path(4))
    week.episode_path(5).write_bytes(week.episode_path(5).read_bytes()[:-100])
    code, out, err = command("validate", week.path)
    assert code == 1
    assert re.search(r"episode_000004\.hdf5.*streams/wrench/t_ns\[5\].*duplicate.*\b0\.010 s", out)
    assert re.search(r"episode_000005\.hdf5.*sealed", out)
    assert one_line(err)
    assert re.search(r"\b2 errors.*\b1 warning.*\b4 episodes", err)
    code, out, _ = command("validate", week.path, "--json")
    report = json.loads(out)
    assert (code, report["errors"], report["episodes"]) == (1, 2, 4)
    assert {"episode", "field", "index", "severity", "words"} == report["findings"][0].keys()
    assert command("validate", week.episode_path(4))[0] == 1
    assert command("validate", week.episode_path(2))[0] == 0


@pytest.mark.parametrize(
    ("conditions", "kept"),
    [
        (("--success", "yes"), [2, 4]),
        (("--success", "no", "--source", "teleop"), [3]),
        (("--task", "centering"), [2, 3, 4, 5]),
        (("--where", "index>=4"), [4, 5]),
        (("--where", "config.drawn.friction<0.5"), [2]),
        (("--where", "config.drawn.friction!=0.4"), [3]),  # what lacks an attribute does not meet a condition on it
        (("--where", "steps>4", "--where", "source=teleop"), [4]),
        (("--where", "seconds<=0.2"), [2, 3, 5]),
        (("--where", "software.svfl=\"0\""), [2, 3, 4, 5]),
    ],
)  # fmt: skip
def test_filter_keeps_what_meets_every_condition_whole_and_says_where_it_was(command, week, tmp_path, conditions, kept):
    code, _, err = command("filter", week.path, tmp_path / "new", *conditions)
    assert (code, err) == (0, "")
    new = Dataset.open(tmp_path / "new")
    assert new.indices == list(range(len(kept)))
    for number, index in enumerate(kept):
        was, now = week.read(index), new.read(number)
        assert same_arrays(was, now)
        assert now.meta.history[-1]["tool"] == "svfl-data filter"
        assert now.meta.history[-1]["came_from"] == {"dataset": "week", "index": index, "seed": 0}
        assert dataclasses.replace(now.meta, history=[], index=index) == was.meta
    assert new.info["config"]["sources"][0]["config"] == {"by": "week"}
    assert command("validate", new.path)[0] == 0


def test_merge_keeps_everything_and_where_it_was(command, week, tmp_path):
    other = make_dataset(tmp_path / "other", episode(0, task="pushing", seed=7), seed=7)
    code, _, err = command("merge", week.path, other.path, tmp_path / "all")
    assert (code, err) == (0, "")
    merged = Dataset.open(tmp_path / "all")
    assert merged.indices == [0, 1, 2, 3, 4]
    came_from = [one.meta.history[-1]["came_from"] for one in merged]
    assert came_from == [
        *({"dataset": "week", "index": index, "seed": 0} for index in (2, 3, 4, 5)),
        {"dataset": "other", "index": 0, "seed": 7},
    ]
    assert merged.read(4).meta.seed == 7
    assert same_arrays(merged.read(4), other.read(0))
    assert merged.info["task"] == "centering+pushing"
    assert str(tmp_path) not in json.dumps(merged.info)
    assert command("validate", merged.path)[0] == 0


def test_merge_of_a_merge_remembers_both(command, week, tmp_path):
    command("filter", week.path, tmp_path / "few", "--where", "index=4")
    code, _, err = command("merge", tmp_path / "few", week.path, tmp_path / "all")
    assert (code, one_line(err)) == (1, True)
    assert re.search(r"episode_\d{6}\.hdf5 of .*episode_\d{6}\.hdf5.*--once", err)
    assert "1 copy left out" in command("merge", tmp_path / "few", week.path, tmp_path / "all", "--once")[1]
    assert len(Dataset.open(tmp_path / "all")) == 4
    history = Dataset.open(tmp_path / "all").read(0).meta.history
    assert [(entry["came_from"]["dataset"], entry["came_from"]["index"]) for entry in history] == [
        ("week", 4), ("few", 0),
    ]  # fmt: skip


def other_size(arrays):
    arrays["cameras/front/color"] = arrays["cameras/front/color"][:, :8]
    arrays["cameras/front/depth"] = arrays["cameras/front/depth"][:, :8]
    return "cameras/front/color is uint8 (8, 16, 3) in", "but uint8 (16, 16, 3) in"


def other_camera(arrays):
    for path in [path for path in arrays if path.startswith("cameras/")]:
        arrays[path.replace("front", "wrist")] = arrays.pop(path)
    return "cameras/front is missing in", "but present in"


def other_rate(arrays):
    arrays["streams/wrench/t_ns"] = arrays["streams/wrench/t_ns"] * 2
    return "rate of streams/wrench is 500.0 Hz in", "but 250.0 Hz in"


def other_streams(arrays):
    del arrays["streams/joints/t_ns"], arrays["streams/joints/position"]
    return "rate of streams/joints is 20.0 Hz in", "but missing in"


@pytest.mark.parametrize("change", [other_size, other_camera, other_rate, other_streams])
def test_merge_refuses_what_does_not_fit_together(command, week, tmp_path, change):
    one = episode(0)
    arrays = dict(one.arrays)
    said = change(arrays)
    other = make_dataset(tmp_path / "other", Episode(one.meta, arrays))
    code, _, err = command("merge", week.path, other.path, tmp_path / "all")
    assert code == 1
    assert one_line(err)
    assert all(words in err for words in said), err
    assert not (tmp_path / "all").exists()


def test_a_merge_that_fails_leaves_nothing(command, week, tmp_path, monkeypatch):
    week.episode_path(3).write_bytes(b"")
    code, _, err = command("merge", week.path, tmp_path / "all")
    assert code == 1
    assert one_line(err)
    assert "episode_000003.hdf5" in err
    assert "svfl-data repair" in err
    write_episode(episode(3), week.episode_path(3))

    def full_disk(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    code, _, err = command("merge", week.path, tmp_path / "all")
    assert code == 1
    assert "No space left on device" in err
    assert [path.name for path in tmp_path.iterdir()] == ["week"]


def test_relabel_changes_what_is_said_never_what_was_recorded(command, week):
    before = week.read(3)
    assert command("relabel", week.path, "--episode", 3, "--success", "yes")[0] == 0
    after = week.read(3)
    assert after.meta.success
    assert same_arrays(before, after)
    (entry,) = after.meta.history
    assert entry["tool"] == "svfl-data relabel"
    assert entry["replaced"] == {"success": False}
    assert dataclasses.replace(after.meta, success=False, history=[]) == before.meta
    assert week.read(2).meta.history == []


def test_relabelling_as_it_is_leaves_the_file_alone(command, week):
    content = week.episode_path(4).read_bytes()
    _, out, _ = command("relabel", week.path, "--episode", 4, "--success", "yes")
    assert "0 of 1 episodes changed" in out
    assert week.episode_path(4).read_bytes() == content


def test_contacts_are_annotated_for_all_and_found_anew_without_doubling(command, week):
    assert command("relabel", week.path, "--episode", 2, "--annotate", "contact", 0.01, 0.02)[0] == 0
    assert command("relabel", week.path, "--contact", "--min-duration", 0.03)[0] == 0
    rule = ContactRule(min_duration_s=0.03)
    for one in week:
        found = [mark for mark in one.meta.annotations if "threshold_n" in mark["by"]]
        assert found == contact_annotations(one, rule)
        assert len(found) == 1
        assert found[0]["by"]["min_duration_s"] == 0.03
    assert len(week.read(2).meta.annotations) == 2  # what was marked by hand stays
    assert "0 of 4" in command("relabel", week.path, "--contact", "--min-duration", 0.03)[1]
    command("relabel", week.path, "--contact", "--threshold", 1000)
    assert [len(one.meta.annotations) for one in week] == [1, 0, 0, 0]
    assert command("validate", week.path)[0] == 0


def test_transforms_are_recorded_in_order_and_change_no_reading(command, week):
    raw = week.read(2)
    assert (
        command("relabel", week.path, "--transforms", "gravity=0.5,0,0.01,0", "tare=0,0,1,0,0,0", "low_pass=40")[0] == 0
    )
    now = week.read(2)
    assert [record["name"] for record in now.meta.transforms] == ["gravity", "tare", "low_pass"]
    assert same_arrays(raw, now)
    assert not np.allclose(processed_wrench(now), processed_wrench(raw))


def test_an_episode_file_can_be_relabelled_alone(command, week):
    file = week.episode_path(5)
    assert command("relabel", file, "--success", "yes", "--annotate", "slip", 0, 0.1)[0] == 0
    assert read_episode(file).meta.success
    assert read_episode(file).meta.annotations[0]["end_ns"] == 100_000_000
    assert command("relabel", file, "--remove", "slip")[0] == 0
    assert read_episode(file).meta.annotations == []


def test_a_failed_relabel_leaves_the_old_file(command, week, monkeypatch):
    content = week.episode_path(3).read_bytes()

    def full_disk(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full_disk)
    code, _, err = command("relabel", week.path, "--episode", 3, "--success", "yes")
    assert (code, one_line(err)) == (1, True)
    assert week.episode_path(3).read_bytes() == content


def test_split_stats_pack_and_unpack(command, week, tmp_path):
    code, out, _ = command("split", week.path, "--ratios", "train=0.5", "test=0.5", "--seed", 3, "--json")
    split = json.loads(out)
    assert code == 0
    assert sorted(split["parts"]["train"] + split["parts"]["test"]) == week.indices
    assert command("split", week.path, "--ratios", "train=0.75", "test=0.25", "--seed", 3)[0] == 1  # one stays
    code, out, _ = command("stats", week.path)
    assert code == 0
    assert "fz       mean" in out
    facts = json.loads(command("stats", week.path, "--json")[1])
    assert facts["fields"]["streams/wrench/wrench"]["unit"] == "N, N, N, N m, N m, N m"

    assert command("pack", week.path, tmp_path / "packed")[0] == 0
    assert len(list((tmp_path / "packed").glob("*.hdf5"))) == 0
    assert command("validate", tmp_path / "packed")[0] == 0
    assert "4 episodes" in command("info", tmp_path / "packed")[1]
    assert command("unpack", tmp_path / "packed", tmp_path / "again")[0] == 0
    for index in week.indices:
        file = Dataset.open(tmp_path / "again").episode_path(index)
        assert file.read_bytes() == week.episode_path(index).read_bytes()


def test_a_packed_episode_can_be_relabelled(command, week, tmp_path):
    command("pack", week.path, tmp_path / "packed")
    assert command("relabel", tmp_path / "packed", "--episode", 3, "--success", "yes")[0] == 0
    packed = Dataset.open(tmp_path / "packed")
    assert packed.read(3).meta.success
    assert packed.indices == week.indices
    assert "success   3 of 4" in command("info", packed.path)[1]


def test_repair_says_what_it_did_and_what_was_lost(command, week):
    assert "nothing to do" in command("repair", week.path)[1]
    week.episode_path(3).write_bytes(b"text")
    code, out, err = command("repair", week.path, "--json")
    assert code == 1
    assert json.loads(out)["actions"][0]["done"] == "quarantined"
    assert one_line(err)
    assert re.search(r"lost.*episode_000003\.hdf5", err)
    assert command("repair", week.path)[0] == 0
    assert command("validate", week.path)[0] == 0


@pytest.mark.slow
def test_plot_and_card_write_files(command, week, tmp_path):
    assert command("plot", week.path, "--episode", 3, "--out", tmp_path / "e.png")[0] == 0
    assert (tmp_path / "e.png").read_bytes().startswith(b"\x89PNG")
    assert command("card", week.path)[0] == 0
    assert (week.path / "README.md").read_text().startswith("# week\n")
    assert command("validate", week.path)[0] == 0


@pytest.mark.slow
def test_without_matplotlib_the_command_says_what_to_install(week, tmp_path):
    for words in (["plot", str(week.path), "--out", "e.png"], ["card", str(week.path)]):
        script = f"""
import sys
from svfl_data.cli import main
sys.modules["matplotlib"] = None
sys.argv = ["svfl-data", *{words!r}]
sys.exit(main())
"""
        ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
        assert ended.returncode == 1
        assert one_line(ended.stderr), ended.stderr
        assert "pip install" in ended.stderr


@pytest.mark.parametrize(
    ("severity", "words", "code"),
    [("warning", (), 0), ("warning", ("--strict",), 1), ("note", ("--strict",), 0), ("error", (), 1)],
)
@pytest.mark.parametrize("as_json", [(), ("--json",)])
def test_warnings_fail_only_if_one_is_strict(command, week, monkeypatch, severity, words, code, as_json):
    found = Finding("episode_000002.hdf5", "meta", None, severity, "is odd")
    monkeypatch.setattr("svfl_data.commands.validate.check_file", lambda _: [found])
    ended, out, err = command("validate", week.episode_path(2), *words, *as_json)
    assert (ended, "is odd" in out) == (code, True)
    assert one_line(err) if code else err == ""
