"""The commit of a checkout: found without running anything of the folder, and never that of somebody else's."""

import os
import subprocess

import pytest

from svfl_models.training.provenance import commit
from svfl_models.training.provenance.commit import Commit, commit_of

IDENTITY = ("-c", "user.name=x", "-c", "user.email=x@example.org", "-c", "commit.gpgsign=false")


def git(folder, *words):
    """What git prints, of a repository that no setting of the machine changes."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    done = subprocess.run(
        ["git", *IDENTITY, "-C", str(folder), *words], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def sources(folder):
    for package in commit.PACKAGES:
        (folder / package).mkdir(parents=True)
        (folder / package / "__init__.py").write_text(f'"""{package}"""\n')
    (folder / "README.md").write_text("read me\n")
    (folder / ".gitignore").write_text("__pycache__/\n")
    return folder


@pytest.fixture
def checkout(tmp_path):
    """A checkout of packages named like ours, and the hash of its commit."""
    folder = sources(tmp_path / "checkout")
    git(folder, "init", "-q")
    git(folder, "add", "-A")
    git(folder, "commit", "-q", "-m", "one")
    return folder, git(folder, "rev-parse", "HEAD")


def test_a_clean_checkout(checkout):
    folder, sha = checkout
    assert commit_of(folder) == Commit(sha, True)


def _changed(folder):
    (folder / "svfl_data" / "__init__.py").write_text("other = 1\n")


def _new(folder):
    (folder / "collectors" / "new.py").write_text("")


def _gone(folder):
    (folder / "svfl_models" / "__init__.py").unlink()


def _staged(folder):
    _changed(folder)
    git(folder, "add", "-A")


@pytest.mark.parametrize("change", [_changed, _new, _gone, _staged])
def test_a_changed_package_is_said(checkout, change):
    folder, sha = checkout
    change(folder)
    assert commit_of(folder) == Commit(sha, False)


def test_what_is_no_source_does_not_count(checkout):
    folder, sha = checkout
    (folder / "README.md").write_text("other\n")
    (folder / "out").mkdir()
    (folder / "out" / "result.json").write_text("{}")
    (folder / "svfl_data" / "__pycache__").mkdir()
    (folder / "svfl_data" / "__pycache__" / "x.pyc").write_bytes(b"")
    assert commit_of(folder) == Commit(sha, True)


def test_a_second_worktree_has_its_own_commit(checkout, tmp_path):
    folder, sha = checkout
    git(folder, "worktree", "add", "-q", str(tmp_path / "second"), "-b", "second")
    _changed(tmp_path / "second")
    assert commit_of(tmp_path / "second") == Commit(sha, False)
    assert commit_of(folder) == Commit(sha, True)


def test_packages_in_a_folder_of_somebodys_repository_are_not_of_its_commit(tmp_path):
    mine = tmp_path / "mine"
    mine.mkdir()
    git(mine, "init", "-q")
    (mine / "notes.txt").write_text("mine\n")
    git(mine, "add", "-A")
    git(mine, "commit", "-q", "-m", "mine")
    assert commit_of(sources(mine / "environment" / "site-packages")) is None


def test_no_checkout_has_no_commit(tmp_path):
    assert commit_of(sources(tmp_path / "installed")) is None


def test_no_git_is_no_commit(checkout, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(checkout[0]) is None


def test_a_git_that_does_not_answer_is_no_commit(checkout, monkeypatch):
    def late(words, timeout, **_):
        raise subprocess.TimeoutExpired(words, timeout)

    monkeypatch.setattr(subprocess, "run", late)
    assert commit_of(checkout[0]) is None


def test_the_environment_names_no_other_repository(checkout, monkeypatch, tmp_path):
    folder, sha = checkout
    other = sources(tmp_path / "other")
    git(other, "init", "-q")
    git(other, "add", "-A")
    git(other, "commit", "-q", "-m", "another")
    monkeypatch.setenv("GIT_DIR", str(other / ".git"))
    monkeypatch.setenv("GIT_WORK_TREE", str(other))
    assert commit_of(folder) == Commit(sha, True)


def program(path, marker):
    path.write_text(f"#!/bin/sh\ntouch {marker}\ncat\n")
    path.chmod(0o755)
    return path


def test_nothing_that_the_folder_names_is_run(checkout, tmp_path):
    folder, sha = checkout
    marker = tmp_path / "ran"
    ours = program(tmp_path / "program", marker)
    for hook in ("post-index-change", "fsmonitor-watchman", "query-watchman"):
        program(folder / ".git" / "hooks" / hook, marker)
    for name in ("core.fsmonitor", "core.pager", "core.sshCommand", "diff.external", "core.editor"):
        git(folder, "config", name, str(ours))
    (folder / "svfl_data" / "__init__.py").touch()  # so that git compares the content
    assert commit_of(folder) == Commit(sha, True)
    assert not marker.exists()


@pytest.mark.parametrize("scope", ["--local", "--worktree"])
def test_where_the_folder_names_filters_nobody_asks_whether_it_is_clean(checkout, tmp_path, scope):
    folder, sha = checkout
    marker = tmp_path / "ran"
    git(folder, "config", "extensions.worktreeConfig", "true")
    git(folder, "config", scope, "filter.mine.clean", str(program(tmp_path / "filter", marker)))
    (folder / ".git" / "info" / "attributes").write_text("*.py filter=mine\n")
    _changed(folder)
    assert commit_of(folder) == Commit(sha, None)
    assert not marker.exists()


def test_a_checkout_without_a_commit_has_none(tmp_path):
    folder = sources(tmp_path / "new")
    git(folder, "init", "-q")
    git(folder, "add", "-A")
    assert commit_of(folder) is None
