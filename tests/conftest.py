"""What holds for all tests: on a slow or busy machine they take longer, and a cache of their own is left to nobody."""

import signal

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("svfl", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("svfl")

if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:  # a suite in the background: programs under test would ignore it
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SVFL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield
