"""What the checks found in episodes, kept from one program to the next: looking at every image takes long.

A verdict holds for the content of an episode (its seal) and for the rules that it was judged by (the source text of the
checks), and is kept in the user's own cache. Wherever that fails, the episode is judged again.
"""

import json
import sqlite3
from contextlib import closing, suppress
from types import TracebackType
from typing import Self

from svfl_data.checks.finding import Finding
from svfl_data.system.cache_folder import cache_folder, source_hash

RULES = ("checks", "schema", "signals/transforms.py", "symmetry.py")
"""Files and folders of this package on which a verdict depends."""
TABLE = "CREATE TABLE IF NOT EXISTS verdict (rules, seal, part, findings, PRIMARY KEY (rules, seal, part))"
PATIENCE_S = 1.0
TROUBLE = (sqlite3.Error, OSError, ValueError, TypeError)
"""What a full, damaged or locked cache raises."""


class Verdicts:
    """The verdicts that are known, while the ``with`` block lasts; new ones are kept when it ends."""

    def __init__(self) -> None:
        self._new: list[tuple[str, str, str, str]] = []
        self._database: sqlite3.Connection | None = None

    def __enter__(self) -> Self:
        if folder := cache_folder("verdicts"):
            with suppress(*TROUBLE):
                self._database = sqlite3.connect(folder / "verdicts.sqlite3", timeout=PATIENCE_S)
                self._database.execute(TABLE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._database is None:
            return
        with closing(self._database), suppress(*TROUBLE):  # nothing is lost but time
            if self._new:
                self._database.execute("DELETE FROM verdict WHERE rules != ?", (source_hash(*RULES),))
                self._database.executemany("INSERT OR REPLACE INTO verdict VALUES (?, ?, ?, ?)", self._new)
                self._database.commit()

    def known(self, seal: str, part: str, name: str) -> list[Finding] | None:
        """The verdict on a part of an episode, None if there is none.

        Args:
            seal: Of the episode.
            part: Which part of the checks.
            name: What to call the episode in the findings.
        """
        question = "SELECT findings FROM verdict WHERE rules = ? AND seal = ? AND part = ?"
        with suppress(*TROUBLE):
            row = self._database and self._database.execute(question, (source_hash(*RULES), seal, part)).fetchone()
            return [Finding(name, *found) for found in json.loads(row[0])] if row else None
        return None

    def keep(self, seal: str, part: str, findings: list[Finding]) -> None:
        """Remember a verdict."""
        plain = [(found.field, found.index, found.severity, found.words) for found in findings]
        self._new.append((source_hash(*RULES), seal, part, json.dumps(plain)))
