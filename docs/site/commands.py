"""Reference pages of the commands, made from their argument parsers."""

import argparse
import html
import re
from collections.abc import Iterator

import collectors.cli
import svfl_data.cli
import svfl_models.cli

USAGE_WIDTH = 80  # columns of the usage lines


def command_pages() -> dict[str, str]:
    """Return the page of each program in Markdown, by the page's path in the site."""
    return {f"reference/{root.prog}.md": program_page(root) for root in roots()}


def roots() -> list[argparse.ArgumentParser]:
    """Return the parsers of the three programs."""
    return [module.build_parser() for module in (svfl_data.cli, svfl_models.cli, collectors.cli)]


def program_page(root: argparse.ArgumentParser) -> str:
    """Return the page of a program: a table of its commands, then a section for each command.

    Args:
        root: Parser of the program.
    """
    below = list(commands(root))
    rows = [f"| [`{words}`](#{words.replace(' ', '-')}) | {plain(purpose)} |" for words, purpose, _ in below]
    sections = [f"## `{words}`\n\n{section(parser)}" for words, _, parser in below]
    table = "\n".join(["| command | does |", "| --- | --- |", *rows])
    return "\n\n".join([f"# {root.prog}", section(root), table, *sections]) + "\n"


def commands(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Yield the words that call each command below a parser, its one-line help and its own parser."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            purposes = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, below in action.choices.items():
                yield below.prog, purposes.get(name, ""), below
                yield from commands(below)


def section(parser: argparse.ArgumentParser) -> str:
    """Return the description, usage, arguments and examples of one parser in Markdown."""
    parts = [plain(parser.description or ""), f"```text\n{usage(parser)}\n```"]
    parts += [argument(parser, action) for action in parser._actions if documented(action)]
    examples = [line.removeprefix("  ") for line in (parser.epilog or "").splitlines()[1:]]
    if examples:
        parts.append("\n".join(["```sh", *examples, "```"]))
    return "\n\n".join(part for part in parts if part)


def documented(action: argparse.Action) -> bool:
    """Tell whether an argument has an entry: all but ``--help`` and the choice of a command."""
    return not isinstance(action, argparse._HelpAction | argparse._SubParsersAction)


def usage(parser: argparse.ArgumentParser) -> str:
    """Return the usage of a parser in lines of `USAGE_WIDTH` columns."""
    formatter = argparse.HelpFormatter(parser.prog, width=USAGE_WIDTH)
    formatter.add_usage(parser.usage, parser._actions, parser._mutually_exclusive_groups, prefix="")
    return formatter.format_help().strip()


def argument(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Return the entry of a definition list for one argument: how it is written, and its help."""
    formatter = argparse.HelpFormatter(parser.prog, width=10 * USAGE_WIDTH)
    written = formatter._format_action_invocation(action)
    said = formatter._expand_help(action) if action.help else ""
    required = " Required." if action.required and action.option_strings else ""
    return f"`{written}`\n:   {plain(said)}{required}"


def plain(text: str) -> str:
    """Return text that Markdown shows as it is."""
    return re.sub(r"([\\`*_\[\]|#])", r"\\\1", html.escape(" ".join(text.split()), quote=False))
