"""Virtual environments with an installed wheel, whose programs run far from the source tree."""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

PIP = ("-m", "pip", "--disable-pip-version-check", "install", "--quiet")


class Installed:
    """A virtual environment into which a wheel is installed, and an empty folder to work in."""

    def __init__(self, environment: Path, work: Path) -> None:
        subprocess.run([sys.executable, "-m", "venv", environment], check=True)
        self.bin, self.work = environment / "bin", work
        self.work.mkdir()

    def borrow_libraries(self) -> None:
        """Make the libraries of this environment importable there, after its own; editable packages are not."""
        (site,) = self.bin.parent.glob("lib/python*/site-packages")
        ours = {path for path in sys.path if path.endswith("site-packages")} | {sysconfig.get_path("purelib")}
        (site / "libraries.pth").write_text("".join(f"{path}\n" for path in sorted(ours)))

    def run(self, *words: object) -> subprocess.CompletedProcess[str]:
        """Run a program of the environment, without the variables that lead Python to the source tree."""
        variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        command = [str(self.bin / str(words[0])), *map(str, words[1:])]
        return subprocess.run(command, cwd=self.work, env=variables, capture_output=True, text=True, check=False)

    def done(self, *words: object) -> str:
        """Run a program that must succeed; returns what it printed."""
        ended = self.run(*words)
        assert ended.returncode == 0, (words, ended.stdout, ended.stderr)
        return ended.stdout
