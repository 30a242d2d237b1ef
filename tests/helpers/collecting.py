"""Running ``svfl-collect`` as a program."""

import subprocess
import sys
from pathlib import Path

from tests.helpers.patience import PATIENCE

ROOT = Path(__file__).parents[2]


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-c", "from collectors.cli import main; raise SystemExit(main())", *map(str, arguments)]


def collect(*arguments: object, **kwargs) -> subprocess.CompletedProcess:
    return subprocess.run(command(*arguments), cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, **kwargs)


def contents(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, with folders inside, but for the index, which whoever reads the folder may write."""
    files = [file for file in sorted(folder.rglob("*")) if file.is_file() and file.name != "index.jsonl"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}
