"""Draw the pinch that lifts, carries and drops a kidney: python docs/pictures/lift.py [folder]

lift.png  the organ at five instants, place and rotation, forces: `palpate run pinch --scene lift`
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Force, unpack
from palpate.messages.tissue import Support
from palpate.nodes.support import GRAVITY
from palpate.records.reader import Recording
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.moments import bodies_of, instants_at

TICKS, FINGERS = (300, 950, 1650, 2650, 2920), ("thumb", "index")


def main(folder: Path) -> Path:
    """Run, draw."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="palpate-") as scratch:
        file = Path(scratch) / "lift.mcap"
        launch = find("pinch").but(scene="lift", place="fused", record=file, duration=4.0)
        organ = launch.load().nodes["foundation"].settings
        weight = GRAVITY * organ["mass"]
        outcome = execute(launch)
        if not outcome.result.ok:
            raise SystemExit("\n".join(map(str, outcome.result.deaths)))
        recording = Recording(file)
        touch = TouchStreams(recording, whole=True)
        shown = bodies_of(touch)
        moments = instants_at(touch, shown, list(TICKS))
        base = [unpack(payload, Support) for _, _, payload in recording.payloads("foundation")]
        hands = sum(
            np.array([unpack(p, Force).force for _, _, p in recording.payloads(f"controller-{finger}-world")])
            for finger in FINGERS
        )
        grip = recording.tables({"contact-index"})["contact-index"]["force"]
    figure = plt.figure(figsize=(9, 6.5), layout="constrained")
    grid = figure.add_gridspec(3, len(TICKS), height_ratios=(0.6, 1.0, 1.0))
    rest = shown.mesh.vertices
    for k, moment in enumerate(moments):
        axis = figure.add_subplot(grid[0, k])
        place = 1e3 * (rest + moment.displacement)
        axis.tripcolor(place[:, 1], place[:, 2], shown.mesh.triangles, place[:, 0], shading="gouraud", cmap="copper")
        axis.plot(*(1e3 * moment.tips[:, 1:]).T, "o", color="C0", markersize=9)
        axis.axhline(1e3 * rest[:, 2].min(), color="0.6")
        axis.set(title=f"{moment.time:.2f} s", aspect="equal", xlim=(-42, 46), ylim=(55, 125), xticks=[])
        if k:
            axis.set_yticklabels([])
        else:
            axis.set(ylabel="height [mm]")
    time = 1e-3 * np.arange(len(base))
    at, turn = (np.array([getattr(each, name) for each in base]) for name in ("displacement", "rotation"))
    places, forces = figure.add_subplot(grid[1, :]), figure.add_subplot(grid[2, :])
    for axis, label in ((0, "along the kidney"), (1, "along the grip"), (2, "up")):
        places.plot(time, 1e3 * at[:, axis], label=label)
    places.plot(time, np.degrees(np.linalg.norm(turn, axis=1)), ":", color="0.3", label="rotation [degrees]")
    places.axhline(1e3 * weight / organ["stiffness"], color="0.6", linestyle="--", label="leaves the foundation")
    places.set(ylabel="displacement [mm]")
    forces.plot(time[: len(grip)], grip, label="grip force")
    forces.plot(time[: len(hands)], -hands[:, 2], label="lift by both fingers")
    forces.axhline(weight, color="0.6", linestyle="--", label="weight")
    forces.set(ylabel="force [N]", xlabel="time [s]")
    for each in (places, forces):
        each.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=9)
        each.grid(alpha=0.3)
    figure.savefig(folder / "lift.png", dpi=110)
    return folder / "lift.png"


if __name__ == "__main__":
    from target import folder

    print(main(folder(__doc__)))
