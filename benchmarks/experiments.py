"""Coverage of the 95 % intervals of `palpate experiment --analyse`, for the shipped designs and others:

python benchmarks/experiments.py [sessions] [first session]

Each session is run by an observer of known threshold that answers by the level; its design chooses the levels as in a
real session. An interval with an open end contains everything beyond.
"""

from __future__ import annotations

import math
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from simulated_sessions import DESIGNS, Sessions


def main(sessions: int = 200, first: int = 1000) -> None:
    print(f"{'design':28s} threshold  median  contained  open  too high, too low")
    with tempfile.TemporaryDirectory() as folder:

        def write(name: str, text: str) -> Path:
            Path(folder, name).write_text(text, encoding="utf-8")
            return Path(folder, name)

        for design in DESIGNS:
            one = Sessions(design, write)
            truth, found = one.settings.threshold, one.estimates(range(first, first + sessions))
            assert truth is not None
            middle = sorted(each.value for each in found)[len(found) // 2]
            unbounded = sum(not math.isfinite(each.high) or each.low in (0.0, -math.inf) for each in found)
            sides = sum(each.low > truth for each in found), sum(each.high < truth for each in found)
            print(f"{design:28s} {truth:9g} {middle:7.4g} {one.covered(found):6d}/{sessions} {unbounded:5d} "
                  f"{sides[0]:5d}, {sides[1]}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
