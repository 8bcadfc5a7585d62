"""Derivatives of the kidney's force from differences of two runs, with the encoder and with exact positions.

    python benchmarks/derivatives.py [--setting tissue.retardation] [--field contact.force]

For each relative step, the RMS difference of d(force)/d(setting) from its value with exact positions and a step of 1 %,
over the RMS of the latter, in the press, the hold and the release of the shipped kidney (1.8 s).
Prints the table of docs/ensembles.md. Takes seconds.
"""

import argparse
import warnings

import numpy as np

import palpate
from palpate.launch.load.graph import load

STEPS = (0.1, 0.01, 1e-3, 1e-4)
EXACT = ("scene.hand.ideal=true",)
DURATION = 1.8  # [s]


def derivatives(setting: str, field: str, sets: tuple[str, ...]) -> dict[float, np.ndarray]:
    """d(field)/d(setting) (ticks,) by central differences, for each relative step."""
    node, _, name = setting.partition(".")
    usual = load("kidney").nodes[node].settings[name]
    values = [usual * (1.0 + sign * step) for step in STEPS for sign in (-1.0, 1.0)]
    lanes = palpate.Ensemble("kidney", len(values), {setting: values}, [field], sets=sets, duration=DURATION)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", palpate.PalpateWarning)
        found = np.asarray(lanes.run(quiet=True)[field])
    return {step: (found[2 * k + 1] - found[2 * k]) / (2.0 * step * usual) for k, step in enumerate(STEPS)}


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values * values)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--setting", default="tissue.retardation")
    parser.add_argument("--field", default="contact.force")
    given = parser.parse_args()
    exact = derivatives(given.setting, given.field, EXACT)
    true = exact[0.01]
    size = rms(true)
    print(f"d({given.field})/d({given.setting}): {size:.4g} (RMS); error over this")
    print(f"{'step':>8} {'encoder':>10} {'exact':>10}")
    for step, found in derivatives(given.setting, given.field, ()).items():
        print(f"{step:8.2%} {rms(found - true) / size:10.3f} {rms(exact[step] - true) / size:10.2g}")


if __name__ == "__main__":
    main()
