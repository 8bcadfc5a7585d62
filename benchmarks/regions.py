"""Stability of a sampled spring with dry friction and an encoder: four regions of a dimensionless plane.

    python benchmarks/regions.py --mass 0.1 --resolution 60e-6 --drag 0.2 --coulomb 0.05 --rate 1000 -o regions.png

    beta = b/(K T)       viscous drag over the effect of sampling         b [N s/m], K [N/m], T [s]
    sigma = f_c/(K d)    dry friction over the effect of the encoder      f_c [N], d [m] step of the position

beta >= 1/2 and sigma >= 1/2: passive (J. J. Abbott, A. M. Okamura, IEEE Trans. Robotics 21, 2005, 952-964). Elsewhere
drag and dry friction together may dissipate the energy, depending on the speed. N. Diolaiti, G. Niemeyer, F. Barbagli,
J. K. Salisbury, IEEE Trans. Robotics 22 (2006) 256-268 divide the plane into rest from any amplitude, rest from small
amplitudes only, limit cycle, and growing oscillation. The script finds the regions by simulation and draws the lines at
1/2.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from palpate.physics.device.wall_loop import WallDevice, run
from palpate.views.pictures.style import INK, figure

REST, NEAR, CYCLE, GROWS = "rest", "rest from small amplitudes", "limit cycle", "growing oscillation"
KINDS = (REST, NEAR, CYCLE, GROWS)
SECONDS = 10.0
NEARBY, FARAWAY = 2.5, 200.0
"""[1] Initial distances from equilibrium, in steps of the position."""
AT = np.geomspace(0.02, 4.0, 13)
"""Values of beta and of sigma at which the device is simulated."""


def fate(device: WallDevice, stiffness: float, period: float, begin: float) -> str:
    """Outcome `REST`, `CYCLE` or `GROWS` for a device released at `begin` [m] on a bilateral spring.

    stiffness  [N/m] of the spring, which is sampled at each `period` [s]
    """
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
    """One of `KINDS`, from the outcomes after a release near to and far from equilibrium."""
    near, far = (fate(device, stiffness, period, n * device.resolution) for n in (NEARBY, FARAWAY))
    if near == far:
        return near
    return NEAR if near == REST and far == GROWS else CYCLE if GROWS not in (near, far) else GROWS


def plane(device: WallDevice, stiffness: float, period: float, beta: np.ndarray, sigma: np.ndarray) -> list[list[str]]:
    """The region for each sigma (rows) and beta (columns) with the device's mass and resolution."""

    def at(b: float, s: float) -> str:
        drag, coulomb = b * stiffness * period, s * stiffness * device.resolution
        return region(device._replace(drag=drag, coulomb=coulomb), stiffness, period)

    return [[at(b, s) for b in beta.tolist()] for s in sigma.tolist()]


def draw(device: WallDevice, period: float, path: Path) -> None:
    """Draw the regions, the lines at 1/2, and the device's points for four stiffnesses."""
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
        parser.error(f"--resolution: found {given.resolution:g}, expected more than 0, because sigma is relative to it")
    draw(WallDevice(given.mass, given.drag, given.coulomb, given.resolution), 1.0 / given.rate, given.out)


if __name__ == "__main__":
    main()
