"""Recordings: their file format, reading, replay, check, comparison, repair, export."""

import palpate.physics  # noqa: F401  pins the arithmetic, before numpy
