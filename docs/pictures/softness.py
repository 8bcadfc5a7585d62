"""Draw the pictures of docs/equations/shape-display.md: `python docs/pictures/softness.py [FOLDER]`."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from palpate.messages import Contact, Pins, Surface
from palpate.nodes.display import PinArray
from palpate.nodes.surface import surface_mesh
from palpate.physics.nodule import nodule_centre, stiffness_map
from palpate.physics.shape_display import FINGERPADS, VALID_RATIO, pad_contact, pad_displacement

PAD = FINGERPADS["canonical"]
MODULI = {5e3: "5 kPa", 15e3: "15 kPa", 60e3: "60 kPa", np.inf: "rigid"}
COLOURS = dict(zip(MODULI, ("tab:red", "tab:orange", "tab:green", "black"), strict=True))
SHADE = {"color": "0.85", "lw": 0, "zorder": 0}
OUTSIDE = "outside Hertz theory (a > R_f/2)"


def profile(folder: Path) -> Path:
    """Motion of the fingerpad on 15 kPa: at 3 N, where the theory does not hold, and at a force where it does."""
    figure, panels = new(2)
    for axes, force in zip(panels, (3.0, 0.09), strict=True):
        state = pad_contact(force, 15e3)
        r = np.linspace(-14e-3, 14e-3, 401)
        deformation = pad_displacement(np.abs(r), state)
        if not state.valid:
            axes.axvspan(-14, 14, **SHADE, label=OUTSIDE)
        for edge in (-state.radius, state.radius):
            axes.axvline(edge * 1e3, color="0.5", lw=0.8, ls="--", label="edge of contact" if edge > 0 else None)
        axes.plot(r * 1e3, (state.approach + deformation) * 1e3, color="tab:blue", label="both")
        axes.plot(
            r * 1e3, np.full_like(r, state.approach * 1e3), ":", color="tab:blue", label="rigid motion (actuator)"
        )
        axes.plot(r * 1e3, deformation * 1e3, color="tab:orange", label="deformation (pins)")
        axes.set(xlabel="distance from the axis [mm]", ylabel="motion of the fingerpad [mm]", xlim=(-14, 14))
        axes.set_ylim(0, 1.45e3 * float(np.max(state.approach + deformation)))
        axes.set_title(f"{force:g} N on 15 kPa: a = {state.radius * 1e3:.1f} mm, R_f = {PAD.radius * 1e3:g} mm")
        axes.legend(frameon=False, fontsize=8, loc="upper center", ncols=2)
    return save(figure, folder / "softness-profile.png")


def deflection(folder: Path) -> Path:
    """x against force. The states a < R_f/2 lie above the curve on which a = R_f/2, up to the rigid plate's."""
    figure, axes = new(1)
    _curves(axes, "deflection")
    force = np.linspace(0.0, 4.0, 801)
    border = pad_contact(force[:, None], np.append(np.geomspace(50.0, 1e9, 400), np.inf))
    last = np.count_nonzero(border.valid, axis=0) - 1
    at, edge = force[last], border.deflection[last, np.arange(len(last))] * 1e3
    axes.fill_between(at, 0.0, edge, **SHADE, label=OUTSIDE)
    axes.axvspan(at[-1], 4.0, **SHADE)
    axes.set(ylabel="largest deformation x [mm]")
    axes.legend(fontsize=8, title="tissue", loc="lower right", framealpha=1)
    return save(figure, folder / "softness-deflection.png")


def approach(folder: Path) -> Path:
    """The rigid motion against force. On flat tissue a = R_f/2 is delta = R_f/4."""
    figure, axes = new(1)
    _curves(axes, "approach")
    axes.axhspan(VALID_RATIO**2 * PAD.radius * 1e3, 1e3, **SHADE, label=OUTSIDE)
    axes.set(ylabel="rigid motion δ [mm]", ylim=(0, 33))
    axes.legend(fontsize=8, title="tissue", loc="upper left", framealpha=1)
    return save(figure, folder / "softness-approach.png")


def _curves(axes, quantity: str) -> None:
    force = np.linspace(0.0, 4.0, 801)
    for modulus, text in MODULI.items():
        state = pad_contact(force, modulus)
        value = getattr(state, quantity) * 1e3
        last = int(np.count_nonzero(state.valid)) - 1
        axes.plot(force, value, color=COLOURS[modulus], lw=1.2, ls="--")
        axes.plot(force[: last + 1], value[: last + 1], color=COLOURS[modulus], lw=2.2, label=text)
        axes.plot(force[last], value[last], "o", color=COLOURS[modulus], ms=4)
    axes.set(xlabel="force [N]", xlim=(0, 4), ylim=(0, None))


def nodule(folder: Path) -> Path:
    """Pins over homogeneous tissue and over a nodule, at the same force."""
    mesh = surface_mesh("plane", 10000)
    place, ratio, reach = np.array([4e-3, 0.0, 0.0]), 10.0, 6e-3
    centre = nodule_centre(mesh.vertices, mesh.normals, place, 6e-3)
    hard = stiffness_map(mesh.vertices, mesh.normals, centre, 4e-3, ratio, reach)
    plain = shown(mesh, np.ones(len(mesh.vertices)))
    found = shown(mesh, hard)
    figure, (left, middle, right) = new(3)
    extent = (-8, 8, -8, 8)
    scale = Normalize(0, 1e3 * max(plain.heights.max(), found.heights.max()))
    for axes, pins, title in ((left, plain, "homogeneous tissue"), (middle, found, "nodule below the circle")):
        image = axes.imshow(pins.heights * 1e3, origin="lower", extent=extent, norm=scale)
        axes.set(title=title, xlabel="x [mm]", ylabel="y [mm]")
    figure.colorbar(image, ax=middle, label="pin height [mm]")
    change = right.imshow((found.heights - plain.heights) * 1e3, origin="lower", extent=extent, cmap="magma")
    right.set(title="difference", xlabel="x [mm]")
    figure.colorbar(change, ax=right, label="difference [mm]")
    angle = np.linspace(0, 2 * np.pi, 100)
    for axes in (middle, right):
        axes.plot(4 + 4 * np.cos(angle), 4 * np.sin(angle), color="white", lw=1)
        axes.set(xlim=(-8, 8), ylim=(-8, 8))
    return save(figure, folder / "softness-nodule.png")


def shown(mesh, hard: np.ndarray) -> Pins:
    """Pins under 0.3 N on springs F = 3000 k u^1.5 N that share the force by a biweight (nodal law). Its radius of
    6.8 mm makes the dimple of homogeneous springs as curved as the fingerpad."""
    force, stiffness, exponent = 0.3, 3000.0, 1.5
    compression = np.log1p(force * 1681.06 / 26.2641) / 1681.06  # exponential law of the default fingertip
    d = np.linalg.norm(mesh.vertices, axis=1)
    weight = mesh.areas * np.maximum(1 - (d / 6.8e-3) ** 2, 0) ** 2
    share = weight / weight.max()
    inward = (force * share / (stiffness * hard)) ** (1 / exponent)
    nodes = np.flatnonzero(inward > 0)
    surface = Surface(
        nodes=nodes, displacement=-inward[nodes, None] * mesh.normals[nodes], stiffness=stiffness, exponent=exponent,
        damping=0.0, free=0.0, previous=0.0,
    )  # fmt: skip
    contact = Contact(
        foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=compression, indentation=float(inward.max()),
        compression_rate=0.0, indentation_rate=0.0,
    )  # fmt: skip
    flat = {"surface": "plane", "vertices": 10000, "position": (0.0, 0.0, 0.0)}
    node = PinArray(shows="surface", rows=8, columns=8, rate=1e3, **flat)
    node.start()
    return node.step(contact, surface, dt=1.0)


def new(count: int):
    figure = Figure(figsize=(6.4, 4.2) if count == 1 else (12, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(1, count)


def save(figure: Figure, path: Path) -> Path:
    figure.savefig(path, dpi=120)
    return path


def main(folder: Path) -> list[Path]:
    folder.mkdir(parents=True, exist_ok=True)
    return [
        profile(folder),
        deflection(folder),
        approach(folder),
        nodule(folder),
    ]


if __name__ == "__main__":
    for written in main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent):
        print(written)
