"""Slides across gaps and grooves: how fast the force on the hand changes, against the same body without them.

    python benchmarks/slides.py [SURFACE ...] [--body MassSpring] [--folds REACH] [--exact] [--json]

Surfaces are those of the zoo of `palpate bench organs` that have a gap across y = 0. For each the largest change of the
force on the hand in a tick, over 1.5 times that of the uncut body + 0.01 N, which is the limit; and the same for what
changes while the foot is less than `NEAR` from the middle of the gap. Beyond it slides begin and end: there the changes
are steps of the encoders of 10 to 20 um, which `--exact` leaves out. With `--folds` walls nearer than REACH [mm] touch.

The block is 24 mm thick, so the layers of BeamBundle are thinner and softer there by the same factor, which keeps their
compliance. A basis of ReducedFE that is not stored is built, for 20 to 60 s.
"""

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np

from palpate.bases import build_missing
from palpate.launch.run.progress import StageBars
from palpate.studies.organs.gaps import MM, layers_of
from palpate.studies.organs.runs import launch, run
from palpate.studies.organs.slides import FAR, LIGHT, MORE, largest_change, slide_touch
from palpate.studies.organs.touches import Setting, Touch
from palpate.studies.organs.widths import on
from palpate.studies.organs.zoo import GAPPED, USUAL

SURFACES = ("cut-0.5", "cut-2", "groove-4", "comb", "groove-8", "fissure")
WHOLE = {"fissure": "unfissured"}  # the body of the others is the block
SPEEDS, DEPTHS = (0.05, 0.1, 0.2), (4 * MM, 7 * MM, 9 * MM)  # [m/s], [m]
ASIDE = 0.3 * MM  # of the path from the plane of symmetry
NEAR = 0.95 * FAR  # [m]


def folds_of(reach: float) -> tuple[str, ...]:
    """The values of `--set` with which walls nearer than a reach [mm] touch; 0: none do."""
    return (f"scene.folds={{tissue: {{reach: {reach:g} mm}}}}", "scene.surface.spacing=0") if reach else ()


def changes(
    name: str, touches: list[Touch], folder: Path, silent: bool, more: tuple[str, ...] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Largest change of the force on the hand in a tick [N] of each touch, and the largest one near the gap [N]."""
    placed = [on(touch, name) for touch in touches]
    body = placed[0].setting.body
    extra = (*layers_of(body, name), *more)
    build_missing(launch(placed[0].setting, folder, placed[0].duration, extra).load(), silent)
    traces = run(placed, folder, extra=extra)[0]
    if traces.failed:
        raise SystemExit(f"slides: {body} on {name}: {next(iter(traces.failed.values()))}")
    each = np.linalg.norm(np.diff(traces["controller.force"], axis=1), axis=2)
    near = np.abs(traces["contact.foot"][:, 1:, 1]) < NEAR
    near &= np.arange(1, near.shape[1] + 1) < traces.ticks[:, None]  # a lane ends with its touch
    return largest_change(traces)[0], np.where(near, each, 0.0).max(axis=1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("surfaces", nargs="*", default=SURFACES)
    parser.add_argument("--body", default="MassSpring")
    parser.add_argument("--folds", type=float, default=0.0, metavar="REACH", help="[mm] of walls that touch")
    parser.add_argument("--exact", action="store_true", help="a device without encoder steps")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if unknown := [name for name in given.surfaces if name not in GAPPED]:
        parser.error(f"surface: found {unknown[0]!r}, expected one of {', '.join(GAPPED)}")
    setting = Setting("block", USUAL, given.body, friction="", width=16 * MM, exact=given.exact)
    touches = [slide_touch(setting, way, v, d, ASIDE) for v in SPEEDS for d in DEPTHS for way in (1.0, -1.0)]
    found: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder, StageBars(silent=given.json) as bars:
        report = bars.begin("slides")
        for k, name in enumerate(given.surfaces):
            report(k / len(given.surfaces), name)
            change, near = changes(name, touches, Path(folder), given.json, folds_of(given.folds))
            uncut, _ = changes(WHOLE.get(name, "block"), touches, Path(folder), given.json)
            limit = MORE * uncut + LIGHT
            found[name] = {
                "over the limit": float((change / limit).max()), "near the gap": float((near / limit).max()),
                "change [N]": float(change.max()), "of the uncut body [N]": float(uncut.max()),
            }  # fmt: skip
        report(1.0, "")
    if given.json:
        print(json.dumps({"body": given.body, "folds [mm]": given.folds, "exact": given.exact, "surfaces": found}))
        return
    for name, row in found.items():
        over, near, most, least = row.values()
        print(
            f"{name:10} {over:5.2f} of the limit, {near:4.2f} near the gap; at most {most:.3f} N in a tick, without it "
            f"{least:.3f} N"
        )


if __name__ == "__main__":
    main()
