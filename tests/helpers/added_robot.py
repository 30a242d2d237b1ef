"""A package beside this one that adds a simulated robot by an entry point."""

from pathlib import Path

import pytest

from collectors.robots import GROUP

ADDED = '''
from dataclasses import dataclass
from typing import Literal

from collectors.simulation import UR5eConfig


@dataclass(frozen=True)
class Slow(UR5eConfig):
    """A UR5e whose surface is smoother."""

    name: Literal["slow_sim"] = "slow_sim"
    friction: float = 0.8
'''


def install(folder: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Install the package for a test, and return the name of its robot; it also declares one that is not there.

    Args:
        folder: Folder to install it to.
        monkeypatch: What takes it away after the test.
    """
    (folder / "slow_package.py").write_text(ADDED)
    info = folder / "slow_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: slow-package\nVersion: 1.0\n")
    entries = "slow_sim = slow_package:Slow\ngone_sim = slow_package:Gone\npanda_sim = slow_package:Slow\n"
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{entries}")
    monkeypatch.syspath_prepend(folder)
    return "slow_sim"
