"""What holds for all tests: on a slow or busy machine they take longer, and that is all."""

from hypothesis import HealthCheck, settings

settings.register_profile("svfl", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("svfl")
