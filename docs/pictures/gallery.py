"""Draw the pictures of the gallery, gallery-NAME.png, from runs of the shipped graphs with emulated devices.

A picture shows the surface at the deepest instant; without a surface, the first picture of the run; without pictures,
force and position over time.

python docs/pictures/gallery.py            # all
python docs/pictures/gallery.py nodule     # one
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from PIL import Image

from palpate.launch.load.launchfile import find, names
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Pose
from palpate.records.reader import Recording
from palpate.views.errors import PictureError
from palpate.views.pictures import draw_pictures
from palpate.views.run import Run
from palpate.views.surface.film import picture

FOLDER = Path(__file__).parent
WIDTH = 760  # [px]
LIVE = 6.0  # [s] of a run on the real clock


def drawn(name: str, folder: Path) -> Path:
    """Run a launch file and draw it; returns the picture."""
    launch, file = find(name), folder / f"{name}.mcap"
    hardware = [spec.name for spec in launch.load().nodes.values() if spec.cls.hardware]
    launch = launch.but(record=file, place="fused", overrides=tuple(f"{node}.port=emulator" for node in hardware))
    outcome = execute(launch.but(duration=LIVE) if hardware else launch)
    if not outcome.result.ok:
        raise SystemExit("\n".join(map(str, outcome.result.deaths)))
    recording, target = Recording(file), folder / f"{name}.png"
    touch, hand = recording.stream_of(Contact), recording.stream_of(Pose)
    try:
        if touch is not None:
            contact = recording.columns(touch)
            picture(file, float(contact["time"][contact["indentation"].argmax()]), target)
            return target
    except PictureError:
        pass
    made = {path.stem: path for path in draw_pictures(file, folder)}
    if not made:
        Run(file).plot(f"{touch}.force", f"{hand}.position").savefig(target)
    return next((made[name] for name in ("slip", "softness", *made) if name in made), target)


def shrink(source: Path, target: Path) -> None:
    """Reduce to the width of a page and 256 colours, including those of the bar."""
    with Image.open(source) as large:
        size = WIDTH, round(large.height * WIDTH / large.width)
        small = large.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        small.quantize(256, Image.Quantize.MAXCOVERAGE, kmeans=8).save(target, optimize=True)


def main(graphs: list[str]) -> None:
    for name in graphs or names():
        with tempfile.TemporaryDirectory() as folder:
            target = FOLDER / f"gallery-{name}.png"
            shrink(drawn(name, Path(folder)), target)
        print(f"{target}: {target.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    from target import parser

    given = parser(__doc__)
    given.add_argument("graphs", nargs="*", help="launch files; all if none is given")
    main(given.parse_args().graphs)
