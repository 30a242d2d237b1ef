"""What all tests share: a cache of their own, so that none is left to the next run or to the user."""

import pytest


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SVFL_CACHE_DIR", str(tmp_path_factory.mktemp("cache")))
        yield
