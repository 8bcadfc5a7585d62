"""What a test needs that draws in three dimensions."""

from ctypes.util import find_library

import pytest

from palpate.views.surface.off_screen import CURE


def needs_drawing() -> None:
    """Skip where a package or the library for off-screen drawing is missing; where both are there, drawing works."""
    pytest.importorskip("pyvista", reason="pyvista is not installed (extra view)")
    if find_library("OSMesa") is None:
        pytest.skip(CURE)
