"""Press the layered fingertip on both plates, and draw the results:

python docs/pictures/fingertip.py runs/fingertip [folder]

fingertip-force.png      force and contact area, with the paper's four points
fingertip-strain.png     strain in the plane of symmetry, deformed
fingertip-isostrain.png  growth of the isostrain volumes, and the volumes over strain and force
fingertip-flow.png       tactile flow on isostrain lines

The first folder contains the runs. Finished runs are read; computing all of them takes about an hour on one core.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.study.press_record import PressRun, record
from palpate.models.fe.study.pressing import Pressing
from palpate.views.pictures.models.fe_fingertip import draw

CELLS = 5


def press(finger: FingertipDimensions, plate: str, depth: float, folder: Path) -> PressRun:
    """The calibrated finger on a plate that rises by `depth` [m]."""
    run = PressRun(folder)
    record(Pressing(finger, plate, "calibrated"), depth, run)
    return run


def main(runs: Path, folder: Path) -> list[Path]:
    """Press, draw, copy."""
    folder.mkdir(parents=True, exist_ok=True)
    both = {
        plate: press(FingertipDimensions(cells=CELLS), plate, 2.4e-3, runs / f"{plate}-calibrated-{CELLS}-0.2")
        for plate in ("steel", "silicone")
    }
    made = []
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        for path in draw(both, Path(scratch)):
            made.append(folder / f"fingertip-{path.name}")
            shutil.copyfile(path, made[-1])
    return made


if __name__ == "__main__":
    place = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent
    for written in main(Path(sys.argv[1]), place):
        print(written)
