"""The forms of the functions that kernels take: laws of materials and shapes of rigid bodies."""

from __future__ import annotations

from numba import types

from palpate.physics.materials.compiled import LAW, MATRIX, VECTOR, compiled

__all__ = ["LAW", "SHAPE", "compiled"]

SHAPE = types.float64(VECTOR, VECTOR, VECTOR, MATRIX)
