"""The pages of the documentation, and the blocks of code in them."""

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "data/README.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
PROGRAMS = ("svfl-collect", "svfl-data", "svfl-train")


@dataclass(frozen=True)
class Block:
    """A block of a page; `language` is empty if it is indented and not fenced."""

    page: str
    language: str
    text: str


def name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> list[Block]:
    text = page.read_text()
    fenced = [Block(name(page), *found) for found in re.findall(r"^```(\S*)\n(.*?)^```", text, re.M | re.S)]
    rest = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    indented = re.findall(r"(?<=\n\n)((?:    .*\n)+)", rest)
    return fenced + [Block(name(page), "", re.sub("^    ", "", text, flags=re.M)) for text in indented]


def python_of(page: str) -> list[str]:
    return [block.text for block in blocks(ROOT / page) if block.language == "python"]


def command_lines(block: Block) -> list[str]:
    """The lines of a block without comments; a line that a backslash continues is one."""
    lines = block.text.replace("\\\n", " ").splitlines()
    return [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]


def program_calls() -> list[list[str]]:
    """The words of every call of our programs on any page, each once, in the order of the pages."""
    lines = [
        line
        for page in PAGES
        for block in blocks(page)
        if block.language in ("", "sh")
        for line in command_lines(block)
    ]
    calls = [tuple(shlex.split(line.partition(" > ")[0], comments=True)) for line in lines if line.startswith(PROGRAMS)]
    return [list(call) for call in dict.fromkeys(calls)]
