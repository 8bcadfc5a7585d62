"""Pictures of the beam bundle fingertip, as the paper shows them: python docs/pictures/beam_bundle.py [folder]

beam-bundle-normal.png   normal force on the pad at three angles
beam-bundle-press.png    load, hold, unload at three speeds, with relaxation
beam-bundle-slide.png    friction over time: three angles, four directions, stick and slip
beam-bundle-local.png    localized displacement over time, two directions
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

from palpate.physics.anatomy import Anatomy
from palpate.physics.beam_bundle import Bundle, State, step
from palpate.physics.fingertip import fill

DEPTH, FRICTION, SPEED = 2e-3, 0.7, 2e-3
DT = 2e-3
TIP = Anatomy().fingertip()


def bundle(angle: float, pitch: float = 1.2e-3) -> Bundle:
    """The default anatomy at an angle [deg]."""
    return fill(TIP, DEPTH, pitch, np.radians(angle))


def pressed(body: Bundle, hold: float = 1.0) -> State:
    """Pressed in half a second and held."""
    state = State(body)
    for depth in np.linspace(0, DEPTH, round(0.5 / DT)):
        step(body, state, depth, (0, 0), FRICTION, DT)
    for _ in range(round(hold / DT)):
        step(body, state, DEPTH, (0, 0), FRICTION, DT)
    return state


def slide(body: Bundle, direction: float, seconds: float = 1.6):
    """Friction [N] along the slide, share of nodes that slip, normal force, and localized displacement by time."""
    state = pressed(body)
    way = SPEED * DT * np.array([np.cos(direction), np.sin(direction)])
    rows, paths = [], []
    for _ in range(round(seconds / DT)):
        force = step(body, state, DEPTH, (way[0], way[1]), FRICTION, DT)
        along = -(force[0] * np.cos(direction) + force[1] * np.sin(direction))
        rows.append((along, state.summary[1] / state.summary[0], force[2]))
        paths.append(state.path.copy())
    return DT * np.arange(1, len(rows) + 1), np.array(rows), np.array(paths)


def dots(axes, body: Bundle, values, **more):
    """The pad's nodes coloured by a value."""
    found = axes.scatter(body.points[:, 0] * 1e3, body.points[:, 1] * 1e3, c=values, s=95, marker="s", **more)
    axes.set(aspect="equal", xlabel="across x [mm]", facecolor="0.93")
    return found


def normal_force(path: Path) -> None:
    """Where the pad carries how much."""
    figure, all_axes = plt.subplots(1, 3, figsize=(12, 4.6), layout="constrained", sharey=True, sharex=True)
    largest = 0.0
    found = []
    for angle in (20, 40, 60):
        body = bundle(angle)
        state = pressed(body)
        largest = max(largest, state.normal.max())
        found.append((angle, body, state))
    for axes, (angle, body, state) in zip(all_axes, found, strict=True):
        shown = dots(axes, body, state.normal * 1e3, cmap="inferno", vmin=0, vmax=largest * 1e3)
        centre = (body.points * state.normal[:, None]).sum(axis=0) / state.normal.sum() * 1e3
        axes.plot(*centre, "w+", markersize=12, markeredgewidth=2)
        axes.set_title(f"{angle}°: {state.normal.sum():.2f} N on {len(body.heights)} beams")
    all_axes[0].set_ylabel("tip ← along y [mm] → hand")
    figure.colorbar(shown, ax=all_axes, label="normal force of a beam [mN]")
    figure.suptitle("Normal force at 2 mm, held 1 s (+ centre of pressure)")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def press(path: Path) -> None:
    """Load, hold, unload."""
    body = bundle(20)
    figure, axes = plt.subplots(figsize=(8, 4.5), layout="constrained")
    for speed in (0.25e-3, 0.5e-3, 1e-3, 2e-3):
        ramp = np.linspace(0, DEPTH, round(DEPTH / speed / DT) + 1)[1:]
        depth = np.concatenate([ramp, np.full(round(4 / DT), DEPTH), ramp[::-1], np.zeros(round(0.5 / DT))])
        state = State(body)
        force = [step(body, state, d, (0, 0), FRICTION, DT)[2] for d in depth]
        axes.plot(DT * np.arange(1, len(force) + 1), force, label=f"{speed * 1e3:g} mm/s")
    axes.set(
        xlabel="time [s]", ylabel="normal force [N]", title="Load, hold 4 s, unload at 20°, depth 2 mm", ylim=(0, None)
    )
    axes.legend(title="loading and unloading")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def friction(path: Path) -> None:
    """Friction over time."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 4.8), layout="constrained")
    for angle, colour in ((20, "C0"), (40, "C1"), (60, "C2")):
        time, rows, _ = slide(bundle(angle), np.pi / 2)
        left.plot(time, rows[:, 0], colour, label=f"{angle}°")
        all_slip = np.argmax(rows[:, 1] == 1)
        first = np.argmax(rows[:, 1] >= 0.1)
        left.plot(time[first], rows[first, 0], colour, marker="o", fillstyle="none")
        left.plot(time[all_slip], rows[all_slip, 0], colour, marker="o")
    left.plot([], [], "ko", fillstyle="none", label="a tenth of the nodes slips")
    left.plot([], [], "ko", label="every node slips")
    left.set(title="Three angles, drawn back", xlabel="time since sliding began [s]", ylabel="friction [N]")
    left.legend()
    body = bundle(40)
    for name, direction in (("X+", 0), ("X−", np.pi), ("Y+ (back)", np.pi / 2), ("Y− (on)", -np.pi / 2)):
        time, rows, _ = slide(body, direction)
        right.plot(time, rows[:, 0], label=name, linestyle="--" if "−" in name else "-", linewidth=2)
    right.plot(time, FRICTION * rows[:, 2], "k:", label="μ times normal force")
    right.set(title="Four directions at 40°", xlabel="time since sliding began [s]", ylabel="friction [N]")
    right.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)


def localized(path: Path) -> None:
    """How slip eats into the contact."""
    moments = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
    figure, grid = plt.subplots(2, len(moments), figsize=(16, 5.4), layout="constrained", sharex=True, sharey=True)
    body = fill(TIP, DEPTH, 0.6e-3, np.radians(40))
    for line, (name, direction) in zip(grid, (("back (Y+)", np.pi / 2), ("across (X+)", 0.0)), strict=True):
        _, rows, paths = slide(body, direction, moments[-1] + DT)
        for axes, moment in zip(line, moments, strict=True):
            k = round(moment / DT) - 1
            path_mm = paths[k] * 1e3
            stuck = path_mm == 0
            # Lone nodes of the rim, which no triangle holds, run ahead of the skin: the scale leaves them out.
            most = np.percentile(path_mm[~stuck], 90)
            shown = axes.scatter(body.points[~stuck, 0] * 1e3, body.points[~stuck, 1] * 1e3, c=path_mm[~stuck], s=22,
                                 marker="s", cmap="turbo", vmin=0, vmax=most)  # fmt: skip
            axes.scatter(body.points[stuck, 0] * 1e3, body.points[stuck, 1] * 1e3, c="0.8", s=22, marker="s")
            figure.colorbar(shown, ax=axes, location="bottom", shrink=0.8)
            axes.set(aspect="equal", title=f"{moment:g} s, {rows[k, 1] * 100:.0f} % slip")
        line[0].set_ylabel(f"{name}, y [mm]")
    for axes in grid[1]:
        axes.set_xlabel("x [mm]")
    figure.suptitle("Localized displacement [mm] (grey: has not slipped; a colour scale to each map)")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def main(folder: Path) -> None:
    """Draw all four."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in (("normal", normal_force), ("press", press), ("slide", friction), ("local", localized)):
        draw(folder / f"beam-bundle-{name}.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
