"""Progress of a collection: a whole line at 80 columns for every task, lines where nobody watches, none if quiet."""

import io
import re

import pytest
from rich.console import Console

from collectors.recording import progress
from collectors.recording.progress import CollectionProgress
from collectors.recording.worker import Collected
from collectors.tasks import TASKS
from svfl_data.system.progress import quiet


def collected(index):
    return Collected(index, 48, True, 1, ())


@pytest.mark.parametrize("task", TASKS)
def test_a_line_is_whole_at_80_columns(task, monkeypatch):
    console = Console(file=io.StringIO(), force_terminal=True, width=80, height=25)
    monkeypatch.setattr("svfl_data.system.progress.bars.progress_console", lambda: console)
    with CollectionProgress() as shown:
        shown._bars._bars.auto_refresh = False
        shown.begin(task, 1000, 1000)
        shown._start -= 20  # at 144 steps/s
        for index in range(60):
            shown.advance(collected(index))
    line = re.split(r"[\r\n]+", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", console.file.getvalue()).strip())[-1]
    assert len(line) <= 80
    assert re.fullmatch(rf"{task} [━╸╺]+ +60/1000 \d+ steps/s, 100% succeed [-\d:]+ left\s*", line)


@pytest.mark.parametrize("wanted", [False, True])
def test_lines_now_and_then_where_nobody_watches(monkeypatch, capsys, wanted):
    monkeypatch.setattr(progress, "QUIET_SECONDS", -1.0)
    with quiet(wanted), CollectionProgress() as shown:
        shown.begin("a\x1b[2J", 3, 3)
        for index in range(3):
            shown.advance(collected(index))
    out, err = capsys.readouterr()
    assert out == ""
    lines = [] if wanted else ["1/3", "2/3"]
    told = re.findall(r"^a\\x1b\[2J: (\d/3), \d+ steps/s, 100% succeed, \d+ s left$", err, re.M)
    assert (told, err.count("\n")) == (lines, len(lines))
