"""Mean rates of afferents while textures slide under a finger at 80 mm/s: recorded, and of the model.

    python benchmarks/measured/textures.py FOLDER [-o textures.png]

Reads texture_rates.csv: texture, mean rates of PC, RA and SA [1/s], their spread. Of the recordings the profiles, the
normal force and the contact area are not known; of the grating the period is, 3 mm. The model therefore gets each of a
set of assumed profiles and forces, all printed; none is fitted to these rates. The constants of the fibres are the
published ones, and those calibrated on the thresholds of other units (thresholds.py), for which the rates are a
prediction. Also printed is what the rates depend on: SA1 without their dynamic input, PC without waves below 1 mm.
`-o` writes two pictures, the second with "-grating" in its name.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from profiles import HEIGHTS, SHAPES, TEXTURES, grating
from scipy import signal
from sliding import RATE, SPEED, Felt, feel, fire
from source import FINGERS, parser, table, texts

from palpate.physics.afferents.calibrated import CONSTANTS, GAIN
from palpate.views.pictures import style

TYPES = ("SA", "RA", "PC")
FORCES = (0.25, 0.5, 1.0)
"""[N] The contact area is that of the finite-element fingertip on a rigid plate."""
MIDDLE = 0.5  # [N] of the pictures
WAVE = 1e-3  # [m] Shorter waves of the surface are left out to find what they contribute
NAMES = {"hucktowel": "hucktowel", "wool_blend": "wool blend", "3mm_grating": "3 mm grating", "corduroy": "corduroy"}


def both(felt: Felt) -> np.ndarray:
    """Rates (2, 3) with each of the constants."""
    return np.array([fire(felt, constants) for constants in CONSTANTS])


def parts(felt: Felt) -> tuple[float, float]:
    """Rate of SA1 without their dynamic input, and of PC without waves of the surface below `WAVE`, published."""
    still = felt._replace(deflection=np.zeros_like(felt.deflection))
    low = signal.butter(4, SPEED / WAVE, fs=RATE, output="sos")
    smooth = felt._replace(deflection=np.ascontiguousarray(signal.sosfiltfilt(low, felt.deflection, axis=0)))
    return fire(still, "published")[0], fire(smooth, "published")[2]


def slide_gratings(target: np.ndarray) -> dict:
    """Rates (2, 3) of each assumed grating at each force."""
    print("3 mm grating, 80 mm/s, mean rates [1/s] of SA, RA, PC: recorded " + ", ".join(f"{x:.0f}" for x in target))
    found = {}
    for shape, height, force in itertools.product(SHAPES, HEIGHTS, FORCES):
        found[shape, height, force] = got = both(feel(*grating(shape, height), force))
        text = ""
        for name, rates in zip(CONSTANTS, got, strict=True):
            ratio = rates / target
            good = " within 1.5" if np.all(np.abs(np.log(ratio[1:])) < np.log(1.5)) else ""
            text += f"   {name} " + " ".join(f"{a:5.1f} ({b:4.2f} x)" for a, b in zip(rates, ratio, strict=True)) + good
        print(f"{shape}, {1e3 * height:.1f} mm, {force:4.2f} N{text}", flush=True)
    return found


def in_order(found: dict, recorded: dict, k: int) -> dict:
    """Share of the pairs of profiles of each pair of textures whose rates (profiles) of type k have the recorded
    order."""
    ordered = sorted(recorded, key=lambda name: -recorded[name][k])
    return {(a, b): np.mean(found[a][:, None] > found[b]) for a, b in itertools.combinations(ordered, 2)}


def vary_gain(recorded: dict) -> None:
    """Print how much the order of RA depends on their gain, over its 95 % interval, with each cut-off frequency."""
    felt = {name: [feel(*profile, MIDDLE) for profile in TEXTURES[name]] for name in recorded}
    for which, given in (("published", 1.0), ("calibrated", GAIN[1])):
        for gain in (0.7, 2.5):
            gains = (1.0, gain / given, 1.0)
            found = {name: np.array([fire(each, which, gains=gains)[1] for each in felt[name]]) for name in felt}
            share = 100 * np.mean([*in_order(found, recorded, 1).values()])
            print(
                f"RA, {MIDDLE:g} N, cut-off: {which}, gain {gain:g}: in the recorded order {share:.0f} % of the pairs"
            )


def slide_textures(recorded: dict, force: float) -> dict:
    """Rates (profiles, 2, 3) of each texture at a force."""
    print(f"textures, {force:g} N, range over assumed profiles (recorded)")
    found = {}
    for name in recorded:
        felt = [feel(*profile, force) for profile in TEXTURES[name]]
        found[name] = np.array([both(each) for each in felt])
        for n, which in enumerate(CONSTANTS):
            low, high = found[name][:, n].min(axis=0), found[name][:, n].max(axis=0)
            print(f"{name:12} {which:10} " + ", ".join(f"{kind} {a:.0f} to {b:.0f} ({c:.0f})" for kind, a, b, c in
                                                       zip(TYPES, low, high, recorded[name], strict=True)))  # fmt: skip
        if force == MIDDLE:
            still, smooth = np.array([parts(each) for each in felt]).T
            print(f"{name:12} published  SA without dynamic input {still.min():.0f} to {still.max():.0f}, PC without "
                  f"waves below {1e3 * WAVE:g} mm {smooth.min():.0f} to {smooth.max():.0f}")  # fmt: skip
            energy = np.array([fire(each, "calibrated", stimulus="energy") for each in felt])
            print(f"{name:12} calibrated, stimulus energy: " + ", ".join(f"{kind} {a:.0f} to {b:.0f}" for kind, a, b in
                  zip(TYPES, energy.min(axis=0), energy.max(axis=0), strict=True)), flush=True)  # fmt: skip
    for n, which in enumerate(CONSTANTS):
        for k, kind in enumerate(TYPES):
            right = in_order({name: rates[:, n, k] for name, rates in found.items()}, recorded, k)
            print(f"{which:10} {kind}: in the recorded order {100 * np.mean([*right.values()]):.0f} % of the pairs: "
                  + "; ".join(f"{more} above {less} {100 * x:.0f} %" for (more, less), x in right.items()))  # fmt: skip
    return found


def main() -> None:
    given = parser(__doc__).parse_args()
    rows = table(given.folder, "texture_rates.csv", FINGERS, 4)[1][:, [3, 2, 1]]
    names = [line[0] for line in texts(given.folder, "texture_rates.csv", FINGERS, 4)[1:]]
    recorded = {name: rows[names.index(name)] for name in TEXTURES}
    flat = np.linspace(0.0, 3e-3, 257), 1e-9 * np.cos(np.linspace(0.0, 2.0 * np.pi, 257))
    print("smooth plate, SA1: " + ", ".join(f"{fire(feel(*flat, f), 'published')[0]:.1f}/s at {f:g} N" for f in FORCES))
    gratings = slide_gratings(recorded["3mm_grating"])
    textures = {force: slide_textures(recorded, force) for force in FORCES}
    vary_gain(recorded)
    if given.out:
        draw_textures(given.out, textures[MIDDLE], recorded)
        draw_gratings(given.out.with_stem(given.out.stem + "-grating"), gratings, recorded["3mm_grating"])


@style.look()
def draw_textures(path: Path, found: dict, recorded: dict) -> None:
    """Rates [1/s] of each type over the textures: ranges over the assumed profiles, and recorded."""
    figure = style.figure(
        14.0, 5.0, "Mean rates at 80 mm/s and 0.5 N: recorded, and of the model with assumed profiles"
    )
    for k, (axes, kind) in enumerate(zip(figure.subplots(1, 3), TYPES, strict=True)):
        for n, (which, colour) in enumerate(zip(CONSTANTS, (style.FINGER, style.TISSUE), strict=True)):
            if kind == "SA" and n == 1:
                continue  # the same as published
            for x, name in enumerate(recorded):
                low, high = found[name][:, n, k].min(), found[name][:, n, k].max()
                axes.plot([x + 0.24 * n - 0.12] * 2, [low - 0.3, high + 0.3], color=colour, linewidth=9, alpha=0.6,
                          solid_capstyle="butt", label=f"model, constants: {which}" if x == 0 else None)  # fmt: skip
        axes.plot(range(len(recorded)), [rate[k] for rate in recorded.values()], "*", color=style.NORMAL,
                  markersize=14, label="recorded")  # fmt: skip
        axes.set_xticks(range(len(recorded)), [NAMES[name] for name in recorded])
        axes.set(title=kind, ylabel="mean rate [1/s]", ylim=(0, 1.25 * axes.get_ylim()[1]))
        axes.set(xlim=(-0.5, len(recorded) - 0.5))
        axes.legend(loc="upper right")
    figure.savefig(path)
    print(f"written {path}")


@style.look()
def draw_gratings(path: Path, found: dict, target: np.ndarray) -> None:
    """Rates [1/s] of RA and PC over each assumed grating, and of SA over its height."""
    figure = style.figure(14.0, 5.5, "3 mm grating at 80 mm/s: recorded, and of the model with assumed profiles")
    left, right = figure.subplots(1, 2)
    for n, (which, colour) in enumerate(zip(CONSTANTS, (style.FINGER, style.TISSUE), strict=True)):
        for mark, shape in zip("o^s", SHAPES, strict=True):
            points = np.array([got[n] for (name, height, _), got in found.items() if name == shape and height > 0.1e-3])
            left.plot(points[:, 1], points[:, 2], mark, color=colour, label=f"{which}, {shape}", markersize=5)
    left.plot(target[1], target[2], "*", color=style.NORMAL, markersize=14, label="recorded")
    left.fill([target[1] / 1.5, target[1] * 1.5, target[1] * 1.5, target[1] / 1.5],
              [target[2] / 1.5, target[2] / 1.5, target[2] * 1.5, target[2] * 1.5],
              color=style.NORMAL, alpha=0.12, label="within a factor of 1.5")  # fmt: skip
    left.set(title="RA and PC, 0.3 to 1 mm high, 0.25 to 1 N", xlabel="RA [1/s]", ylabel="PC [1/s]",
             xlim=(0, None), ylim=(0, 215))  # fmt: skip
    left.legend(loc="upper left", ncols=2)
    for mark, shape in zip("o^s", SHAPES, strict=True):
        for force, colour in zip(FORCES, (style.NORMAL, style.SPEED, style.FINGER), strict=True):
            rates = [found[shape, height, force][0, 0] for height in HEIGHTS]
            right.plot(1e3 * np.array(HEIGHTS), rates, mark + "-", color=colour, markersize=5,
                       label=f"{shape}, {force:g} N")  # fmt: skip
    right.axhline(target[0], color=style.NORMAL, linestyle="--", label="recorded")
    right.set(title="SA, published constants", xlabel="height of the grating [mm]", ylabel="SA [1/s]",
              xlim=(0, 1.05), ylim=(0, None))  # fmt: skip
    right.legend(loc="upper left", ncols=2)
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
