"""Property tests of bytes draw large inputs; how long that takes says nothing on a busy machine."""

from hypothesis import HealthCheck, settings

settings.register_profile("bytes", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("bytes")
