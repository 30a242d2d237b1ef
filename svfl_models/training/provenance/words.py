"""Provenance in words, for pages and the terminal; texts from files are made printable."""

from collections.abc import Sequence

from svfl_data.system.printable import markdown, printable
from svfl_models.training.provenance.session import DataRecord, Session

SHORT = 12
"""Digits of a hash, and most seeds, that are shown."""
LONGEST_COMMAND_SAID = 2000


def software(session: Session) -> str:
    """Return the commit and the package versions of a session in words."""
    state = {True: "clean", False: "not clean", None: "not known whether clean"}[session.clean]
    commit = f"commit {printable(session.commit[:SHORT])} ({state})" if session.commit else "no git commit"
    versions = ", ".join(
        f"{printable(name, 40)} {printable(version, 40)}" for name, version in session.packages.items()
    )
    return f"{commit}; {versions or 'unknown packages'}"


def machine(session: Session) -> str:
    """Return the host and the device of a session in words."""
    host = session.host
    known = (printable(host.processor, 100), f"{host.cores} cores" if host.cores else "", printable(host.system, 100))
    inside = ", ".join(part for part in known if part)
    device = session.device if session.device != host.processor else "the processor"
    computed = f"; computed on {printable(device, 100)}" if device else ""
    return f"{printable(host.name, 100) or 'unknown host'} ({inside or 'nothing known'}){computed}"


def data_words(name: str, one: DataRecord) -> str:
    """Return a dataset or file that was read in words.

    Args:
        name: Option that names it.
        one: The dataset or file.
    """
    sha256 = f"SHA-256 {printable(one.sha256[:SHORT])}" if one.sha256 else "could not be read"
    if one.episodes is None:
        return f"{printable(name, 40)}: {printable(one.path)}, {sha256}"
    unsealed = f", {one.unsealed} of them without a seal" if one.unsealed else ""
    over = f"{sha256} over the seals" if one.sha256 else sha256
    return f"{printable(name, 40)}: {printable(one.path)}, {one.episodes} episodes{unsealed}, {over}"


def lines(session: Session) -> list[str]:
    """Return a session in lines of text, the time first and the command last."""
    return [*_facts(session), f"command: {command(session)}"]


def command(session: Session) -> str:
    """Return the command line of a session in one line."""
    return printable(session.command, LONGEST_COMMAND_SAID)


def _facts(session: Session) -> list[str]:
    seeds = ", ".join(map(str, session.seeds[:SHORT])) + (", ..." if len(session.seeds) > SHORT else "")
    return [
        f"{printable(session.started, 40)} on {machine(session)}",
        software(session),
        *(data_words(name, one) for name, one in session.data.items()),
        *([f"seed {seeds}"] if seeds else []),
    ]


def section(own: Session | None, runs: Sequence[Sequence[Session]] = ()) -> str:
    """Return the section of a page on its provenance, in Markdown.

    Args:
        own: Session that made the page; None if the runs tell all.
        runs: Sessions of each run that the page reports on; none for a run that does not tell.
    """
    said = ["## Provenance", ""]
    if own is not None:
        said += [*(f"- {markdown(fact)}" for fact in _facts(own)), f"- command:\n\n      {command(own)}\n"]
    groups: dict[str, int] = {}
    for sessions in runs:
        alike = dict.fromkeys(f"{markdown(software(one))}; on {markdown(machine(one))}" for one in sessions)
        for words in alike or ["unknown provenance"]:
            groups[words] = groups.get(words, 0) + 1
    said += [f"- {count} {'run' if count == 1 else 'runs'}: {words}" for words, count in groups.items()]
    return "\n".join(said).rstrip() + "\n"
