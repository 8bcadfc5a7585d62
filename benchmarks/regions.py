"""What dry friction and an encoder make of a sampled spring: four regions of a plane without units.

    python benchmarks/regions.py --mass 0.1 --resolution 60e-6 --drag 0.2 --coulomb 0.05 --rate 1000 -o regions.png

    beta = b/(K T)       viscous drag against what sampling puts in       b [N s/m], K [N/m], T [s]
    sigma = f_c/(K d)    dry friction against what the encoder puts in    f_c [N], d [m] step of the position

beta >= 1/2 and sigma >= 1/2: passive (J. J. Abbott, A. M. Okamura, IEEE Trans. Robotics 21, 2005, 952-964). Else drag
and dry friction may share the work, by how fast the device moves: N. Diolaiti, G. Niemeyer, F. Barbagli, J. K.
Salisbury, IEEE Trans. Robotics 22 (2006) 256-268 part the plane into rest from anywhere, rest from near by only, a
swing that is kept, and one that grows. Here the regions come from simulation, and the lines at 1/2 are drawn over them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from palpate.physics.device.wall_loop import WallDevice, run
from palpate.views.pictures.style import INK, figure

REST, NEAR, CYCLE, GROWS = "rests", "rests from near by", "swings on", "grows"
KINDS = (REST, NEAR, CYCLE, GROWS)
SECONDS = 10.0
NEARBY, FARAWAY = 2.5, 200.0
"""[1] Steps of the position from which the device is let go."""
AT = np.geomspace(0.02, 4.0, 13)
"""Of both axes."""


def fate(device: WallDevice, stiffness: float, period: float, begin: float) -> str:
    """`REST`, `CYCLE` or `GROWS`: what becomes of a device that is let go `begin` [m] away on a spring [N/m] that never
    lets go, sampled at each period [s]."""
    steps = np.full(round(SECONDS / period), period)
    free = device._replace(limit=1e12, slew=1e15)
    path = run(free, stiffness, 0.0, controlled=False, steps=steps, free=True, begin=begin)[:, 0]
    if not np.isfinite(path).all():
        return GROWS
    parts = np.array_split(path, 8)
    early, late = float(np.ptp(parts[1])), float(np.ptp(parts[-1]))
    if late <= 0.05 * device.resolution:
        return REST
    if late > max(1.02 * early, 4.0 * device.resolution):
        return GROWS
    return CYCLE


def region(device: WallDevice, stiffness: float, period: float) -> str:
    """One of `KINDS`: what becomes of it from near by and from far away."""
    near, far = (fate(device, stiffness, period, n * device.resolution) for n in (NEARBY, FARAWAY))
    if near == far:
        return near
    return NEAR if near == REST and far == GROWS else CYCLE if GROWS not in (near, far) else GROWS


def plane(device: WallDevice, stiffness: float, period: float, beta: np.ndarray, sigma: np.ndarray) -> list[list[str]]:
    """The region at each sigma (rows) and beta (columns), of a device with this mass and resolution."""

    def at(b: float, s: float) -> str:
        drag, coulomb = b * stiffness * period, s * stiffness * device.resolution
        return region(device._replace(drag=drag, coulomb=coulomb), stiffness, period)

    return [[at(b, s) for b in beta.tolist()] for s in sigma.tolist()]


def draw(device: WallDevice, period: float, path: Path) -> None:
    """The plane, the lines at 1/2, and where the device lies at some stiffnesses."""
    from matplotlib.colors import ListedColormap

    stiffness = 2.0 * device.drag / period
    drawn = figure(7.4, 6.0, "Stability of a sampled spring: viscous damping, dry friction, encoder")
    ax = drawn.subplots()
    number = [[KINDS.index(kind) for kind in row] for row in plane(device, stiffness, period, AT, AT)]
    colours = ["#d9ead9", "#dbe6f4", "#f6e3bd", "#eec4bf"]
    ax.pcolormesh(AT, AT, number, cmap=ListedColormap(colours), vmin=-0.5, vmax=3.5, shading="nearest")
    for kind, colour in zip(KINDS, colours, strict=True):
        ax.plot([], [], "s", color=colour, markersize=10, label=kind)
    ax.axvline(0.5, color=INK, linewidth=0.9)
    ax.axhline(0.5, color=INK, linewidth=0.9)
    for k in (100.0, 300.0, 1000.0, 3000.0):
        beta, sigma = device.drag / (k * period), device.coulomb / (k * device.resolution)
        if sigma > 0.0:
            ax.plot(beta, sigma, "x", color=INK)
            ax.annotate(f"{k:g} N/m", (beta, sigma), textcoords="offset points", xytext=(5, 5), fontsize=8)
    ax.set(xscale="log", yscale="log", xlabel="b / (K T)", ylabel="f_c / (K step)",
           title=f"mass {device.mass:g} kg, K = {stiffness:.0f} N/m; above and right of 1/2: passive",
           xlim=(AT[0], AT[-1]), ylim=(AT[0], AT[-1]))  # fmt: skip
    ax.legend(loc="lower left")
    drawn.savefig(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, usual, unit in (
        ("mass", 0.1, "kg"), ("resolution", 60e-6, "m"), ("drag", 0.2, "N s/m"), ("coulomb", 0.0, "N"),
        ("rate", 1000.0, "Hz"),
    ):  # fmt: skip
        parser.add_argument(f"--{name}", type=float, default=usual, help=f"[{unit}]")
    parser.add_argument("-o", "--out", type=Path, default=Path("regions.png"))
    given = parser.parse_args()
    if not given.resolution > 0.0:
        parser.error(f"--resolution: found {given.resolution:g}, expected an encoder: the plane has its step in it")
    draw(WallDevice(given.mass, given.drag, given.coulomb, given.resolution), 1.0 / given.rate, given.out)


if __name__ == "__main__":
    main()
