"""Slides across gaps and grooves: how fast the force on the hand changes, against the same body without them.

    python benchmarks/slides.py [SURFACE ...] [--body MassSpring] [--json]

Surfaces are those of the zoo of `palpate bench organs` that have a gap across y = 0. For each the largest change of the
force on the hand in a tick, over 1.5 times that of the uncut body + 0.01 N, which is the limit.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from palpate.launch.run.progress import StageBars
from palpate.studies.organs.gaps import MM
from palpate.studies.organs.runs import run
from palpate.studies.organs.slides import largest_change, slide_touch
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import on
from palpate.studies.organs.zoo import GAPPED, USUAL

SURFACES = ("cut-0.5", "cut-2", "groove-4", "comb", "groove-8", "fissure")
WHOLE = {"fissure": "unfissured"}  # the body of the others is the block
SPEEDS, DEPTHS = (0.05, 0.1, 0.2), (4 * MM, 7 * MM, 9 * MM)  # [m/s], [m]
ASIDE = 0.3 * MM  # of the path from the plane of symmetry


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", nargs="*", default=SURFACES)
    parser.add_argument("--body", default="MassSpring")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if unknown := [name for name in given.surfaces if name not in GAPPED]:
        parser.error(f"surface: found {unknown[0]!r}, expected one of {', '.join(GAPPED)}")
    setting = Setting("block", USUAL, given.body, friction="", width=16 * MM)
    touches = [slide_touch(setting, way, v, d, ASIDE) for v in SPEEDS for d in DEPTHS for way in (1.0, -1.0)]
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder, StageBars(silent=given.json) as bars:

        def changes(name: str) -> np.ndarray:
            traces = run([on(touch, name) for touch in touches], Path(folder))[0]
            if traces.failed:
                raise SystemExit(f"slides: {given.body} on {name}: {next(iter(traces.failed.values()))}")
            return largest_change(traces)[0]

        report = bars.begin("slides")
        for k, name in enumerate(given.surfaces):
            report(k / len(given.surfaces), name)
            change, uncut = changes(name), changes(WHOLE.get(name, "block"))
            over = float((change / (1.5 * uncut + 0.01)).max())
            most, least = float(change.max()), float(uncut.max())
            found[name] = {"over the limit": over, "change [N]": most, "of the uncut body [N]": least}
        report(1.0, "")
    if given.json:
        print(json.dumps({"body": given.body, "surfaces": found}))
        return
    for name, row in found.items():
        over, most, least = row.values()
        print(f"{name:10} {over:5.2f} of the limit, at most {most:.3f} N in a tick; without it {least:.3f} N")


if __name__ == "__main__":
    main()
