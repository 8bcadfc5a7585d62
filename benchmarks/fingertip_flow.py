"""Pictures of one run of the FE fingertip, or of two side by side, as in Figures 3 to 5 of the tactile-flow paper.

    python benchmarks/fingertip_flow.py RUN [RUN] [-o runs/fingertip]

RUN is a folder that `palpate build fe fingertip` has written. Also prints which statements of the paper on both plates
hold, if a run on steel and one on silicone are given. Needs the extra `view`.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from fingertip_claims import HIGH, LOW, at_depth, statements
from fingertip_sections import cross, finger, flow, section, smooth

from palpate.models.fe.meshing.fingertip import PAPER
from palpate.models.fe.study.isostrain import strain, volumes_above
from palpate.models.fe.study.press_record import PressRun, check_pair
from palpate.models.fe.study.pressing import SIDES
from palpate.physics.contact.tactile import growth
from palpate.views.pictures.style import FAINT, FRICTION, INK, NORMAL, deformation_colours, figure, look

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = {"steel": NORMAL, "silicone": FRICTION}
LEVELS = np.linspace(0.02, 0.5, 25)  # equivalent strains of the isostrain pictures
SHEET = 0.06  # lowest strain in the 3-D plot of volumes; volumes at lower strains would hide the rest
LINES = (0.05, 0.1, 0.2, 0.3)  # isostrain lines with arrows of the flow
TOP = 0.7  # [N] limit of the force axes


@look()
def draw(runs: dict[str, PressRun], folder: Path) -> list[Path]:
    """Draw runs, one per plate ("steel", "silicone"), into a folder: force.png, strain.png, and if the runs reach the
    paper's forces isostrain.png and flow.png.

    ModuleNotFoundError: no matplotlib. ArgumentError: a run cannot be read.
    """
    pictures = {"force.png": force, "strain.png": strains}
    if all(run.record().force[-1] >= HIGH for run in runs.values()):
        pictures |= {"isostrain.png": isostrain, "flow.png": flows}
    made = []
    for name, picture in pictures.items():
        picture(runs).savefig(folder / name, bbox_inches="tight")
        made.append(folder / name)
    return made


def force(runs: dict[str, PressRun]) -> Figure:
    """Force against indentation, with the paper's points, and contact area against force."""
    fig, (left, right) = _axes(2, 11.0, 4.6, "Force and contact area")
    records = {plate: run.record() for plate, run in runs.items()}
    top = reached = min(TOP, 1.05 * max(float(record.force[-1]) for record in records.values()))
    for plate, record in records.items():
        colour = COLOURS[plate]
        left.plot(1e3 * record.indentation, record.force, color=colour, label=plate)
        right.plot(record.force, 1e6 * record.area, color=colour, label=plate)
        depths, forces = [1e3 * d for _, d in PAPER[plate]], [f for f, _ in PAPER[plate]]
        left.plot(depths, forces, "o", mfc="white", mec=colour, mew=1.8, ms=7, zorder=5,
                  label=f"{plate}, the paper's Table III")  # fmt: skip
        top = max(top, 0.55)
    left.set(xlabel="indentation [mm]", ylabel="force [N]", ylim=(0, top), xlim=(0, None))
    within = max(1e6 * float(np.interp(reached, r.force, r.area)) for r in records.values())
    right.set(xlabel="force [N]", ylabel="contact area [mm²]", xlim=(0, reached), ylim=(0, 1.08 * within))
    for axis in (left, right):
        axis.legend()
    return fig


def strains(runs: dict[str, PressRun]) -> Figure:
    """Strain in the plane of symmetry, deformed, at the same indentation of all runs and on one scale."""
    depth = min(float(run.record().indentation[-1]) for run in runs.values())
    cuts = {}
    for plate, run in runs.items():
        mesh = run.mesh()
        u = between(run, run.record().indentation, depth)
        solid = finger(mesh)
        cuts[plate] = section(mesh, u, smooth(solid, strain(solid, u)))
    top = np.ceil(20 * max(np.percentile(cut.values, 99.7) for cut in cuts.values())) / 20
    title = f"Strain in the middle of the finger at {1e3 * depth:.2f} mm"
    fig, axes = _axes(len(runs), 5.0 * len(runs) + 0.8, 4.7, title)
    fig.set_layout_engine("compressed")
    for axis, (plate, cut) in zip(axes, cuts.items(), strict=True):
        shown = _filled(axis, cut.triangles, cut.values, top)
        _shape(axis, cut, plate, depth)
        load = at_depth(runs[plate].record(), depth)
        axis.set_title(f"{plate}, {load:.2g} N")
    fig.colorbar(shown, ax=list(axes), label="equivalent strain", shrink=0.8, pad=0.015, extend="max")
    return fig


def isostrain(runs: dict[str, PressRun]) -> Figure:
    """Growth of the isostrain volumes between the paper's two forces, and the volumes over strain and force."""
    fig = figure(11.0, 4.8, "Isostrain volumes: tissue strained at least that much")
    left = fig.add_subplot(1, 2, 1)
    right: Any = fig.add_subplot(1, 2, 2, projection="3d")
    for plate, run in runs.items():
        forces, volumes = _volumes(run)
        low, high = (np.array([np.interp(f, forces, v) for v in volumes.T]) for f in (LOW, HIGH))
        left.plot(LEVELS, 1e9 * growth(low, high, LOW, HIGH), "o-", ms=4, color=COLOURS[plate], label=plate)
        steps = np.linspace(0.0, HIGH, 26)
        shown = LEVELS >= SHEET
        sheet = np.stack([np.interp(steps, forces, v) for v in volumes[:, shown].T], axis=1)
        x, y = np.meshgrid(LEVELS[shown], steps)
        right.plot_surface(x, y, 1e9 * sheet, color=COLOURS[plate], alpha=0.15, shade=False)
        right.plot_wireframe(x, y, 1e9 * sheet, color=COLOURS[plate], rstride=5, cstride=2, linewidth=1.0)
    left.set(xlabel="equivalent strain", ylabel="ΔV/ΔP [mm³/N]", xlim=(0, None), ylim=(0, None))
    left.set_title(f"growth of the volume from {LOW:g} to {HIGH:g} N")
    left.legend()
    right.set(xlabel="equivalent strain", ylabel="force [N]", zlabel="volume [mm³]", xlim=(0.5, SHEET), ylim=(0, HIGH))
    right.set(xticks=(0.1, 0.2, 0.3, 0.4), yticks=(0.1, 0.2, 0.3, 0.4, 0.5))
    right.view_init(elev=22, azim=-128)
    right.set_box_aspect((1.2, 1.05, 0.8), zoom=0.95)
    return fig


def flows(runs: dict[str, PressRun]) -> Figure:
    """Isostrain lines in the plane of symmetry midway between the paper's two forces, and their velocity."""
    from matplotlib.collections import LineCollection

    title = f"Tactile flow from {LOW:g} to {HIGH:g} N"
    fig, axes = _axes(len(runs), 5.6 * len(runs) + 0.8, 3.7, title)
    fig.set_layout_engine("compressed")
    top = 1.25 * LINES[-1]
    for axis, (plate, run) in zip(axes, runs.items(), strict=True):
        mesh = run.mesh()
        solid = finger(mesh)
        low, high = (between(run, run.record().force, force) for force in (LOW, HIGH))
        mean, motion = flow(solid, low, high, LOW, HIGH)
        cut = section(mesh, 0.5 * (low + high), np.concatenate([mean[:, :, None], motion[:, :, 1:]], axis=2))
        level, speed = cut.values[:, :, 0], 1e3 * cut.values[:, :, 1:]
        shown = _filled(axis, cut.triangles, level, top)
        depth = 0.5 * sum(run.record().at(f)[0] for f in (LOW, HIGH))
        _shape(axis, cut, plate, depth)
        axis.set_ylim(None, 1e3 * depth + 10.0)
        for line in LINES:
            ends, pace = cross(level - line, cut.triangles, speed)
            axis.add_collection(LineCollection(list(1e3 * ends), colors="white", linewidths=1.1))
            at, way = _spaced(1e3 * ends.mean(axis=1), pace.mean(axis=1), 0.75)
            arrows = axis.quiver(*at.T, *way.T, angles="xy", scale_units="xy", scale=5.0, width=0.0032, color="black",
                                 zorder=6)  # fmt: skip
        axis.quiverkey(arrows, 0.93, 1.06, 10.0, "10 mm/N", labelpos="W", coordinates="axes")
        axis.set_title(f"{plate}, lines of {', '.join(f'{x:g}' for x in LINES)}")
    fig.colorbar(shown, ax=list(axes), label="equivalent strain", shrink=0.9, pad=0.015, extend="max")
    return fig


def between(run: PressRun, marks: np.ndarray, mark: float) -> np.ndarray:
    """Displacement [m] (N,3) where the column `marks` (k,) of a record has the value `mark`, interpolated."""
    row = max(1, int(np.searchsorted(marks, mark)))
    share = (mark - marks[row - 1]) / max(marks[row] - marks[row - 1], 1e-300)
    low, high = run.displacement(row - 1), run.displacement(row)
    return low + share * (high - low)


def _volumes(run: PressRun) -> tuple[np.ndarray, np.ndarray]:
    """Forces [N] (k,) of the rows up to the first above `HIGH`, and volumes [m³] (k,l) at `LEVELS`."""
    forces = run.record().force
    last = min(len(forces), int(np.searchsorted(forces, HIGH)) + 1)
    mesh = run.mesh()
    solid = finger(mesh)
    volumes = [SIDES * volumes_above(solid, run.displacement(row), LEVELS) for row in range(last)]
    return forces[:last], np.array(volumes)


def _spaced(at: np.ndarray, way: np.ndarray, apart: float) -> tuple[np.ndarray, np.ndarray]:
    """Points at least `apart` from one another, and their vectors."""
    kept: list[int] = []
    for k in np.lexsort(at.T):
        if all(np.hypot(*(at[k] - at[j])) >= apart for j in kept):
            kept.append(int(k))
    return at[kept], way[kept]


def _filled(axis: Axes, triangles: np.ndarray, values: np.ndarray, top: float) -> Any:
    from matplotlib.tri import Triangulation

    flat = 1e3 * triangles.reshape(-1, 2)
    return axis.tripcolor(
        Triangulation(flat[:, 0], flat[:, 1], np.arange(len(flat)).reshape(-1, 3)), values.ravel(),
        shading="gouraud", cmap=deformation_colours(), vmin=0.0, vmax=top, rasterized=True,
    )  # fmt: skip


def _shape(axis: Axes, cut: Any, plate: str, depth: float) -> None:
    from matplotlib.collections import LineCollection

    axis.add_collection(LineCollection(list(1e3 * cut.borders), colors=INK, linewidths=0.6))
    low, high = 1e3 * cut.triangles.reshape(-1, 2).min(axis=0), 1e3 * cut.triangles.reshape(-1, 2).max(axis=0)
    span = (low[0] - 1.5, high[0] + 1.5)
    if len(cut.plate):
        ends = 1e3 * cut.plate.reshape(-1, 2)
        upper = ends[(ends[:, 1] > 0.5 * ends[:, 1].min()) & (np.abs(ends[:, 0]) < 0.95 * ends[:, 0].max())]
        upper = upper[np.argsort(upper[:, 0])]
        axis.fill_between(upper[:, 0], upper[:, 1], low[1] - 3.0, color=FAINT, alpha=0.5, lw=0)
        axis.add_collection(LineCollection(list(1e3 * cut.plate), colors=COLOURS[plate], linewidths=1.6))
    else:
        axis.fill_between(span, 1e3 * depth, low[1] - 3.0, color=FAINT, alpha=0.5, lw=0)
        axis.axhline(1e3 * depth, color=COLOURS[plate], lw=1.6)
    axis.grid(visible=False)
    axis.set(
        xlim=span,
        ylim=(low[1] - 2.5, high[1] + 0.8),
        aspect="equal",
        xlabel="along the finger [mm]",
        ylabel="height [mm]",
    )


def _axes(columns: int, width: float, height: float, title: str) -> tuple[Figure, Any]:
    fig = figure(width, height, title)
    return fig, fig.subplots(1, columns, squeeze=False).ravel()


def main() -> None:
    """Draw the runs, and print the statements if both plates are given."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", help="folders of runs, one per plate")
    parser.add_argument("-o", "--out", type=Path, default=Path("runs/fingertip"), help="folder for the pictures")
    given = parser.parse_args()
    runs = {str(run.settings()["plate"]): run for run in map(PressRun, given.runs)}
    given.out.mkdir(parents=True, exist_ok=True)
    for path in draw(runs, given.out):
        print(path)
    if len(runs) == 2:
        from tables import show

        check_pair(runs)
        show("statements", statements(runs["steel"].record(), runs["silicone"].record()))


if __name__ == "__main__":
    main()
