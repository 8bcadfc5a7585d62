"""Requirements of tests that draw in 3-D."""

from ctypes.util import find_library

import pytest

from palpate.views.surface.off_screen import CURE


def needs_drawing() -> None:
    """Skip if a package or the library for off-screen drawing is missing; with both, drawing must work."""
    pytest.importorskip("pyvista", reason="pyvista is not installed (extra view)")
    if find_library("OSMesa") is None:
        pytest.skip(CURE)
