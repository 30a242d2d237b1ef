"""What git tracks of the project, as it stands in the work tree."""

import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[2]


def tracked(*folders: str) -> list[str]:
    """Names of the tracked files that exist, all or those below some folders, relative to the project."""
    words = ["git", "ls-files", "-z", "--", *folders]
    said = subprocess.run(words, cwd=ROOT, capture_output=True, check=True).stdout
    return [name for name in said.decode().split("\0") if name and (ROOT / name).is_file()]
