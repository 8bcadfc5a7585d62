"""Run the sliding fingertip at several angles, directions and speeds, and draw the paper's figures.

python docs/pictures/beam_bundle.py [folder]

beam-bundle-run.png      the picture that `palpate run fingertip-slide` draws: press, hold, slide and lift
beam-bundle-pad.png      the pad of this run, seen from below through the plate
beam-bundle-normal.png   normal force on the pad at three angles
beam-bundle-press.png    load, hold, unload at four speeds, with relaxation
beam-bundle-slide.png    friction over time: three angles, four directions, stick and slip
beam-bundle-local.png    localized displacement over time, two directions

Every curve is a run of the graph `fingertip-slide` with some settings changed, as with `--set`.
"""

from __future__ import annotations

import shutil
import tempfile
from functools import cache
from itertools import count
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Slip, Surface
from palpate.records.reader import Recording
from palpate.views.pictures import draw_pictures
from palpate.views.pictures.slip import slides
from palpate.views.pictures.touch import TouchStreams

NUMBER = count()
SCRATCH = tempfile.TemporaryDirectory(prefix="palpate-")


@cache
def run(*sets: str, duration: float = 3.0) -> TouchStreams:
    """Streams of one run; `sets`: settings of the scene's finger or of a node, as for `--set`."""
    file = Path(SCRATCH.name) / f"{next(NUMBER)}.mcap"
    overrides = [one if one.startswith("finger.") else f"scene.finger.{one}" for one in sets]
    launch = find("fingertip-slide").but(place="fused", record=file, overrides=overrides, duration=duration)
    outcome = execute(launch)
    if not outcome.result.ok:
        raise SystemExit("\n".join(map(str, outcome.result.deaths)))
    return TouchStreams(Recording(file))


def sliding(angle: float, direction: float = 90):
    """Time since sliding began [s], friction and normal force [N], phases of one run."""
    contact, friction, _, at = slides(run(f"angle='{angle} deg'", f"direction='{direction} deg'"))
    time = contact["time"] - contact["time"][at.begin]
    return time, np.linalg.norm(friction["force"], axis=1), contact["force"], at


def as_shipped(path: Path) -> None:
    """The pictures of a run."""
    touch = run(duration=5.0)
    made = {file.stem: file for file in draw_pictures(touch.recording.path, Path(SCRATCH.name))}
    shutil.copyfile(made["slip"], path)
    shutil.copyfile(made["pad"], path.with_name("beam-bundle-pad.png"))


def normal_force(path: Path) -> None:
    """Pressure on the pad, held for 1 s."""
    figure, all_axes = plt.subplots(1, 3, figsize=(12, 4.6), layout="constrained", sharey=True, sharex=True)
    pressures = []
    for angle in (20, 40, 60):
        touch = run(f"angle='{angle} deg'", "direction='90 deg'")
        tick = 1499
        slip, surface = touch.at(Slip, [tick])[tick], touch.at(Surface, [tick])[tick]
        cell = touch.contact["force"][tick] / surface.pressure.sum()
        pressures.append((angle, slip.points[surface.nodes] * 1e3, surface.pressure * cell * 1e3))
    largest = max(force.max() for _, _, force in pressures)
    for axes, (angle, (x, y), force) in zip(all_axes, ((a, p.T, f) for a, p, f in pressures), strict=True):
        shown = axes.scatter(x, y, c=force, s=95, marker="s", cmap="inferno", vmin=0, vmax=largest)
        axes.plot((x * force).sum() / force.sum(), (y * force).sum() / force.sum(), "w+", ms=12, mew=2)
        axes.set(aspect="equal", xlabel="across x [mm]", facecolor="0.93")
        axes.set_title(f"{angle}°: {force.sum() * 1e-3:.2f} N on {len(force)} beams")
    all_axes[0].set_ylabel("tip ← along y [mm] → hand")
    figure.colorbar(shown, ax=all_axes, label="normal force of a beam [mN]")
    figure.suptitle("Normal force at 2 mm, held 1 s (+ centre of pressure)")
    save(figure, path)


def press(path: Path) -> None:
    """Load, hold 4 s, unload, at the same speed in and out."""
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for speed in (0.25, 0.5, 1.0, 2.0):
        motion = f"press='{speed} mm/s'", f"lift='{speed} mm/s'", "hold='4 s'", "distance=0"
        contact = run(*motion, duration=4.5 + 4 / speed).contact
        axes.plot(contact["time"], contact["force"], label=f"{speed:g} mm/s")
    axes.set(xlabel="time [s]", ylabel="normal force [N]", title="Load, hold 4 s, unload at 20°, depth 2 mm")
    axes.set_ylim(bottom=0)
    axes.legend(title="loading and unloading")
    save(figure, path)


def friction(path: Path) -> None:
    """Friction over time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.8), layout="constrained")
    for angle, colour in ((20, "C0"), (40, "C1"), (60, "C2")):
        time, force, _, at = sliding(angle)
        left.plot(time, force, colour, label=f"{angle}°")
        left.plot(time[at.warned], force[at.warned], colour, marker="o", fillstyle="none")
        left.plot(time[at.gross], force[at.gross], colour, marker="o")
    left.plot([], [], "ko", fillstyle="none", label="warning: 10 % of the nodes slide")
    left.plot([], [], "ko", label="all nodes slide")
    left.set(title="Three angles, drawn back", xlabel="time since sliding began [s]", ylabel="friction [N]")
    for name, direction in (("X+", 0), ("X−", 180), ("Y+ (back)", 90), ("Y− (on)", -90)):
        time, force, normal, _ = sliding(40, direction)
        right.plot(time, force, label=name, linestyle="--" if "−" in name else "-", linewidth=2)
    right.plot(time, 0.7 * normal, "k:", label="0.7 × normal force")
    right.set(title="Four directions at 40°", xlabel="time since sliding began [s]", ylabel="friction [N]")
    for axes in (left, right):
        axes.set(xlim=(-0.1, 1.4), ylim=(0, 0.4))
        axes.legend(loc="lower right")
    save(figure, path)


def localized(path: Path) -> None:
    """Growth of slip into the contact, on a finer grid."""
    moments = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
    figure, grid = plt.subplots(2, len(moments), figsize=(16, 5.4), layout="constrained", sharex=True, sharey=True)
    for line, (name, direction) in zip(grid, (("back (Y+)", 90), ("across (X+)", 0)), strict=True):
        touch = run("angle='40 deg'", f"direction='{direction} deg'", "finger.pitch='0.6 mm'", duration=2.5)
        slips = touch.at(Slip, [1500 + round(1e3 * moment) for moment in moments])
        for axes, moment, slip in zip(line, moments, slips.values(), strict=True):
            touching = slip.state > 0
            (x, y), way = slip.points[touching].T * 1e3, slip.path[touching] * 1e3
            stuck = way == 0
            # Nodes at the rim bear little pressure and slip far, so the scale ends at the 90th percentile.
            most = np.percentile(way[~stuck], 90)
            shown = axes.scatter(x[~stuck], y[~stuck], c=way[~stuck], s=22, marker="s", cmap="turbo", vmin=0, vmax=most)
            axes.scatter(x[stuck], y[stuck], c="0.8", s=22, marker="s")
            figure.colorbar(shown, ax=axes, location="bottom", shrink=0.8)
            axes.set(aspect="equal", title=f"{moment:g} s, {slip.fraction * 100:.0f} % slides")
        line[0].set_ylabel(f"{name}, y [mm]")
    for axes in grid[1]:
        axes.set_xlabel("x [mm]")
    figure.suptitle("Localized displacement [mm] (grey: has not slipped; each map has its colour scale)")
    save(figure, path)


def save(figure, path: Path) -> None:
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(folder: Path) -> None:
    """Draw all."""
    folder.mkdir(parents=True, exist_ok=True)
    pictures = {"run": as_shipped, "normal": normal_force, "press": press, "slide": friction, "local": localized}
    for name, make in pictures.items():
        make(folder / f"beam-bundle-{name}.png")
        print(folder / f"beam-bundle-{name}.png")


if __name__ == "__main__":
    from target import folder

    main(folder(__doc__))
