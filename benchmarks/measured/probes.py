"""Maps of robot probes of a pig's liver and of silicone with two stiff balls.

    python benchmarks/measured/probes.py FOLDER [-o probes.png]

Reads pig_liver_20150826_region1.csv, pig_liver_20150826_v2_region1.csv and region_small_balls.csv: probe, x, y, z [mm],
nx, ny, nz, depth [mm], force [N]. The ball of the probe has a radius of 4.0 mm. The files are read as `fit map` does,
and fitted with its default law and with the other one. The picture has the first liver and the silicone.
"""

from __future__ import annotations

import numpy as np
from source import parser, table

from palpate.models.fit.probes.fit import EMPIRICAL, ProbeMap, fit_map
from palpate.models.fit.probes.report import lines, map_lines
from palpate.models.fit.tissue.rigs import Rig
from palpate.studies.presses import PressReader
from palpate.views.pictures import style
from palpate.views.pictures.models.fit_map import count_errors, paint_ratio

FILES = {
    "pig_liver_20150826_region1.csv": "liver",
    "region_small_balls.csv": "silicone with two stiff balls",
    "pig_liver_20150826_v2_region1.csv": "",
}
"""Title of each file in the picture, if it is drawn."""
ROBOT = "https://github.com/vu-arma-dev/robot-palpation-data (2018, no licence)"
LEAST = 30  # rows in a bin of the picture


def main() -> None:
    given = parser(__doc__).parse_args()
    drawn: dict[str, ProbeMap] = {}
    for name, title in FILES.items():
        table(given.folder, name, ROBOT, 9)
        probes = PressReader([], [], False).probes(given.folder / name)
        assert probes is not None
        best = fit_map(probes, Rig("ball", 4e-3), None)
        other = next(law for law in EMPIRICAL if law != best.fit.law.name)
        for found in (best, fit_map(probes, Rig("ball", 4e-3), other)):
            ends = {key: f"{low:.4g} to {high:.4g}" for key, (low, high) in found.fit.intervals.items()}
            values = ", ".join(f"{key} {value:.4g} ({ends[key]})" for key, value in found.fit.values.items())
            print(f"{name}: {found.fit.law.name}, {values}")
            for text in [*lines(found.probes, found.fit)[1:], *map_lines(found)]:
                print(f"  {text}")
            print(f"  criterion with 0, 1, 2 ... balls: {', '.join(f'{x:.1f}' for x in found.scores)}", flush=True)
        if title:
            drawn[title] = best
    if given.out:
        draw(given.out, drawn)


@style.look()
def draw(path, drawn: dict[str, ProbeMap]) -> None:
    """Rows: files. Columns: mean curve, map, errors on held-out probes. No single row or place is shown, since the
    measurements have no licence."""
    figure = style.figure(15.0, 3.9 * len(drawn), "Robot probes by a ball of 4 mm: law, map of stiffness, prediction")
    grid = figure.add_gridspec(len(drawn), 3, width_ratios=(1.0, 1.25, 1.1))
    for row, (title, found) in enumerate(drawn.items()):
        curve, place, error = (figure.add_subplot(grid[row, column]) for column in range(3))
        curves(curve, found)
        curve.set_title(f"{title}: {len(found.fit.place)} probes")
        curve.legend(loc="upper left")
        paint_ratio(place, found)
        place.set_title("map" + (" with the stiff balls found" if found.inclusions else ""))
        count_errors(error, found)
        error.set_title("errors on probes that were held out")
        error.set_ylim(top=1.35 * error.get_ylim()[1])
        error.legend(loc="upper left")
    figure.savefig(path)
    print(f"written {path}")


def curves(axes, found: ProbeMap) -> None:
    """Middle and spread of the rows over the depth from their touch points, over the stiffness of their places, and the
    law."""
    fit = found.fit
    mask = fit.rows.mask
    scale = np.exp(fit.shrunk) / fit.values[fit.first]
    depth = 1e3 * (fit.rows.depth - fit.touches[:, None])[mask]
    force = ((fit.rows.force - fit.zero[0]) / scale[:, None])[mask]
    edges = np.linspace(*np.quantile(depth, (0.01, 0.99)), 15)
    which = np.digitize(depth, edges)
    bins = [k for k in range(1, len(edges)) if np.count_nonzero(which == k) >= LEAST]
    low, middle, high = np.array([np.percentile(force[which == k], (10, 50, 90)) for k in bins]).T
    centres = np.array([depth[which == k].mean() for k in bins])
    axes.fill_between(centres, low, high, color=style.FAINT, alpha=0.5, linewidth=0,
                      label="80 % of the rows, over\nthe stiffness of their place")  # fmt: skip
    axes.plot(centres, middle, color=style.NORMAL, linewidth=0, marker="o", markersize=4, label="their median")
    smooth = np.linspace(0.0, centres[-1], 100)
    law = fit.force(float(np.log(fit.values[fit.first])), 0.0, 1e-3 * smooth) - fit.zero[0]
    axes.plot(smooth, law, color=style.FINGER, label=f"{fit.law.name}, fitted")
    axes.set(xlabel="depth after the fitted touch point [mm]", ylabel="force [N]")


if __name__ == "__main__":
    main()
