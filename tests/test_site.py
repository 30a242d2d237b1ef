"""What the site is made of beside the pages: references of commands, notebooks, flowcharts, tables."""

import json
import re
from itertools import pairwise

import pytest

from docs.site import commands
from docs.site.flowcharts import GAP, LANE, layered, parsed, place, svg
from docs.site.notebook_pages import notebook_page
from tests.helpers.pages import PROGRAMS, ROOT


def test_every_argument_of_every_command_is_on_its_page():
    pages = commands.command_pages()
    assert set(pages) == {f"reference/{program}.md" for program in PROGRAMS}
    for root in commands.roots():
        page = pages[f"reference/{root.prog}.md"]
        for words, _, parser in commands.commands(root):
            section = page.split(f"\n## `{words}`\n")[1].split("\n## ")[0]
            for action in filter(commands.documented, parser._actions):
                assert all(
                    f"{option}" in section for option in action.option_strings or [action.metavar or action.dest]
                )
            assert "```sh" in section


def test_help_is_shown_as_it_is():
    assert commands.plain("a*b <c> [d] `e`\n  |f|") == r"a\*b &lt;c&gt; \[d\] \`e\` \|f\|"


@pytest.mark.parametrize("file", sorted((ROOT / "notebooks").glob("*.ipynb")), ids=lambda file: file.stem)
def test_a_notebook_is_a_page_with_all_it_holds(file):
    text, pictures = notebook_page(file, "notebooks")
    cells = json.loads(file.read_text())["cells"]
    assert all("".join(cell["source"]) in text for cell in cells)
    assert len(pictures) == text.count("![Output of the code above](")
    for path, png in pictures.items():
        assert f"]({path.removeprefix('notebooks/')})" in text
        assert png.startswith(b"\x89PNG")


CHART = """
flowchart BT
    a["A & B<br/><i>below</i>"]
    a --> b --> d
    a --> c --> d
    a --> d
    x --> d
"""


def test_boxes_of_a_layer_keep_their_distance_and_arrows_go_one_way():
    _, labels, arrows = parsed(CHART)
    layers = layered(labels, arrows)
    place(layers)
    assert [sorted(box.lines[0] for box in layer if box.lines) for layer in layers] == [
        ["A & B", "x"],
        ["b", "c"],
        ["d"],
    ]
    for layer in layers:
        for left, right in pairwise(layer):
            assert right.x - left.x >= (left.width + right.width) / 2 + GAP - 1e-9
    assert [box.width for box in layers[1] if not box.lines] == [LANE, LANE]
    assert all(other.layer == box.layer + 1 for layer in layers for box in layer for other in box.after)


def test_a_flowchart_is_drawn_whole_and_safely():
    drawn = svg(CHART)
    assert re.findall(r">([^<>]+)</text>", drawn) == ["A &amp; B", "below", "x", "b", "c", "d"]
    assert drawn.count('class="head"') == 6


@pytest.mark.parametrize("source", ["flowchart LR\na --> b", "flowchart TB\na -.-> b"])
def test_what_is_not_drawn_is_said(source):
    with pytest.raises(ValueError, match="drawn here"):
        svg(source)


TABLE = "| what | why | how |\n| --- | --- | --- |\n| `x` | {text} | - |\n"
SENTENCE = "a sentence that is long enough for a row that is read and not compared"


@pytest.mark.parametrize(
    ("source", "kind"),
    [
        (TABLE.format(text=SENTENCE), "narrow"),
        (TABLE.format(text="12"), None),
        (f"|{' a |' * 8}\n|{' --- |' * 8}\n|{' 12.3 +- 4.5 |' * 8}\n", None),
        (TABLE.format(text=SENTENCE).replace("why", "[why](x.md)"), None),
        (f"|{' a |' * 8}\n|{' --- |' * 8}\n| {SENTENCE} |{' b |' * 7}\n", "always"),
    ],
)
def test_tables_of_texts_are_marked(source, kind):
    markdown = pytest.importorskip("markdown", reason="the extra docs is not installed")
    from docs.site.tables import StackedTables

    html = markdown.markdown(source, extensions=["tables", StackedTables()])
    assert re.findall(r'data-stack="(\w+)"', html) == ([kind] if kind else [])
    if kind == "narrow":
        assert f'<td data-label="why">{SENTENCE}</td>' in html
        assert html.count('data-empty=""') == 1
