"""Mean rates of afferents while textures slide under a finger at 80 mm/s: recorded, and of the model.

    python benchmarks/measured/textures.py FOLDER [-o textures.png]

Reads texture_rates.csv: texture, mean rates of PC, RA and SA [1/s], their spread. Of the recordings the profiles, the
normal force and the contact area are not known; of the grating the period is, 3 mm. The model therefore gets each of a
set of assumed profiles and forces, all printed; none is fitted. The skin is that of the published model of the fibres.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from source import FINGERS, parser, table, texts

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, Proximity, Subsurface
from palpate.nodes.tactile import Afferents, Relief, Stress
from palpate.views.pictures import style

SPEED, RATE, RADIUS = 80e-3, 5000.0, 6e-3
FORCES = (0.25, 0.5, 1.0)
"""[N] on a patch of `RADIUS`; at 0.5 N the mean pressure is 4.4 kPa, and 13 kPa in the middle."""
UNITS = {"densities": (0.4e6, 0.4e6, 0.4e6), "reach": 0.8 * RADIUS}
TYPES = ("SA", "RA", "PC")


def ridges(x: np.ndarray, share: float, edge: float) -> np.ndarray:
    """Height (n) [1] of ridges of this share of the period x [1], with edges of this width [1]."""
    y = np.abs((x + 0.5) % 1.0 - 0.5)
    return 0.5 - 0.5 * np.tanh((y - 0.5 * share) / (0.5 * edge))


GRATINGS = {
    f"{shape}, {1e3 * height:g} mm": (3e-3, height, shape)
    for shape in ("sinusoid", "ridges 1/2", "ridges 1/4")
    for height in (0.3e-3, 0.5e-3, 1e-3)
}
"""Assumed profiles of the grating of 3 mm: period, height [m], shape; the share is that of the ridges."""
YARNS = (0.3e-3, 0.5e-3, 1e-3, 2e-3, 3e-3)
"""[m] Diameters of round yarns side by side, in place of fabrics, whose profiles are not recorded."""


def heights(shape: str, x: np.ndarray) -> np.ndarray:
    """Height (n) [1], 0 to 1, over the period x [1]."""
    if shape == "sinusoid":
        return 0.5 + 0.5 * np.cos(2.0 * np.pi * x)
    if shape == "yarns":
        return np.sqrt(np.maximum(1.0 - (2.0 * ((x + 0.5) % 1.0) - 1.0) ** 2, 0.0))
    return ridges(x, 0.5 if shape.endswith("1/2") else 0.25, 0.05)


def rates(s: np.ndarray, height: np.ndarray, force: float, seconds: float = 0.6) -> np.ndarray:
    """Mean rates (3) [1/s] of SA1, RA1 and PC under a profile (n) [m], after 0.2 s."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile.csv"
        path.write_text("s,height\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(s, height, strict=True)))
        stress = Stress(radius=RADIUS, reach=RADIUS, depths=(0.3e-3, 1.6e-3, 2e-3))
        relief = Relief(
            profile=str(path), roughness=0.0, direction=(1.0, 0.0, 0.0), radius=RADIUS, shortest=0.15e-3, **UNITS
        )
        load = Load(foot=(0, 0, 0), normal=(0, 0, 1), nodes=np.zeros(1, int), forces=np.array([[0.0, 0.0, -force]]))
        found = FakeBus(stress, rate=RATE).publish(load)[0]
        below = Subsurface(points=found.points, stress=found.stress, deflection=found.deflection)
        contact = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0,
                          compression_rate=0, indentation_rate=0)  # fmt: skip
        friction = Friction(force=(-0.3 * force, 0, 0), bristle=(0, 0, 0), stick=False)
        slides, fires = FakeBus(relief, rate=RATE), FakeBus(Afferents(**UNITS), rate=RATE)
        for name, message in (("load", load), ("friction", friction), ("contact", contact)):
            slides.hold(name, message)
        kind = fires.node.make_population().kind
        counts = np.zeros(3)
        for tick in range(round((0.2 + seconds) * RATE)):
            foot = (SPEED * (tick + 1) / RATE, 0.0, 0.0)
            slides.hold("proximity", Proximity(foot=foot, normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0.0,
                                               approach=0.0, slip=(SPEED, 0.0, 0.0)))  # fmt: skip
            felt = slides.publish(below)[0]
            spikes = fires.publish(Subsurface(points=felt.points, stress=felt.stress, deflection=felt.deflection))[0]
            if tick >= 0.2 * RATE:
                counts += np.bincount(kind[spikes.unit], minlength=3)
    return counts / np.bincount(kind, minlength=3) / seconds


def main() -> None:
    given = parser(__doc__).parse_args()
    rows = table(given.folder, "texture_rates.csv", FINGERS, 4)[1][:, [3, 2, 1]]
    names = [line[0] for line in texts(given.folder, "texture_rates.csv", FINGERS, 4)[1:]]
    recorded = dict(zip(names, rows, strict=True))
    target = recorded["3mm_grating"]
    print("3 mm grating, 80 mm/s, mean rates [1/s] of SA, RA, PC: recorded " + ", ".join(f"{x:.0f}" for x in target))
    x = np.linspace(0.0, 1.0, 257)
    found = {}
    for name, (period, height, shape) in GRATINGS.items():
        for force in FORCES:
            found[name, force] = got = rates(period * x, height * heights(shape, x), force)
            ratio = got / target
            good = "within 1.5" if np.all(np.abs(np.log(ratio[1:])) < np.log(1.5)) else ""
            text = " ".join(f"{a:6.1f} ({b:4.2f} x)" for a, b in zip(got, ratio, strict=True))
            print(f"{name:22} {force:4.2f} N {text}  {good}", flush=True)
    print("round yarns side by side, 0.5 N: rates of SA, RA, PC; recorded: "
          + "; ".join(f"{name} {a:.0f}, {b:.0f}, {c:.0f}" for name, (a, b, c) in recorded.items()))  # fmt: skip
    yarns = {}
    for wide in YARNS:
        got = yarns[wide] = rates(wide * x, 0.5 * wide * heights("yarns", x), 0.5)
        print(f"{1e3 * wide:4.1f} mm " + " ".join(f"{a:6.1f}" for a in got), flush=True)
    if given.out:
        draw(given.out, found, yarns, recorded)


@style.look()
def draw(path: Path, found: dict, yarns: dict, recorded: dict) -> None:
    """Rates [1/s] of RA and PC: the grating with each assumed profile, and round yarns over their diameter."""
    figure = style.figure(14.0, 6.0, "Mean rates at 80 mm/s: recorded, and of the model with assumed profiles")
    left, right = figure.subplots(1, 2)
    colours = (style.SPEED, style.NORMAL, style.FINGER)
    target = recorded["3mm_grating"]
    for mark, shape in zip("o^s", ("sinusoid", "ridges 1/2", "ridges 1/4"), strict=True):
        points = np.array([got for (name, _), got in found.items() if name.startswith(shape)])
        left.plot(points[:, 1], points[:, 2], mark, color=style.TISSUE, label=f"model, {shape}", markersize=5)
    left.plot(target[1], target[2], "*", color=style.FINGER, markersize=14, label="recorded, 3 mm grating")
    left.fill([target[1] / 1.5, target[1] * 1.5, target[1] * 1.5, target[1] / 1.5],
              [target[2] / 1.5, target[2] / 1.5, target[2] * 1.5, target[2] * 1.5],
              color=style.FINGER, alpha=0.12, label="within a factor of 1.5")  # fmt: skip
    left.set(title="3 mm grating: 0.3 to 1 mm high, 0.25 to 1 N", xlabel="RA [1/s]", ylabel="PC [1/s]",
             xlim=(0, None), ylim=(0, None))  # fmt: skip
    left.legend(loc="lower right")
    wide = 1e3 * np.array(list(yarns))
    for k, kind in enumerate(TYPES):
        right.plot(wide, [got[k] for got in yarns.values()], "o-", color=colours[k], label=f"model, {kind}")
    for n, (name, rate) in enumerate(recorded.items()):
        for k in range(3):
            right.plot(3.6 + 0.35 * n, rate[k], "*", color=colours[k], markersize=9)
        right.text(
            3.6 + 0.35 * n, 1.1 * max(rate), name.replace("_", " "), rotation=90, size=7, ha="center", va="bottom"
        )
    right.set(title="Round yarns side by side, 0.5 N; right: recorded textures", xlabel="diameter of the yarns [mm]",
              ylabel="mean rate [1/s]", ylim=(0, None))  # fmt: skip
    right.legend()
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
