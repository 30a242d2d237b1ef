"""Tests of an installation that lacks some extras: what fails for want of an absent library is skipped, on demand only.

Without ``--partial`` a missing library is a failure, so that a complete environment cannot lose tests unnoticed.
"""

import importlib.util
import re

SAID = re.compile(r"No module named '(\w+)|needs (\w+), which is not installed")


def ask_for_partial(parser):
    parser.addoption("--partial", action="store_true", help="skip tests that fail for want of a library that is absent")


def skip_for_want_of_a_library(node, report):
    """Turn a failure that names an absent library into a skip."""
    if not (report.failed and node.config.getoption("--partial")):
        return
    named = {library or other for library, other in SAID.findall(str(report.longrepr))}
    if absent := sorted(library for library in named if importlib.util.find_spec(library) is None):
        report.outcome = "skipped"
        report.longrepr = (str(node.path), 0, f"Skipped: {', '.join(absent)} not installed")
