"""Tuning thresholds of recorded RA and PC afferents, those of the model, and the calibration of the model on them.

    python benchmarks/measured/thresholds.py FOLDER [-o thresholds.png]

Reads thresholds_RA.csv and thresholds_PC.csv: frequency [Hz], then one column per unit [um]. The constant ends of a
column, outside the range of the unit's curve, are left out. A threshold is the amplitude at which a fibre fires once
per cycle; that of the model is the peak amplitude of a flat probe of 0.5 mm. The sources do not say whether theirs is
the peak or the peak to peak, which is 6 dB.

The calibration, of `constants: calibrated` of tactile.Afferents, has two factors per type. The shape of a curve is its
level relative to its mean over the frequencies that the curves of all units reach, so that a unit whose curve ends
early does not change the level of the others. The factor of the cut-off frequency brings the median of the model's
shapes closest to that of the units (RMS over the frequencies), that of the input its median level. The intervals are
those of 400 draws of the units with replacement.
"""

from __future__ import annotations

import numpy as np
from source import FINGERS, parser, table

from palpate.physics.afferents.calibrated import CONSTANTS, adjust
from palpate.physics.afferents.probe import tuning_threshold
from palpate.views.pictures import style

FREQUENCIES = {
    "RA": (5, 10, 20, 30, 40, 60, 80, 100, 130, 150, 200),
    "PC": (20, 30, 40, 60, 80, 100, 150, 200, 250, 290),
}
KINDS = {"RA": 1, "PC": 2}
LEAST = 5  # units at a frequency
FACTORS = 2.0 ** (np.arange(-8, 9) / 4.0)
"""[1] Of the cut-off frequency."""


def units(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] (n), rising, and thresholds [dB re 1 um] (n, units), NaN outside the curve of a unit."""
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    level = 20.0 * np.log10(rows[:, 1:])
    for column in level.T:
        moves = np.flatnonzero(np.abs(np.diff(column)) > 0.01)
        column[: moves[0]], column[moves[-1] + 2 :] = np.nan, np.nan
    return rows[:, 0], level


def thresholds(kind: int, frequencies: np.ndarray, fits: tuple[np.ndarray, ...]) -> np.ndarray:
    """[dB re 1 um] (frequencies, fibres) of the model."""
    return np.array([[tuning_threshold(kind, n, f, fits=fits) for n in range(len(fits[kind]))] for f in frequencies])


def shape_and_level(level: np.ndarray, everywhere: np.ndarray) -> tuple[np.ndarray, float]:
    """Median over the columns of curves (n, columns) relative to their mean over the rows `everywhere`, and of that
    mean [dB]."""
    mean = level[everywhere].mean(axis=0)
    return np.nanmedian(level - mean, axis=1), float(np.median(mean))


def fit(recorded: np.ndarray, model: np.ndarray) -> tuple[int, np.ndarray, float]:
    """Index of the factor of the cut-off whose shape is closest, the RMS [dB] of each, and its level above the recorded
    one [dB], from curves (n, units) and those of the model with each factor (factors, n, fibres)."""
    everywhere = np.isfinite(recorded).all(axis=1)
    shape, level = shape_and_level(recorded, everywhere)
    made = [shape_and_level(each, everywhere) for each in model]
    apart = np.array([np.sqrt(np.nanmean((each - shape) ** 2)) for each, _ in made])
    best = int(apart.argmin())
    return best, apart, made[best][1] - level


def calibrate(name: str, frequencies: np.ndarray, recorded: np.ndarray) -> None:
    """Print the factors of a type and their intervals."""
    kind, same = KINDS[name], int(np.flatnonzero(FACTORS == 1.0)[0])
    model = np.array([thresholds(kind, frequencies, adjust((1.0, x, x), (1.0, 1.0, 1.0))) for x in FACTORS])
    best, apart, above = fit(recorded, model)
    everywhere = np.isfinite(recorded).all(axis=1)
    kept = shape_and_level(model[same], everywhere)[1] - shape_and_level(recorded, everywhere)[1]
    numbers = np.random.default_rng(0)
    draws = []
    for _ in range(400):
        drawn = recorded[:, numbers.integers(recorded.shape[1], size=recorded.shape[1])]
        if np.isfinite(drawn).any(axis=1).all():
            n, _, level = fit(drawn, model)
            draws.append((FACTORS[n], level))
    cut, level = np.percentile(draws, [2.5, 97.5], axis=0).T
    print(f"     shape: {apart[same]:.1f} dB RMS from the recorded one with the published cut-off, {apart[best]:.1f} "
          f"with {FACTORS[best]:.2f} times that (95 % of draws: {cut[0]:.2f} to {cut[1]:.2f})")  # fmt: skip
    for what, x, db in (("this cut-off", FACTORS[best], above), ("the published cut-off", 1.0, kept)):
        print(f"     gain with {what} ({x:.2f}): {10 ** (db / 20):.2f}, if the amplitudes are peaks, "
              f"{10 ** ((db + 6.02) / 20):.2f} if they are peak to peak")  # fmt: skip
    print(f"     95 % of draws: gain (peaks) {10 ** (level[0] / 20):.2f} to {10 ** (level[1] / 20):.2f}\n")


def main() -> None:
    given = parser(__doc__).parse_args()
    read = {name: units(table(given.folder, f"thresholds_{name}.csv", FINGERS, 3)[1]) for name in KINDS}
    drawn = []
    for name, kind in KINDS.items():
        at, level = read[name]
        recorded = np.array([[np.interp(f, at, column) for column in level.T] for f in FREQUENCIES[name]])
        reached = np.isfinite(recorded).sum(axis=1) >= LEAST
        frequencies, recorded = np.array(FREQUENCIES[name])[reached], recorded[reached]
        model = {which: np.median(thresholds(kind, frequencies, CONSTANTS[which]), axis=1) for which in CONSTANTS}
        print(f"{name}   [dB re 1 um]   measured: median (least to most) of n units   "
              + "   ".join(f"{which}: model, model - measured" for which in CONSTANTS))  # fmt: skip
        points = []
        for n, frequency in enumerate(frequencies):
            here = recorded[n][np.isfinite(recorded[n])]
            points.append((frequency, np.median(here), here.min(), here.max()))
            found = "   ".join(f"{each[n]:5.1f}, {each[n] - np.median(here):+5.1f}" for each in model.values())
            print(
                f"{frequency:4d} Hz   {np.median(here):5.1f} ({here.min():.1f} to {here.max():.1f}), {len(here):2d}   "
                + found
            )
        calibrate(name, frequencies, recorded)
        drawn.append((name, np.array(points), model))
    if given.out:
        draw(given.out, drawn)


@style.look()
def draw(path, drawn) -> None:
    """Thresholds [dB re 1 um] over frequency [Hz] of each type, recorded and of the model."""
    figure = style.figure(12.0, 5.0, "Tuning thresholds: one spike per cycle")
    for axes, (name, points, model) in zip(figure.subplots(1, 2, sharey=True), drawn, strict=True):
        at, middle, low, high = points.T
        axes.errorbar(at, middle, [middle - low, high - middle], fmt="o", color=style.NORMAL, capsize=3,
                      label="recorded: median and range of the units")  # fmt: skip
        for (which, level), colour in zip(model.items(), (style.FINGER, style.TISSUE), strict=True):
            axes.semilogx(at, level, "o-", color=colour, linewidth=1.5, label=f"model, constants: {which}")
        marks = [f for f in at if f not in (30, 80, 130, 290)]
        axes.set_xticks(marks, [f"{f:g}" for f in marks])
        axes.set_xticks([], minor=True)
        axes.set(title=name, xlabel="frequency [Hz]", ylabel="amplitude [dB re 1 µm]")
        axes.legend()
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
