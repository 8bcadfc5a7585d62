"""Fit the example sessions and draw two pictures of the first subject: python docs/pictures/fit.py [folder]

fit-subject.png   force and scatter, the chosen curves and the band of a new session
fit-models.png    all five regressions of the force and of its scatter
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from palpate.models.fit.fit import fit_sessions, write_example
from palpate.views.pictures.models.fit import draw_choice

PICTURES = {"fit": "fit-subject.png", "models": "fit-models.png"}


def main(folder: Path) -> list[Path]:
    """Fit, draw, copy."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        sessions = Path(scratch) / "sessions.csv"
        write_example(sessions)
        fitted = fit_sessions(sessions, subjects=["A"], out=None, mean=None, deviation=None, folds=9, depth_limit=None)
        for path in draw_choice(fitted.chosen[0], Path(scratch) / "a"):
            name = PICTURES.get(path.stem.rpartition("-")[2])
            if name:
                shutil.copyfile(path, folder / name)
    return [folder / name for name in PICTURES.values()]


if __name__ == "__main__":
    from target import folder

    for written in main(folder(__doc__)):
        print(written)
