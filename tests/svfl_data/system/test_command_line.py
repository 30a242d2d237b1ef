"""Mistakes in a command line: one line that says what was meant and where the help is; and what all commands have."""

import json
import platform
from pathlib import Path

import numpy as np
import pytest

import collectors.cli
import svfl_data.cli
import svfl_models.cli
from svfl_data.errors import UsageError
from svfl_data.system.command_line import Parser, add_json, main, positive, report
from svfl_data.system.command_line.help_text import example_lines
from svfl_data.system.command_line.report import as_json, json_text
from svfl_data.system.near_names import instead
from svfl_data.system.progress import progress_console

PROGRAMS = {
    "svfl-data": svfl_data.cli.build_parser,
    "svfl-collect": collectors.cli.build_parser,
    "svfl-train": svfl_models.cli.build_parser,
}


@pytest.fixture
def refused(capsys):
    """Parse a command line that is wrong; gives the one line of complaint."""

    def run(words):
        program, *rest = words.split()
        with pytest.raises(SystemExit, match="2"):
            PROGRAMS[program]().parse_args(rest)
        out, err = capsys.readouterr()
        assert (out, err.count("\n")) == ("", 1)
        return err.rstrip("\n")

    return run


@pytest.mark.parametrize(
    ("words", "said", "page"),
    [
        ("svfl-data vaildate data", "no command 'vaildate'; did you mean validate?", "svfl-data"),
        ("svfl-train centering-tabel --data x", "did you mean centering-table?", "svfl-train"),
        ("svfl-data polish data", "no command 'polish'; possible are info, view, ", "svfl-data"),
        ("svfl-data filter a b --sucess yes", "no option --sucess; did you mean --success?", "svfl-data filter"),
        ("svfl-data filter --sucess=yes", "no option --sucess; did you mean --success?", "svfl-data filter"),
        ("svfl-collect expert --tsak x", "no option --tsak; did you mean --task?", "svfl-collect expert"),
        ("svfl-collect expert --task block_pikcing --out x", "--task: no 'block_pikcing'; did you mean block_picking?",
         "svfl-collect expert"),
        ("svfl-collect centering --sensor-noise non --out x", "--sensor-noise: no 'non'; did you mean none?",
         "svfl-collect centering"),
        ("svfl-train check c --data d --group D88", "did you mean D8?", "svfl-train check"),
        ("svfl-data split data --ratio train=1", "did you mean --ratios?", "svfl-data split"),
        ("svfl-data info data --frobnicate", "no option --frobnicate", "svfl-data info"),
        ("svfl-data info one two", "unexpected argument 'two'", "svfl-data info"),
        ("svfl-train check one two --data d", "argument 'two'; did you mean --data two?", "svfl-train check"),
        ("svfl-data info --data data", "PATH stands without an option: svfl-data info PATH", "svfl-data info"),
        ("svfl-data --jsn info data", "no option --jsn; options of a command stand after it", "svfl-data"),
        ("svfl-data --vresion", "no option --vresion; did you mean --version?", "svfl-data"),
        ("svfl-collect calibrate p --board-pose -0.4,0,0,0", "--option=-0.4,0,0,0", "svfl-collect calibrate"),
    ],
)  # fmt: skip
def test_a_mistake_is_told_with_what_was_meant_and_the_page_that_helps(refused, words, said, page):
    line = refused(words)
    assert said in line
    assert line.startswith(f"{page}: ")
    assert line.endswith(f"(see {page} --help)")


@pytest.mark.parametrize(
    ("words", "now"),
    [
        ("svfl-collect centering --samples 3", "--episodes"),
        ("svfl-train check c --samples 3", "--episodes"),
        ("svfl-train evaluate c --trials 3", "--episodes"),
        ("svfl-train bc-table --trials 3", "--episodes or --test-episodes"),
        ("svfl-data view d --save a.rrd", "--out"),
        ("svfl-data topdown d --size 9", "--image-size"),
        ("svfl-data split d --name half", "--split"),
        ("svfl-collect policy --steps 9", "--max-steps"),
        ("svfl-collect teleop --device keyboard", "--input-device"),
        ("svfl-collect calibrate p --board b.json", "--layout"),
        ("svfl-train bc --dataset d", "--data"),
        ("svfl-collect expert --num-workers 2", "--workers"),
    ],
)
def test_another_word_for_an_option_leads_to_ours(refused, words, now):
    assert f"; did you mean {now}?" in refused(words)


def test_the_beginning_of_an_option_is_not_taken_for_it(refused):
    """One episode by its number is not that many episodes."""
    assert "no option --episode; did you mean --episodes?" in refused("svfl-collect expert --episode 3 --out x")


def test_an_argument_that_is_no_text_is_told_harmlessly(refused):
    line = refused("svfl-data \x1b[2J")
    assert "\x1b" not in line


def test_a_value_that_a_command_refuses_leads_to_its_page(tmp_path, capsys):
    assert main(PROGRAMS["svfl-data"](), ["plot", str(tmp_path), "--out", "a.jpg"]) == 2
    assert capsys.readouterr().err == (
        "svfl-data: --out a.jpg: the name must end in .png (see svfl-data plot --help)\n"
    )  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS)
def test_the_version_is_one_line(program, capsys):
    with pytest.raises(SystemExit, match="0"):
        main(PROGRAMS[program](), ["--version"])
    words = capsys.readouterr().out
    assert words == f"{program} {svfl_data.__version__}, Python {platform.python_version()}\n"


def of_command(work):
    """A program with one command, which does the work."""
    root = Parser(prog="toy")
    parser = root.add_commands().add_parser("do")
    parser.add_argument("--count", type=positive, default=1)
    add_json(parser)
    parser.set_defaults(command=work)
    return root


@pytest.mark.parametrize("words", [[], ["--quiet"]])
def test_a_quiet_command_has_a_silent_console_and_no_other_has(words):
    seen = []
    assert main(of_command(lambda _: seen.append(progress_console().quiet)), ["do", *words]) == 0
    assert seen == [bool(words)]
    assert not progress_console().quiet


def test_a_command_finds_its_own_options_only():
    seen = []
    main(of_command(lambda arguments: seen.append(vars(arguments).keys())), ["do", "--quiet"])
    assert seen == [{"command", "count", "json"}]


def test_mistakes_of_the_work_are_told_with_the_page_of_the_command(capsys):
    def work(_):
        raise UsageError("--count 3 is odd")

    assert main(of_command(work), ["do"]) == 2
    assert capsys.readouterr().err == "toy: --count 3 is odd (see toy do --help)\n"


def test_a_report_is_lines_or_one_object(capsys):
    facts = {"path": Path("a"), "numbers": np.arange(2), "share": np.float32(0.5), "name": "\x1b[2J\x7f\u202e"}
    report(False, facts, "one\ntwo", 3)
    assert capsys.readouterr().out == "one\\ntwo\n3\n"
    report(True, facts, "one")
    text = capsys.readouterr().out
    assert json.loads(text) == {"path": "a", "numbers": [0, 1], "share": 0.5, "name": "\x1b[2J\x7f\u202e"}
    assert all(character == "\n" or (character.isprintable() and character.isascii()) for character in text)


def test_numbers_that_json_lacks_are_null():
    assert as_json({1: [float("inf"), np.nan, -0.0]}) == {"1": [None, None, -0.0]}
    assert "NaN" not in json_text({"a": np.array([np.nan])})


def test_names_that_are_alike_are_offered_the_nearest_first():
    assert instead("top", ["front", "top"]) == "did you mean top?"
    assert instead("side", ["side_left", "side_right", "front"]) == "possible are side_left, side_right, front"
    assert instead("side_lift", ["side_right", "side_left", "front"]) == "did you mean side_left?"
    assert instead("x" * 10**6, ["a"]) == "possible are a"


@pytest.mark.parametrize("width", [30, 60, 78])
def test_an_example_is_broken_between_words_with_an_option_beside_its_value(width):
    command = "svfl-data filter data/week data/soft --where 'steps>=8 and more' --task x  # why"
    lines = example_lines(command, width)
    assert lines[0] == "  # why"
    assert all(line.endswith(" \\") for line in lines[1:-1])
    joined = " ".join(line.rstrip("\\").strip() for line in lines[1:])
    assert joined == "svfl-data filter data/week data/soft --where 'steps>=8 and more' --task x"
    assert not any(line.endswith("--where \\") for line in lines)


def test_a_short_example_keeps_its_comment():
    assert example_lines("svfl-data repair x   # again", 60) == ["  svfl-data repair x   # again"]


def test_a_long_list_of_choices_in_the_usage_is_broken(monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    parser = Parser(prog="toy")
    names = [f"choice_{number}" for number in range(9)]
    parser.add_argument("--uses", choices=names, nargs="+")
    usage = parser.format_usage()
    assert max(map(len, usage.splitlines())) <= 60
    assert "".join(usage.split()).count(",".join(names)) == 2
