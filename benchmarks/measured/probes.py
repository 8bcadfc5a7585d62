"""Maps of robot probes of a pig's liver and of silicone with two stiff balls.

    python benchmarks/measured/probes.py FOLDER [-o probes.png]

Reads pig_liver_20150826_region1.csv, pig_liver_20150826_v2_region1.csv and region_small_balls.csv: probe, x, y, z [mm],
nx, ny, nz, depth [mm], force [N]. The ball of the probe has a radius of 4.0 mm. The files are read as `fit map` does.
"""

from __future__ import annotations

from source import parser, table

from palpate.models.fit.probes.fit import fit_map
from palpate.models.fit.probes.report import lines, map_lines
from palpate.models.fit.tissue.rigs import Rig
from palpate.studies.presses import PressReader
from palpate.views.pictures.models.fit_map import stiffness

FILES = ("pig_liver_20150826_region1.csv", "pig_liver_20150826_v2_region1.csv", "region_small_balls.csv")


ROBOT = "https://github.com/vu-arma-dev/robot-palpation-data (2018, no licence)"


def main() -> None:
    given = parser(__doc__).parse_args()
    for name in FILES:
        table(given.folder, name, ROBOT, 9)
        probes = PressReader([], [], False).probes(given.folder / name)
        assert probes is not None
        found = fit_map(probes, Rig("ball", 4e-3), None)
        values = ", ".join(f"{key} {value:.4g}" for key, value in found.fit.values.items())
        print(f"{name}: {found.fit.law.name}, {values}")
        for text in [*lines(found.probes, found.fit)[1:], *map_lines(found)]:
            print(f"  {text}", flush=True)
        if given.out:
            place = given.out.with_stem(f"{given.out.stem}-{name.removesuffix('.csv')}")
            stiffness(found).savefig(place)
            print(f"  written {place}")


if __name__ == "__main__":
    main()
