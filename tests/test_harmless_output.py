"""Names from a file of a stranger's reach no terminal, picture or page as anything but visible text in their place."""

import os
import re
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest
import rerun as rr
from matplotlib.figure import Figure
from matplotlib.text import Text

from svfl_data.cli import build_parser
from svfl_data.datasets.dataset import Dataset
from svfl_data.errors import SvflError
from svfl_data.storage.store import read_episode, write_episode
from svfl_data.system import command_line
from svfl_data.system.printable import ESCAPED, markdown, printable, say
from svfl_data.viewer import show
from svfl_data.viewer.entities.episode_source import EpisodeSource
from tests.helpers.builders import make_episode
from tests.helpers.command_lines import data_commands
from tests.helpers.refusals import EACH, refused  # noqa: F401 - a fixture

pytestmark = pytest.mark.slow

HOSTILE = (
    "\x1b]0;owned\x07\x1b[2J\nFORGED: all is well\r\x9b31m\u202egnp\u2066\u200b\U000e0041"
    "|<img src=x onerror=alert(1)>![p](http://evil.example/p.png)`code`[a](b)*b*$x^2$"
)
MARKUP = re.compile(r"(?<!\\)(<img|!?\[p\]|\[a\]|`code|\*b)|(?<!\\)://evil")


def hidden(text: str) -> list[str]:
    return [c for c in text if c != "\n" and unicodedata.category(c) in ESCAPED]


def assert_harmless(text: str, where: object) -> None:
    assert not hidden(text), where
    assert not re.search(r"^FORGED", text, re.MULTILINE), where


@pytest.fixture
def folder(tmp_path):
    """Two episodes of which everything that has a name has a hostile one."""
    path = tmp_path / "data"
    dataset = Dataset.create_or_resume(path, HOSTILE, 0, {HOSTILE: HOSTILE})
    for index in range(3):
        episode = make_episode(index)
        meta = replace(
            episode.meta,
            task=HOSTILE,
            source=HOSTILE,
            software={HOSTILE: HOSTILE},
            config={HOSTILE: HOSTILE, "rejected": [HOSTILE]},
            annotations=[{"name": HOSTILE, "start_ns": 250_000_000, "end_ns": 280_000_000}],
            history=[{"time": HOSTILE, "tool": HOSTILE}],
        )
        named = {path.replace("cameras/front/", f"cameras/{HOSTILE.replace('/', '')}/"): values
                 for path, values in episode.arrays.items()}  # fmt: skip
        for arrays in (named, episode.arrays):
            try:
                write_episode(replace(episode, meta=meta, arrays=arrays), dataset.episode_path(index))
                break
            except SvflError:  # such a camera is refused: then the rest is tried
                continue
    return path


@pytest.fixture
def drawn(monkeypatch):
    """Every text of every figure that is written."""
    texts: list[str] = []
    usual = Figure.savefig

    def savefig(figure, *words, **options):
        texts.extend(text.get_text() for text in figure.findobj(Text))
        return usual(figure, *words, **options)

    monkeypatch.setattr(Figure, "savefig", savefig)
    return texts


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("command", sorted(data_commands(Path(), Path())))
def test_every_command_shows_names_as_visible_text(folder, tmp_path, capsys, drawn, command):
    lines = data_commands(folder, tmp_path)
    if command == "stats":
        command_line.main(build_parser(), lines["split"])
        capsys.readouterr()
    for words in (lines[command], [*lines[command], *(["--episode", "1"] if command == "info" else [])]):
        command_line.main(build_parser(), words)
        out, err = capsys.readouterr()
        assert_harmless(out, words)
        assert_harmless(err, words)
    for text in drawn:
        assert_harmless(text, command)
    for page in tmp_path.glob("*.md"):
        assert_harmless(page.read_text(), page)
        assert not MARKUP.search(page.read_text()), MARKUP.search(page.read_text())


def test_machine_readable_output_says_the_same_in_escapes(folder, tmp_path, capsys):
    for command in ("info", "validate", "repair"):
        command_line.main(build_parser(), [*data_commands(folder, tmp_path)[command], "--json"])
        assert_harmless(capsys.readouterr().out, command)


@pytest.mark.filterwarnings("ignore:Glyph")
def test_a_page_says_where_a_dataset_comes_from(folder, tmp_path, capsys):
    lines = data_commands(folder, tmp_path)
    assert command_line.main(build_parser(), lines["merge"]) == 0
    assert command_line.main(build_parser(), ["card", f"{tmp_path}/merged"]) == 0
    text = (tmp_path / "merged" / "README.md").read_text()
    assert "FORGED: all is well" in text
    assert_harmless(text, "card")
    assert not MARKUP.search(text), MARKUP.search(text)


@pytest.mark.parametrize(("program", "command"), EACH)
def test_the_words_of_an_error_are_one_line(refused, program, command):  # noqa: F811
    code, said = refused(program, command, SvflError(f"no task {HOSTILE}"))
    assert code == 1
    assert said.count("\n") == 1
    assert_harmless(said, (program, command))


def test_the_viewer_shows_names_as_visible_text(folder, monkeypatch, tmp_path):
    reader = Dataset.open(folder).episode(0)
    said: list[str] = []
    usual = rr.TextDocument.__init__

    def init(self, text, *words, **options):
        said.append(str(text))
        usual(self, text, *words, **options)

    monkeypatch.setattr(rr.TextDocument, "__init__", init)
    monkeypatch.setattr(rr.RecordingStream, "send_recording_name", lambda _, name: said.append(name))
    show.save(show.content([(EpisodeSource.of(reader), None)]), tmp_path / "a.rrd")
    assert len(said) >= 2
    for text in said:
        assert_harmless(text, text)
    assert not MARKUP.search(said[-1])


def test_an_episode_that_is_printed_in_a_notebook_is_harmless(folder):
    path = folder / "episode_000000.hdf5"
    assert_harmless(repr(Dataset.open(folder).episode(0)), path)
    assert_harmless(repr(read_episode(path)), path)


def test_one_line_stays_one(capsys):
    say("a\nb", HOSTILE, 3)
    assert capsys.readouterr().out.count("\n") == 3


@pytest.mark.parametrize("name", ["block_picking", "V+F SVFL", "3.2.7", "data/centering", "front-2", "a (b), c: d"])
def test_ordinary_names_are_left_as_they_are(name):
    assert markdown(name) == printable(name) == name


@pytest.mark.parametrize("text", ["__b__", "_b_", "<b>", "a|b", "www.a.example", "a://b", "a@b.c", "~~a~~", "#1"])
def test_markup_is_escaped(text):
    assert markdown(text) != text
    assert re.sub(r"\\(.)", r"\1", markdown(text)) == text


def test_folders_of_hostile_names_are_printed_harmlessly(tmp_path, capsys):
    folder = tmp_path / os.fsdecode(b"\x1b[2J\xff\nFORGED")
    command_line.main(build_parser(), ["info", str(folder)])
    assert_harmless(capsys.readouterr().err, folder)
