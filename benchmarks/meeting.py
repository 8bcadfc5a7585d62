"""Two organs pressed together, by contact.Between, against full finite elements.

    python benchmarks/meeting.py [NAME ...] [--cells 160] [--vertices 10000] [--closest X] [--full] [--store] [--json]

Names: balls, ball-slab, ball-bowl, cylinders, blocks; by default those that are stored. Both organs are
deformation.ReducedFE, linear, without memory. Prints force and area over those of the reference, by closing of the
foundations, and the time of a tick of contact and bodies over that before the contact, and of the contact alone.

--closest  compares at closings up to X R, with a reference that is solved for it
--full   also solves the reference on both meshes again, with its time: two minutes a meeting
--store  the same, and stores it in src/palpate/studies/meeting/references.json
"""

import argparse
import json
import time
from dataclasses import replace
from typing import Any

import numpy as np

from palpate.launch.run.progress import StageBars
from palpate.nodes.deformation import ReducedFE
from palpate.physics.errors import ArgumentError
from palpate.studies.meeting import full, reduced, stored
from palpate.studies.meeting.solids import MEETINGS, Meeting
from palpate.studies.peers.continuum import BED, POISSON, YOUNG

MATERIAL = {"young": YOUNG, "poisson": POISSON, "bed": BED, "retardation": 0.0, "model": "linear"}
COARSE, FINE = 3, 4  # cells across the radius of contact
TICKS = 400


def measure(name: str, meeting: Meeting, right: dict[str, Any], cells: int, vertices: int) -> dict[str, Any]:
    """Ratios of a meeting to a reference, as of `stored.joined`, and the time of its ticks."""
    levels = np.array(right["closing"])
    closings = np.linspace(-1e-4, levels[-1], TICKS)
    found = reduced.run(meeting, ReducedFE, MATERIAL, closings, repeats=3, vertices=vertices, cells=cells)
    force, area, active = (np.interp(levels, closings, each) for each in (found.force, found.area, found.active))
    contact = reduced.run(
        meeting, ReducedFE, MATERIAL, closings, repeats=3, vertices=vertices, cells=cells, alone=True
    )  # fmt: skip
    change = np.abs(np.diff(found.force)).max() / np.abs(np.diff(found.force))[found.force[1:] > 0.1].mean()
    seconds = found.seconds.reshape(-1, TICKS)
    free = np.median(seconds[:, closings < 0.0])
    return {
        "meeting": name, "title": meeting.title, "closing/R": (levels / meeting.radius).round(3).tolist(),
        "force/reference": (force / np.array(right["force"])).round(4).tolist(),
        "area/reference": (area / np.array(right["area"])).round(4).tolist(),
        "force band": (np.array(right["force band"]) / np.array(right["force"])).round(4).tolist(),
        "area band": (np.array(right["area band"]) / np.array(right["area"])).round(4).tolist(),
        "active": active.round().astype(int).tolist(),
        "largest change of force a tick/mean": round(float(change), 2),
        **contact_times(contact),
        "tick [us]": round(1e6 * float(np.median(seconds[:, -TICKS // 4 :])), 1),
        "tick/tick before contact": round(float(np.median(seconds[:, -TICKS // 4 :]) / free), 2),
        "reference/tick": round(right["seconds"][1] / len(levels) / float(np.median(seconds))),
    }  # fmt: skip


def contact_times(contact: reduced.MeetingRun) -> dict[str, Any]:
    """Median times of the ticks of contact.Between alone with about 30 and 100 active candidates, also over that of a
    product of a matrix of as many rows with a vector by numpy."""
    seconds, found = contact.seconds.reshape(-1, TICKS), {}
    for count in (30, 100):
        near = np.abs(contact.active - count) <= 0.15 * count
        if not near.any():
            continue
        tick = float(np.median(seconds[:, near]))
        matrix, vector, peer = np.ones((count, count)), np.ones(count), []
        for _ in range(2000):
            begun = time.thread_time_ns()
            matrix @ vector
            peer.append(time.thread_time_ns() - begun)
        found[f"contact of {count} [us]"] = round(1e6 * tick, 1)
        found[f"contact of {count}/numpy product"] = round(tick / (1e-9 * float(np.median(peer))), 1)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--cells", type=int, default=160)
    parser.add_argument("--vertices", type=int, default=10000)
    parser.add_argument("--closest", type=float, metavar="X", help="[1] largest closing over R")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--store", action="store_true")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    if given.closest is not None and (given.store or not 0.0 < given.closest <= 0.5):
        parser.error("--closest: expected a number up to 0.5, without --store")
    solves = given.full or given.store or given.closest is not None
    kept = list(stored.references()) if stored.PATH.is_file() else []
    try:
        names = reduced.choose_meetings(given.names or (list(MEETINGS) if given.store else kept))
    except ArgumentError as error:
        parser.error(str(error))
    results = []
    with StageBars(silent=given.json) as bars:
        for name in names:
            meeting = MEETINGS[name]
            if given.closest is not None:
                meeting = replace(meeting, closest=given.closest)
            if solves:
                curves = []
                for cells in (COARSE, FINE):
                    done = bars.begin(f"{name}: full model, {cells} cells a radius", "")
                    curves.append(full.solve(meeting, cells, done))
                    done(1.0)
                if given.store:
                    stored.store({name: (curves[0], curves[1])})
            done = bars.begin(f"{name}: bodies", "", total=None)
            right = stored.reference(name) if given.closest is None else stored.joined(curves[0], curves[1])
            results.append(measure(name, meeting, right, given.cells, given.vertices))
            if given.full and given.closest is None:
                results[-1]["solved again/stored"] = np.max(np.abs(
                    curves[1].force / np.array(stored.reference(name)["force"])[: len(curves[1].force)] - 1.0
                ))  # fmt: skip
            done(1.0)
    if given.json:
        print(json.dumps(results, indent=1))
        return
    for found in results:
        print(f"{found['title']}: " + ", ".join(f"{k} {v}" for k, v in found.items() if not isinstance(v, list)))
        for key in ("closing/R", "force/reference", "force band", "area/reference", "area band", "active"):
            print(f"  {key:16}" + "".join(f"{v:9}" for v in found[key]))


if __name__ == "__main__":
    main()
