"""Run softness, nodule and kidney, and copy pictures of the runs: python docs/pictures/softness.py [folder]

softness.png          a fingerpad on soft tissue, inside and outside the range of Hertz's theory: `palpate run softness`
softness-nodule.png   a finger slides over a hard nodule, force and pins: `palpate run nodule`
afferents.png         spikes of the finger's afferents: `palpate run nodule --scene afferents`
softness-band.png     force of the kidney and of a measured subject: `palpate run kidney --set scene.finger.band=true`
energy.png            energy balance of the kidney: `palpate run kidney --set scene.energy.ledger=true`
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Any

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.views.pictures import draw_pictures

RUNS: dict[str, tuple[Any, ...]] = {
    "softness.png": ("softness", "softness", ()),
    "softness-nodule.png": ("nodule", "pins", ()),
    "softness-band.png": ("kidney", "force", ("scene.finger.band=true",)),
    "energy.png": ("kidney", "energy", ("scene.energy.ledger=true",)),
    "afferents.png": ("nodule", "afferents", (), "afferents"),
}
"""File -> graph, name of its picture, settings, and the scene if it is not the default."""


def main(folder: Path) -> list[Path]:
    """Run, draw, copy."""
    return copy_pictures(folder, RUNS)


def copy_pictures(folder: Path, runs: dict[str, tuple[Any, ...]]) -> list[Path]:
    """Run graphs and copy one picture of each; `runs` as `RUNS`. Returns the files."""
    folder.mkdir(parents=True, exist_ok=True)
    for target, (graph, picture, sets, *scene) in runs.items():
        with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
            file = Path(scratch) / f"{graph}.mcap"
            outcome = execute(
                find(graph).but(place="fused", record=file, overrides=sets, scene=next(iter(scene), None))
            )
            if not outcome.result.ok:
                raise SystemExit("\n".join(map(str, outcome.result.deaths)))
            made = {path.stem: path for path in draw_pictures(file, Path(scratch))}
            shutil.copyfile(made[picture], folder / target)
    return [folder / target for target in runs]


if __name__ == "__main__":
    from target import folder

    for written in main(folder(__doc__)):
        print(written)
