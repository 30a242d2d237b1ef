"""What docs/commands.md declares: the words of options, and the keys of JSON reports."""

import re
from pathlib import Path

PAGE = (Path(__file__).parents[2] / "docs" / "commands.md").read_text()


def rows(name: str) -> list[tuple[str, str]]:
    """The two cells of every row of a table of the page."""
    table = PAGE.partition(f"<!-- {name} -->")[2].partition(f"<!-- end of {name} -->")[0]
    return [(first, second) for first, second in re.findall(r"^\| `(.*?)` \| (.*) \|$", table, re.M)]


OPTIONS = [(option.partition(" ")[0], option.partition(" ")[2], words) for option, words in rows("options")]
"""Option, the placeholder of its value ("" for none), and how its help begins in every command."""


def json_keys(command: str) -> set[str]:
    """The keys of a command's report."""
    ((_, cell),) = [row for row in rows("json") if row[0] == command]
    return set(re.findall(r"`(\w+)`", re.sub(r"\(each .*?\)", "", cell)))


def item_keys(command: str) -> set[str]:
    """The keys of each item of the list in a command's report."""
    ((_, cell),) = [row for row in rows("json") if row[0] == command]
    return set(re.findall(r"`(\w+)`", re.search(r"\(each (.*?)\)", cell)[1]))
