"""``--json``: one object on standard output, with the keys that docs/commands.md tells, and nothing else there."""

import json

import pytest

from svfl_data.cli import build_parser
from svfl_data.datasets.dataset import Dataset
from svfl_data.system import command_line
from tests.helpers.collecting import collect
from tests.helpers.command_lines import data_commands, make_data
from tests.helpers.command_page import item_keys, json_keys, rows

REPORTING = [command.removeprefix("svfl-data ") for command, _ in rows("json") if command.startswith("svfl-data ")]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return make_data(tmp_path_factory.mktemp("reports") / "data", 5)


@pytest.mark.parametrize("command", [command for command in REPORTING if "--" not in command])
def test_a_report_has_the_documented_keys(command, data, tmp_path, capsys):
    lines = data_commands(data, tmp_path)
    if command == "stats":
        command_line.main(build_parser(), [*lines["split"], "--quiet"])
        capsys.readouterr()
    assert command_line.main(build_parser(), [*lines[command], "--json", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    assert json.loads(out).keys() == json_keys(f"svfl-data {command}")


def test_one_episode_has_a_report_of_its_own(data, capsys):
    command_line.main(build_parser(), ["info", str(data), "--episode", "1", "--json"])
    assert json.loads(capsys.readouterr().out).keys() == json_keys("svfl-data info --episode")


def test_findings_and_actions_are_told_and_fail_as_without_json(tmp_path, capsys):
    data = make_data(tmp_path / "data")
    Dataset.open(data).episode_path(1).write_bytes(b"no episode")
    for command, items in (("validate", "findings"), ("repair", "actions")):
        assert command_line.main(build_parser(), [command, str(data), "--json"]) == 1
        out, err = capsys.readouterr()
        assert err.count("\n") == 1
        told = json.loads(out)[items]
        assert told
        assert all(one.keys() == item_keys(f"svfl-data {command}") for one in told)


def test_a_command_that_cannot_work_prints_no_object(tmp_path, capsys):
    assert command_line.main(build_parser(), ["info", str(tmp_path / "absent"), "--json"]) == 1
    assert capsys.readouterr().out == ""


def test_pages_of_tags(tmp_path):
    for words in (["--count", 2], ["--board", "2x2"]):
        done = collect("tags", *words, "--out", tmp_path / "tags.pdf", "--json")
        told = json.loads(done.stdout)
        assert told.keys() == json_keys("svfl-collect tags")
        assert told["files"] == [str(tmp_path / "tags.pdf")]
        assert (told["layout"] is None) == ("--count" in words)


@pytest.mark.slow
def test_what_is_collected_and_replayed(tmp_path):
    size = ("--image-size", 16, "--json")
    for command, words in (("expert", ["--task", "block_picking"]), ("centering", [])):
        done = collect(command, *words, "--episodes", 1, "--out", tmp_path / command, *size)
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert told.keys() == json_keys(f"svfl-collect {command}")
        (dataset,) = told["datasets"]
        assert dataset.keys() == item_keys(f"svfl-collect {command}")
        assert (dataset["episodes"], dataset["collected"], dataset["path"]) == (1, 1, str(tmp_path / command))
        assert done.stderr == ""
    told = json.loads(collect("replay", tmp_path / "expert", "--json").stdout)
    assert told.keys() == json_keys("svfl-collect replay")
    assert told["exact"]
    assert set(told["differences"].values()) == {0}
