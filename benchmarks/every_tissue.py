"""Force of every body for every published tissue in every shipped graph that it fits, against deformation.ReducedFE.

    python benchmarks/every_tissue.py [kidney nodule ...] [--tissues liver-human ...] [--out every_tissue.json]

The touch of the graph, one lane for each tissue. Printed for each graph and contact: the tissue, peak force [N] and
largest indentation [mm] of ReducedFE, and for each body the difference of the peak and the RMS difference, in % of the
peak. The graph remote has the contact of the kidney, and no lanes.
`*`: the indentation exceeds 1.5 radii of the patch, where ReducedFE extrapolates and a run reports it.
"""

import argparse
import json
from pathlib import Path

import numpy as np

import palpate
from palpate.launch.load.tissues import tissues

GRAPHS = {  # bodies that scene.tissue sets, contacts
    **dict.fromkeys(("kidney", "nodule", "texture"), (("tissue",), ("contact",))),
    "organs": (("kidney",), ("contact-kidney",)),
    "pinch": (("tissue",), ("contact-thumb", "contact-index")),
    "palpate-two": (("tissue",), ("contact-1", "contact-2")),
}
RANGE = 12e-3  # [m] 1.5 radii of the patch of the scenes
BODIES = ("MassSpring", "BeamBundle")


def touch(graph: str, body: str, names: list[str]) -> dict[str, np.ndarray]:
    """Force [N] and indentation [m] (tissues, ticks) of each contact."""
    nodes, contacts = GRAPHS[graph]
    keep = [f"{contact}.{field}" for contact in contacts for field in ("force", "indentation")]
    sets = [f"{node}.use=deformation.{body}" for node in nodes]
    run = palpate.Ensemble(graph, len(names), {"scene.tissue": names}, keep, sets=sets, every=4).run(quiet=True)
    return {name: np.asarray(run[name]) for name in keep}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("graphs", nargs="*", default=list(GRAPHS))
    parser.add_argument("--tissues", nargs="*", default=list(tissues()[0]))
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rows = []
    for graph in given.graphs:
        reference = touch(graph, "ReducedFE", given.tissues)
        others = {body: touch(graph, body, given.tissues) for body in BODIES}
        for contact in GRAPHS[graph][1]:
            print(f"\n{graph}, {contact}\n\n| tissue | peak | depth | {' | | '.join(BODIES)} | |\n{7 * '|---'}|")
            for lane, name in enumerate(given.tissues):
                force, deepest = reference[f"{contact}.force"][lane], reference[f"{contact}.indentation"][lane].max()
                peak, row = force.max(), {"graph": graph, "contact": contact, "tissue": name}
                row |= {"peak": float(peak), "indentation": float(deepest)}
                cells = []
                for body, found in others.items():
                    own = found[f"{contact}.force"][lane]
                    rms = np.sqrt(np.mean((own - force) ** 2)) / peak
                    row[body] = {"peak": float(own.max() / peak - 1.0), "rms": float(rms)}
                    cells.append(f"{100 * row[body]['peak']:+.1f} | {100 * rms:.1f}")
                rows.append(row)
                mark = "*" if deepest > RANGE else ""
                print(f"| {name} | {peak:.3f} | {1e3 * deepest:.1f}{mark} | {' | '.join(cells)} |", flush=True)
            here = [row for row in rows if row["graph"] == graph and row["contact"] == contact]
            for body in BODIES:
                inside = [row[body]["peak"] for row in here if row["indentation"] <= RANGE]
                if inside:
                    print(
                        f"{body} within its range: {100 * min(inside):+.1f} to {100 * max(inside):+.1f} % of the peak"
                    )
    if given.out:
        given.out.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
