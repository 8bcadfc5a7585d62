"""Solvers that others wrote, and the references that one of them helps to make, are among the benchmarks."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[2] / "benchmarks"))
