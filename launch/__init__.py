"""The launcher: load, check, plan, place, run, record, replay, and the command line."""

import palpate.physics  # noqa: F401  pins the arithmetic of this process and of those that it starts, before numpy
