"""Progress bars: they fit 80 columns, whole and with the time left; none where nobody looks or wants them."""

import io
import re
import sys

import pytest
from rich.console import Console

from svfl_data.system.progress import FEW, progress, progress_console, progress_line, quiet
from svfl_data.system.progress.bars import LONGEST_NAME, SHORTEST_BAR, Bars

ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
COLOUR = re.compile(r"\x1b\[[0-9;]*\b(?:3[0-8]|4[0-8]|9[0-7]|10[0-7])(?:;[0-9;]*)?m")


def terminal(width=80, **options):
    options = {"color_system": "truecolor", "_environ": {}} | options
    return Console(file=io.StringIO(), force_terminal=True, width=width, height=25, **options)


def last_line(console):
    """What stands on the line of a terminal at the end."""
    text = ESCAPE.sub("", console.file.getvalue())
    return [line for line in re.split(r"[\r\n]", text) if line.strip()][-1]


def shown(doing, done, total, words, width=80, **options):
    """The line of a bar, some time after its start."""
    console = terminal(width)
    bars = Bars(console, transient=False)
    with bars:
        bar = bars.add(doing, total, **options)
        bars.update(bar, advance=1)
        bars.update(bar, completed=done, words=words)
    return last_line(console)


@pytest.mark.parametrize(
    ("doing", "total", "words"),
    [
        ("reading episodes", 12345, ""),
        ("household_picking_heldout", 1000, "123 steps/s, 100% succeed"),
        ("block_picking", 10000, "1234 steps/s, 100% succeed"),
        ("epoch", 500, "loss 0.123, test accuracy 100.0%, best 100.0%"),
        ("epoch", 2000, "loss -10.123, held out -10.123, 123.4 mm"),
        ("step", 10000, "loss 0.0001234, held out 0.0001234"),
        ("episode", 1000, "1000 of 1000 succeeded"),
    ],
)
@pytest.mark.parametrize("share", [0.5, 1])
def test_a_line_is_whole_at_80_columns(doing, total, words, share):
    done = int(share * total)
    line = shown(doing, done, total, words)
    assert len(line) <= 80
    assert line.startswith(doing)
    assert line.rstrip().endswith(" left")
    assert f" {done}/{total} " in line
    assert words in line
    assert "…" not in line
    assert sum(character in "━╸╺" for character in line) >= SHORTEST_BAR - 1


@pytest.mark.parametrize("width", [80, 100, 40])
def test_words_that_are_too_long_are_cut_and_nothing_else_is(width):
    line = shown("runs", 3, 10, "centering_vf_D12_100_seed0: " + "test accuracy 97.0%, " * 9, width, count="12/24")
    assert len(line) <= width
    assert line.startswith("runs ")
    assert " 12/24 " in line
    assert line.rstrip().endswith(" left")
    assert "…" in line


def test_names_from_files_are_cut_and_harmless():
    line = shown("\x1b]0;owned\x07\n" + "x" * 99, 1, 200, "[red]\x1b[2J")
    assert len(line) <= 80
    assert "\\x1b]0;owned\\x07\\nxx" in line
    assert "[red]\\x1b[2J" in line
    assert LONGEST_NAME < 80


def test_the_time_left_follows_from_the_speed():
    console, now = terminal(), [0.0]
    bars = Bars(console, transient=False)
    bars._bars.get_time = lambda: now[0]
    with bars:
        bar = bars.add("reading", 10)
        for _ in range(5):
            now[0] += 100.0  # slower than the 30 s over which rich usually looks back
            bars.update(bar, advance=1)
    assert "5/10" in last_line(console)
    assert re.search(r"0:0[68]:\d\d left", last_line(console))  # 500 s, or 400 if the first piece is not counted


@pytest.mark.parametrize("value", ["1", "anything"])
def test_colours_are_left_out_where_they_are_not_wanted(value):
    plain, coloured = terminal(_environ={"NO_COLOR": value}), terminal()
    for console in (plain, coloured):
        with Bars(console) as bars:
            bars.update(bars.add("reading", 10), advance=5, words="half")
    assert not COLOUR.search(plain.file.getvalue())
    assert COLOUR.search(coloured.file.getvalue())


@pytest.mark.parametrize("wanted", [True, False])
def test_quiet_shows_neither_bars_nor_lines(monkeypatch, wanted):
    said = io.StringIO()
    monkeypatch.setattr(sys, "stderr", said)
    monkeypatch.setenv("FORCE_COLOR", "1")  # as on a terminal
    with quiet(wanted):
        assert progress_console().quiet is wanted
        progress_line("half")
        with quiet(False):
            assert list(progress(range(FEW + 1), "counting")) == list(range(FEW + 1))
    assert bool(said.getvalue()) is not wanted


def test_a_line_of_progress_is_one_harmless_line(capsys):
    progress_line("a\n[red]b\x1b[2J " + "x" * 200)
    out, err = capsys.readouterr()
    assert out == ""
    assert err == "a\\n[red]b\\x1b[2J " + "x" * 200 + "\n"


def test_what_goes_to_a_file_is_not_moved_to_the_terminal(monkeypatch):
    """Results that are printed while a bar is shown belong to standard output, which may be a pipe."""
    out = io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    console = terminal()
    with Bars(console):
        print("a result")
    assert out.getvalue() == "a result\n"
    assert "a result" not in console.file.getvalue()


def test_few_items_get_no_bar_and_an_early_end_removes_it(monkeypatch):
    console = terminal()
    monkeypatch.setattr("svfl_data.system.progress.bars.progress_console", lambda: console)
    assert list(progress(range(FEW), "counting")) == list(range(FEW))
    assert console.file.getvalue() == ""
    items = progress(range(FEW + 1), "counting")
    next(items)
    items.close()
    assert console.file.getvalue().endswith("\x1b[2K")  # the line of the bar is empty again
