"""The git commit of the source that this process runs, if it runs from a checkout.

Git is asked without letting the folder's own configuration start any program: no hooks, no file system monitor, no
filters, and nothing is fetched.
"""

import functools
import os
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("svfl_data", "svfl_models", "collectors")
TIMEOUT_S = 10.0
QUIET = ("--no-pager", "--no-optional-locks", "-c", "core.fsmonitor=false", "-c", f"core.hooksPath={os.devnull}")
OF_THE_FOLDER = ("local", "worktree")
"""Scopes of git's settings that come with a checkout, and not from the user or the system."""


@dataclass(frozen=True)
class Commit:
    """State of a checkout.

    Attributes:
        sha: Hash of the commit, in hexadecimal.
        clean: Whether the packages of this software are those of the commit: no file in their folders is changed,
            missing or new. None if git does not tell.
    """

    sha: str
    clean: bool | None


@functools.cache
def own_commit() -> Commit | None:
    """Return the commit of the source that this process runs; it is looked up once for each process.

    Returns:
        The commit, or None if the software was installed from a wheel, or git is missing or does not answer.
    """
    return commit_of(Path(__file__).resolve().parents[3])


def commit_of(root: Path) -> Commit | None:
    """Return the commit of a folder that holds the packages of this software.

    Args:
        root: The folder.

    Returns:
        The commit, or None if git does not have the packages under version control there. That they merely lie inside
        somebody's repository, as those of a virtual environment do, is not enough.
    """
    git = shutil.which("git")
    if git is None or _answer(git, root, "ls-files", "--error-unmatch", f"{PACKAGES[1]}/__init__.py") is None:
        return None
    sha = _answer(git, root, "rev-parse", "--verify", "HEAD")
    return Commit(sha.strip(), _is_clean(git, root)) if sha else None


def _is_clean(git: str, root: Path) -> bool | None:
    settings = _answer(git, root, "config", "--show-scope", "--name-only", "--get-regexp", r"^filter\.", codes=(0, 1))
    if settings is None or any(line.split()[0] in OF_THE_FOLDER for line in settings.splitlines() if line):
        return None  # git would run the folder's filters in order to compare files
    changed = _answer(
        git, root, "status", "--porcelain", "--untracked-files=all", "--ignore-submodules=all", "--", *PACKAGES
    )
    return None if changed is None else not changed


def _answer(git: str, root: Path, *words: str, codes: tuple[int, ...] = (0,)) -> str | None:
    """Return what git prints, or None if it fails or takes too long."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"LC_ALL": "C", "GIT_NO_LAZY_FETCH": "1", "GIT_ALLOW_PROTOCOL": "none", "GIT_TERMINAL_PROMPT": "0"}
    try:
        done = subprocess.run(
            [git, *QUIET, "-C", str(root), *words], env=environment, stdin=subprocess.DEVNULL, capture_output=True,
            text=True, errors="replace", timeout=TIMEOUT_S, check=False,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout if done.returncode in codes else None
