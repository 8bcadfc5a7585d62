"""Draw kidney.png, the picture in the README, from a run of the shipped kidney.

python docs/pictures/kidney.py
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.views.pictures import draw_pictures

WIDTH = 1500  # [px]
TARGET = Path(__file__).with_name("kidney.png")


def main() -> None:
    """Run, draw, shrink."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        outcome = execute(find("kidney").but(place="fused", record=folder / "kidney.mcap"))
        if not outcome.result.ok or outcome.recording is None:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
        made = {path.stem: path for path in draw_pictures(outcome.recording, folder, print)}
        if "deformation" not in made:
            raise SystemExit(1)
        with Image.open(made["deformation"]) as picture:
            size = WIDTH, round(picture.height * WIDTH / picture.width)
            small = picture.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        palette = small.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=8)
        indexed = small.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG)
        colours = indexed.getpalette() or []
        corner = 3 * int(np.asarray(indexed)[0, 0])
        colours[corner : corner + 3] = [255, 255, 255]  # the background
        indexed.putpalette(colours)
        indexed.save(TARGET, optimize=True)
    print(f"{TARGET}: {TARGET.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    from target import parser

    parser(__doc__).parse_args()
    main()
