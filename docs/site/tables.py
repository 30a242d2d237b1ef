"""Tables that small screens can show: rows of text become blocks whose cells carry the names of their columns.

A table of figures scrolls sideways. In a table of texts the end of a row would be hidden, so `docs/site/site.css`
lays out the cells of a row below each other, on small screens or, if the columns are many, always.
"""

from xml.etree.ElementTree import Element

from markdown import Markdown
from markdown.extensions import Extension
from markdown.treeprocessors import Treeprocessor

MANY_COLUMNS = 7
LONG_CELLS = 30  # characters, on average, of the cells of a column that is read and not compared


class StackedTables(Extension):
    """Extension of Markdown that marks the tables of texts."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Run after the texts of cells are parsed."""
        md.treeprocessors.register(Marks(md), "stacked_tables", 5)


class Marks(Treeprocessor):
    """Sets the attribute ``data-stack`` of tables of texts, and ``data-label`` of their cells."""

    def run(self, root: Element) -> None:
        """Mark all tables below an element."""
        for table in root.iter("table"):
            names = [words(cell) for cell in table.iter("th")]
            rows = [list(row) for row in table.iter("tr")][1:]
            longest = max((sum(len(words(cell)) for cell in column) for column in zip(*rows, strict=True)), default=0)
            linked = any(True for head in table.iter("th") for _ in head.iter("a"))  # links that a label cannot be
            if len(names) < 3 or longest < LONG_CELLS * len(rows) or linked:
                continue
            table.set("data-stack", "always" if len(names) >= MANY_COLUMNS else "narrow")
            for row in rows:
                for name, cell in zip(names, row, strict=True):
                    cell.set("data-label", name)
                    if words(cell) == "-":
                        cell.set("data-empty", "")


def words(cell: Element) -> str:
    """Return the text of a cell."""
    return "".join(cell.itertext()).strip()
