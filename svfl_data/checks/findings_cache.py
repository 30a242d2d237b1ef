"""Cache of the findings of the checks, kept from one program to the next, because checking every image takes long.

An entry is the list of findings about a part of an episode. It is valid for the content of the episode (its seal) and
for the rules by which the episode was checked (the source text of the checks). The cache is the user's own. If it
cannot be read or written, the episode is checked again.
"""

import json
import sqlite3
from contextlib import closing, suppress
from types import TracebackType
from typing import Self

from svfl_data.checks.finding import Finding
from svfl_data.system.cache_folder import cache_folder, source_hash

RULES = ("checks", "schema", "signals/transforms.py", "symmetry.py")
"""Files and folders of this package whose code decides the findings."""
TABLE = "CREATE TABLE IF NOT EXISTS findings (rules, seal, part, findings, PRIMARY KEY (rules, seal, part))"
PATIENCE_S = 1.0
TROUBLE = (sqlite3.Error, OSError, ValueError, TypeError)
"""Exceptions that a full, damaged or locked cache raises."""


class FindingsCache:
    """Access to the stored findings inside a ``with`` block; new findings are stored when the block ends."""

    def __init__(self) -> None:
        self._new: list[tuple[str, str, str, str]] = []
        self._database: sqlite3.Connection | None = None

    def __enter__(self) -> Self:
        if folder := cache_folder("findings"):
            with suppress(*TROUBLE):
                self._database = sqlite3.connect(folder / "findings.sqlite3", timeout=PATIENCE_S)
                self._database.execute(TABLE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._database is None:
            return
        with closing(self._database), suppress(*TROUBLE):  # a failure costs only the time of checking again
            if self._new:
                self._database.execute("DELETE FROM findings WHERE rules != ?", (source_hash(*RULES),))
                self._database.executemany("INSERT OR REPLACE INTO findings VALUES (?, ?, ?, ?)", self._new)
                self._database.commit()

    def known(self, seal: str, part: str, name: str) -> list[Finding] | None:
        """Return the stored findings about a part of an episode; None if none are stored.

        Args:
            seal: Seal of the episode: the SHA-256 of its content, in hexadecimal.
            part: Part of the checks: ``streams``, or the name of a camera.
            name: Name of the episode to put into the findings.
        """
        question = "SELECT findings FROM findings WHERE rules = ? AND seal = ? AND part = ?"
        with suppress(*TROUBLE):
            row = self._database and self._database.execute(question, (source_hash(*RULES), seal, part)).fetchone()
            return [Finding(name, *found) for found in json.loads(row[0])] if row else None
        return None

    def keep(self, seal: str, part: str, findings: list[Finding]) -> None:
        """Remember the findings about a part of an episode, to store them when the ``with`` block ends.

        Args:
            seal: Seal of the episode: the SHA-256 of its content, in hexadecimal.
            part: Part of the checks: ``streams``, or the name of a camera.
            findings: Findings of this part; empty if there are none.
        """
        plain = [(found.field, found.index, found.severity, found.words) for found in findings]
        self._new.append((source_hash(*RULES), seal, part, json.dumps(plain)))
