"""Imported first by a study that shares code with the benchmarks: finds their modules."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
