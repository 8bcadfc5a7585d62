"""Mean rates of afferents while textures slide under a finger at 80 mm/s: recorded, and of the model.

    python benchmarks/measured/textures.py FOLDER [-o textures.png]

Reads texture_rates.csv: texture, mean rates of PC, RA and SA [1/s], their spread. Of the recordings the profiles, the
normal force and the contact area are not known; of the grating the period is, 3 mm. The model therefore gets each of a
set of assumed profiles and forces, all printed; none is fitted. The skin is that of the published model of the fibres.
"""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
from source import FINGERS, parser, table, texts

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, Proximity, Subsurface
from palpate.nodes.tactile import Afferents, Relief, Stress
from palpate.views.pictures import style

SPEED, RATE = 80e-3, 5000.0
FORCES = (0.25, 0.5, 1.0)
"""[N] The contact area is that of the finite-element fingertip on a rigid plate."""


def patch(force: float) -> float:
    """Radius [m] of the contact: 34.6 mm² at 0.11 N, 59.1 mm² at 0.5 N (docs/equations/tactile-flow.md), a power of the
    force between and beyond."""
    area = 34.6e-6 * (force / 0.11) ** (np.log(59.1 / 34.6) / np.log(0.5 / 0.11))
    return float(np.sqrt(area / np.pi))


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
MIDDLE = 0.5  # [N] for the order of the textures


def yarns(diameter: float, variation: float, count: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Profile s, h (n) [m] of round yarns side by side, whose diameter varies by this share; thick ones are higher."""
    wide = diameter * np.clip(1.0 + variation * np.random.default_rng(0).standard_normal(count), 0.4, 1.6)
    edges = np.r_[0.0, np.cumsum(wide)]
    s = np.linspace(0.0, edges[-1], 4001)
    k = np.clip(np.searchsorted(edges, s, side="right") - 1, 0, count - 1)
    height = 0.5 * wide[k] * heights("yarns", (s - edges[k]) / wide[k]) + 0.5 * (wide[k] - diameter)
    return s, np.r_[height[:-1], height[0]]


def huckaback(block: float, diameter: float) -> tuple[np.ndarray, np.ndarray]:
    """Profile of yarns that are raised by a half of their diameter once per block."""
    s = np.linspace(0.0, block, 1025)
    raised = 0.5 * diameter * heights("sinusoid", s / block)
    return s, 0.5 * diameter * heights("yarns", np.mod(s / diameter, 1.0)) + raised


def wales(period: float, height: float = 0.5e-3) -> tuple[np.ndarray, np.ndarray]:
    """Profile of round wales."""
    s = np.linspace(0.0, period, 257)
    return s, height * heights("yarns", s / period)


def grating(shape: str) -> tuple[np.ndarray, np.ndarray]:
    s = np.linspace(0.0, 3e-3, 257)
    return s, 0.5e-3 * heights(shape, s / 3e-3)


def heights(shape: str, x: np.ndarray) -> np.ndarray:
    """Height (n) [1], 0 to 1, over the period x [1]."""
    if shape == "sinusoid":
        return 0.5 + 0.5 * np.cos(2.0 * np.pi * x)
    if shape == "yarns":
        return np.sqrt(np.maximum(1.0 - (2.0 * ((x + 0.5) % 1.0) - 1.0) ** 2, 0.0))
    return ridges(x, 0.5 if shape.endswith("1/2") else 0.25, 0.05)


TEXTURES = {
    "wool_blend": [yarns(wide, varies) for wide in (0.4e-3, 0.8e-3) for varies in (0.2, 0.4)],
    "hucktowel": [huckaback(block, 0.5e-3) for block in (2e-3, 3e-3)],
    "corduroy": [wales(period) for period in (1.8e-3, 2.5e-3, 3.2e-3)],
    "3mm_grating": [grating(shape) for shape in ("ridges 1/2", "ridges 1/4")],
}
"""Plausible profiles of these cloths: uneven yarns of 0.4 to 0.8 mm; yarns of 0.5 mm raised every 2 to 3 mm; 8 to 14
wales per inch. The specimens themselves were not measured here, and threads yield, which these profiles do not."""


def rates(s: np.ndarray, height: np.ndarray, force: float, seconds: float = 0.6) -> np.ndarray:
    """Mean rates (3) [1/s] of SA1, RA1 and PC under a profile (n) [m], after 0.2 s."""
    radius = patch(force)
    units = {"densities": (0.8e6, 0.8e6, 0.8e6), "reach": 0.8 * radius}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "profile.csv"
        path.write_text("s,height\n" + "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(s, height, strict=True)))
        stress = Stress(radius=radius, reach=radius, depths=(0.3e-3, 1.6e-3, 2e-3))
        relief = Relief(
            profile=str(path), roughness=0.0, direction=(1.0, 0.0, 0.0), radius=radius, shortest=0.15e-3, **units
        )
        load = Load(foot=(0, 0, 0), normal=(0, 0, 1), nodes=np.zeros(1, int), forces=np.array([[0.0, 0.0, -force]]))
        found = FakeBus(stress, rate=RATE).publish(load)[0]
        below = Subsurface(points=found.points, stress=found.stress, deflection=found.deflection)
        contact = Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0,
                          compression_rate=0, indentation_rate=0)  # fmt: skip
        friction = Friction(force=(-0.3 * force, 0, 0), bristle=(0, 0, 0), stick=False)
        slides, fires = FakeBus(relief, rate=RATE), FakeBus(Afferents(**units), rate=RATE)
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
    print(f"textures, {MIDDLE:g} N, range over assumed profiles; recorded")
    assumed = {}
    for name in recorded:
        assumed[name] = np.array([rates(*profile, MIDDLE) for profile in TEXTURES[name]])
        low, high = assumed[name].min(axis=0), assumed[name].max(axis=0)
        print(f"{name:12} " + ", ".join(f"{kind} {a:.0f} to {b:.0f} ({c:.0f})" for kind, a, b, c in
                                        zip(TYPES, low, high, recorded[name], strict=True)), flush=True)  # fmt: skip
    for k, kind in enumerate(TYPES):
        for more, less in sorted(itertools.permutations(recorded, 2), key=lambda pair: -recorded[pair[0]][k]):
            if recorded[more][k] > recorded[less][k]:
                right = np.mean(assumed[more][:, k][:, None] > assumed[less][:, k])
                print(f"{kind}: {more} above {less}: in {100 * right:.0f} % of the pairs of assumed profiles")
    if given.out:
        draw(given.out, found, assumed, recorded)


@style.look()
def draw(path: Path, found: dict, assumed: dict, recorded: dict) -> None:
    """Rates [1/s] of RA and PC over the grating with each assumed profile, and of all types over all textures."""
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
    for k, kind in enumerate(TYPES):
        at = np.arange(len(recorded)) + 0.25 * (k - 1)
        for x, each in zip(at, assumed.values(), strict=True):
            right.plot([x, x], [each[:, k].min(), each[:, k].max()], color=colours[k], linewidth=5, alpha=0.45,
                       solid_capstyle="butt", label=f"{kind}, model" if x == at[0] else None)  # fmt: skip
        right.plot(at, [rate[k] for rate in recorded.values()], "*", color=colours[k], markersize=11,
                   label=f"{kind}, recorded")  # fmt: skip
    right.set_xticks(range(len(recorded)), [name.replace("_", " ") for name in recorded])
    right.set(title="Four textures, 0.5 N: ranges over assumed profiles", ylabel="mean rate [1/s]", ylim=(0, None))
    right.legend(loc="upper right", ncols=3)
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
