"""What holds for all tests: on a slow or busy machine they take longer, and a cache of their own is left to nobody."""

import os
import signal

import pytest
from hypothesis import HealthCheck, settings

from tests.helpers.partial_installation import ask_for_partial, skip_for_want_of_a_library
from tests.helpers.refusals import refused  # noqa: F401 - a fixture
from tests.helpers.small_disk import disk  # noqa: F401 - a fixture

settings.register_profile("svfl", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("svfl")

# A suite in the background or under nohup ignores what it is sent, and so would the programs under test.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_addoption(parser):
    ask_for_partial(parser)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector):
    report = yield
    skip_for_want_of_a_library(collector, report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item):
    report = yield
    skip_for_want_of_a_library(item, report)
    return report


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    """One for all workers of a run, which would otherwise each compile and compute the same."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    folder.mkdir(mode=0o700, exist_ok=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SVFL_CACHE_DIR", str(folder))
        yield
