"""Touches on the gallery page: under each graph, its folder of `palpate build web`, which a click loads.

python docs/site/touches.py            # builds the folders of all graphs that can be built, in docs/touches
python docs/site/touches.py kidney     # of one

The site has the touches that are in docs/touches when Sphinx runs; `./check.sh docs` builds none.
"""

import shutil
import sys
from pathlib import Path
from typing import Any

from docutils import nodes

HERE = Path(__file__).parents[1] / "touches"
PAGE = "gallery"
FRAME = (
    '<details class="touch"><summary>Touch it here</summary><iframe loading="lazy" src="touches/{name}/index.html" '
    'title="Touch {name} in the browser" style="width: 100%; height: 640px; border: 0"></iframe></details>'
)
"""A browser loads a lazy frame when it becomes visible."""
SPRINGS = ("use=deformation.MassSpring", "exponent=1", "damping=0")
COARSE = "vertices=2300"
STACK, SIDES = ("upper", "middle", "kidney"), ("upper-middle", "middle-upper", "middle-kidney", "kidney-middle")
LIGHT = {
    "neighbours": ("fast: springs", [f"{organ}.{each}" for organ in ("liver", "kidney") for each in SPRINGS]),
    "stack": (
        "fast: springs, coarse surfaces",
        [f"{organ}.{each}" for organ in STACK for each in (*SPRINGS, COARSE)]
        + [f"{node}-{organ}.{COARSE}" for organ in STACK for node in ("collision", "spread")]
        + [f"side-{side}.{COARSE}" for side in SIDES],
    ),
    "pinch-liver": (
        "fast: springs, coarse surfaces",
        [f"{organ}.{each}" for organ in ("tissue", "liver") for each in SPRINGS]
        + [f"scene.{surface}.{COARSE}" for surface in ("surface", "liver-surface")],
    ),
    "organs": (
        "fast: coarse surfaces, gap not bridged",
        [f"scene.{surface}.{COARSE}" for surface in ("surface", "liver-surface")]
        + [f"collision-{organ}.width=0" for organ in ("kidney", "liver")],
    ),
}
"""Runs of which a page would load more than 3 MB at first: it begins with these settings, under this name, and loads
the run itself when it is chosen as `EXACT`."""
EXACT = "exact: as palpate run"


def build_touches(names: list[str]) -> None:
    """Build the folders, each with the body of its graph. A graph that no page can run is reported with the reason."""
    from palpate.launch.load.launchfile import find
    from palpate.physics.errors import PalpateError
    from palpate.web.folder import build
    from palpate.web.variants import body_shown

    for name in names:
        shutil.rmtree(HERE / name, ignore_errors=True)
        try:
            launch = find(name)
            built = build(places(launch, name), HERE / name, [body_shown(launch)], lambda stage: lambda share: None)
        except PalpateError as error:
            print(f"{name}: no touch: {error}")
            continue
        print(f"{name}: {built.first / 1e6:.2f} MB at first, {built.whole / 1e6:.1f} MB in all")


def places(launch: Any, name: str) -> list[Any]:
    """What the page of a run offers: the run, after a lighter one where it is large."""
    from palpate.web.variants import Place

    if name not in LIGHT:
        return [Place(launch)]
    label, settings = LIGHT[name]
    return [Place(launch.but(overrides=settings), scene=label), Place(launch, scene=EXACT)]


def add_touches(app: Any, doctree: nodes.document) -> None:
    """Add the frame of each built touch to the end of its section."""
    if app.env.docname != PAGE:
        return
    for section in list(doctree.findall(nodes.section)):
        name = section.next_node(nodes.title).astext()
        if (HERE / name / "index.html").exists():
            section += nodes.raw("", FRAME.format(name=name), format="html")


def copy_touches(app: Any, error: Exception | None) -> None:
    """Copy the folders to the site."""
    if error is None and HERE.is_dir() and app.builder.format == "html":
        shutil.copytree(HERE, Path(app.outdir) / HERE.name, dirs_exist_ok=True)


def setup(app: Any) -> dict[str, bool]:
    """Entry point for Sphinx."""
    app.connect("doctree-read", add_touches)
    app.connect("build-finished", copy_touches)
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    sys.path.insert(0, str(HERE.parent))
    from gallery import runs

    build_touches(sys.argv[1:] or runs())
