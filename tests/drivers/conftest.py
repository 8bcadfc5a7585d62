"""Property tests of bytes draw large inputs, so their deadline is disabled for busy machines."""

from hypothesis import HealthCheck, settings

settings.register_profile("bytes", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("bytes")
