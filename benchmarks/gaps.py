"""Force of presses over gaps and grooves narrower than the finger, with each body, against the block without them.

    python benchmarks/gaps.py [SURFACE ...] [--body BODY ...] [--folds REACH] [--json]

Surfaces are the cuts and grooves of the zoo of `palpate bench organs`: a block of 40 x 60 x 24 mm. A finger is pressed
13 mm deep, with an arm of 500 N/m, and held, at `PLACES` from the middle of the gap, with a width of 16 mm and as a
point. `collision alone` is the force on the whole block whose surface is lower by the depth to which a ball of the
finger's radius sinks in the gap. BeamBundle has the layers of `slides.py`, and `--folds` is as there. A basis of
ReducedFE that is not stored is built, for 20 to 60 s.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
from slides import folds_of

from palpate.bases import build_missing
from palpate.launch.run.progress import StageBars
from palpate.studies.organs.gaps import DEEP, GAPS, GROOVES, HIGH, MM, layers_of
from palpate.studies.organs.runs import launch
from palpate.studies.organs.touches import Setting
from palpate.studies.organs.widths import Ends, dip_of, on, press_touch
from palpate.studies.organs.zoo import USUAL

SURFACES = {f"cut-{gap:g}": gap * MM for gap in GAPS} | {f"groove-{width:g}": width * MM for width in GROOVES}
"""Width [m] of the gap of each."""
BODIES = ("MassSpring", "BeamBundle", "ReducedFE")
PLACES = (0.0, 1 * MM, 3 * MM, 8 * MM)  # [m] from the middle of the gap
DEPTH, WIDTH, X = 13.0 * MM, 16 * MM, 0.3 * MM  # [m]; x of the presses, off the plane of symmetry


def forces(
    body: str, surface: str, width: float, folder: Path, silent: bool, dip: float = 0.0, folds: float = 0.0
) -> list[float]:
    """Force [N] at the end of a press, `dip` [m] less deep, at each of `PLACES`."""
    setting = Setting("block", USUAL, body, friction="", width=width)
    down = np.array([0.0, 0.0, -1.0])
    touches = [on(press_touch(setting, np.array([X, y, 0.5 * HIGH]), down, DEPTH - dip), surface) for y in PLACES]
    extra = (*layers_of(body, surface), *folds_of(folds))
    build_missing(launch(touches[0].setting, folder, touches[0].duration, extra).load(), silent)
    ends = Ends(touches, folder, extra)
    if ends.traces.failed:
        raise SystemExit(f"gaps: {body} on {surface}: {next(iter(ends.traces.failed.values()))}")
    return [float(force) for force in ends.force]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", nargs="*", default=list(SURFACES))
    parser.add_argument("--body", nargs="+", default=BODIES, choices=BODIES)
    parser.add_argument("--folds", type=float, default=0.0, metavar="REACH", help="[mm] of walls that touch")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if unknown := [name for name in given.surfaces if name not in SURFACES]:
        parser.error(f"surface: found {unknown[0]!r}, expected one of {', '.join(SURFACES)}")
    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    with tempfile.TemporaryDirectory() as name, StageBars(silent=given.json) as bars:
        report, folder, done = bars.begin("gaps"), Path(name), 0
        for body in given.body:
            found[body] = {"block": {"finger [N]": forces(body, "block", WIDTH, folder, given.json)}}
            for surface in given.surfaces:
                report(done / (len(given.body) * len(given.surfaces)), f"{body}, {surface}")
                dip, done = dip_of(0.5 * WIDTH, 0.5 * SURFACES[surface], DEEP), done + 1
                found[body][surface] = {
                    "finger [N]": forces(body, surface, WIDTH, folder, given.json, folds=given.folds),
                    "point [N]": forces(body, surface, 0.0, folder, given.json, folds=given.folds),
                    "collision alone [N]": forces(body, "block", WIDTH, folder, given.json, dip)[:1],
                }  # fmt: skip
        report(1.0, "")
    if given.json:
        print(json.dumps({"places [m]": PLACES, "bodies": found}))
        return
    print("mm from the middle    " + "".join(f"{1e3 * y:6.0f}" for y in PLACES) + "   collision alone, at 0")
    for body, rows in found.items():
        for surface, row in rows.items():
            for kind in ("finger", "point"):
                if values := row.get(f"{kind} [N]"):
                    alone = row.get("collision alone [N]", []) if kind == "finger" else []
                    print(f"{body:11}{surface:10}{kind:7}" + "".join(f"{f:6.2f}" for f in [*values, *alone]))


if __name__ == "__main__":
    main()
