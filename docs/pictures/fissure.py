"""Draw a finger that slides over the fissure of a liver: python docs/pictures/fissure.py [folder]

fissure.png   the surface at six instants of `palpate run kidney --organ liver.seg.nrrd --label liver`, of the mask of
              segmentation.py, with its front up and a slide from one lobe to the other
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from segmentation import write_labels

from palpate.launch.load.launchfile import find
from palpate.launch.load.organ_file import OrganFile
from palpate.launch.run.execute import execute
from palpate.views.surface import film

TIMES = (0.3, 0.8, 0.9, 1.0, 1.2, 1.6)  # [s]
SLIDE = (
    "scene.surface.rotation=[1.5708, 0, 0]",
    "scene.hand.begin=[-0.005, 0, 0.116]",
    "scene.hand.path=[{to: [-0.005, 0, 0.0945], time: 0.3}, {to: [0.05, 0, 0.091], time: 1.3, shape: linear}, "
    "{to: [0.05, 0, 0.116], time: 0.3}]",
)


def main(target: Path) -> list[Path]:
    """Write the mask, run the slide, draw."""
    target.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        mask, recording = Path(scratch) / "liver.seg.nrrd", Path(scratch) / "slide.mcap"
        write_labels(mask)
        organ = OrganFile(mask, label="liver")
        slide = find("kidney").but(organ=organ, place="fused", record=recording, duration=1.9, overrides=SLIDE)
        outcome = execute(slide)
        if not outcome.result.ok:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
        figure, axes = plt.subplots(2, 3, figsize=(15, 5.6), layout="constrained")
        for axis, time in zip(axes.flat, TIMES, strict=True):
            film.picture(recording, time, Path(scratch) / "instant.png")
            axis.imshow(plt.imread(Path(scratch) / "instant.png"))
            axis.set_axis_off()
        figure.savefig(target / "fissure.png", dpi=72)
    return [target / "fissure.png"]


if __name__ == "__main__":
    from target import folder

    for written in main(folder(__doc__)):
        print(written)
