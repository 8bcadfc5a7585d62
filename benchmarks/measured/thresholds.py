"""Tuning thresholds of recorded RA and PC afferents, and those of the model, without and with a gain per type.

    python benchmarks/measured/thresholds.py FOLDER [-o thresholds.png]

Reads thresholds_RA.csv and thresholds_PC.csv: frequency [Hz], then one column per unit [um]. The constant ends of a
column, outside the range of the unit's curve, are left out. A threshold is the amplitude at which a fibre fires once
per cycle; that of the model is the peak amplitude of a flat probe of 0.5 mm. The sources do not say whether theirs is
the peak or the peak to peak, which is 6 dB.
"""

from __future__ import annotations

import numpy as np
from source import FINGERS, parser, table

from palpate.physics.afferents.probe import median_threshold
from palpate.views.pictures import style

FREQUENCIES = {"RA": (5, 10, 20, 30, 40, 60, 100, 200), "PC": (20, 40, 60, 80, 100, 150, 200, 250)}
KINDS = {"RA": 1, "PC": 2}
LEAST = 5  # units at a frequency


def units(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] (n), rising, and thresholds [dB re 1 um] (n, units), NaN outside the curve of a unit."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    level = 20.0 * np.log10(rows[:, 1:])
    for column in level.T:
        moves = np.flatnonzero(np.abs(np.diff(column)) > 0.01)
        column[: moves[0]], column[moves[-1] + 2 :] = np.nan, np.nan
    return rows[:, 0], level


def main() -> None:
    given = parser(__doc__).parse_args()
    read = {name: units(table(given.folder, f"thresholds_{name}.csv", FINGERS, 3)[1]) for name in KINDS}
    drawn = []
    for name, kind in KINDS.items():
        at, level = read[name]
        print(f"{name}   [dB re 1 um]   measured: median (least to most) of n units   model   model - measured")
        apart, points = [], []
        for frequency in FREQUENCIES[name]:
            here = np.array([np.interp(frequency, at, column) for column in level.T])
            here = here[np.isfinite(here)]
            if len(here) < LEAST:
                continue
            model = median_threshold(kind, frequency)
            apart.append((frequency, model - np.median(here)))
            points.append((frequency, np.median(here), here.min(), here.max()))
            print(
                f"{frequency:4d} Hz   {np.median(here):5.1f} ({here.min():.1f} to {here.max():.1f}), {len(here):2d}   "
                f"{model:5.1f}   {apart[-1][1]:+5.1f}"
            )
        offset = float(np.median([each for _, each in apart]))
        peak, double = 10.0 ** (offset / 20.0), 10.0 ** ((offset + 6.02) / 20.0)
        print(
            f"     median difference {offset:+.1f} dB: a gain of {peak:.2f} for {name} removes it, if the amplitudes "
            f"are peaks, and {double:.2f} if they are peak to peak\n"
        )
        drawn.append((name, np.array(points)))
    if given.out:
        draw(given.out, drawn)


@style.look()
def draw(path, drawn) -> None:
    """Thresholds [dB re 1 um] over frequency [Hz] of each type, recorded and of the model."""
    figure = style.figure(12.0, 5.0, "Tuning thresholds: one spike per cycle")
    for axes, (name, points) in zip(figure.subplots(1, 2, sharey=True), drawn, strict=True):
        at, middle, low, high = points.T
        axes.errorbar(at, middle, [middle - low, high - middle], fmt="o", color=style.NORMAL, capsize=3,
                      label="recorded: median and range of the units")  # fmt: skip
        model = [median_threshold(KINDS[name], f) for f in at]
        axes.semilogx(at, model, "o-", color=style.FINGER, linewidth=1.5, label="model, published constants")
        axes.set_xticks(at, [f"{f:g}" for f in at])
        axes.set_xticks([], minor=True)
        axes.set(title=name, xlabel="frequency [Hz]", ylabel="amplitude [dB re 1 µm]")
        axes.legend()
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
