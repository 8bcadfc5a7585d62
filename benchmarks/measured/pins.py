"""SA1 and RA1 under gratings of 3 mm at 80 mm/s: the model, and the software of the authors of the published constants.

    git clone https://github.com/hsaal/touchsim
    python benchmarks/measured/pins.py touchsim

Their skin is a half-space under rigid pins, here 0.3 mm apart on a finger of 8 mm radius, pressed until they carry the
force. Both have the same assumed gratings, force and fibres, and receptors within 2 mm of the axis; the model has the
contact area of the finite-element fingertip, and slow adaptation of SA1. PC are left out: an edge passes a column of
pins at 80 mm/s / 0.3 mm = 267 Hz, which they follow.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import numpy as np
from profiles import PERIOD, grating
from sliding import SPEED, feel, fire

PIN, FINGER, NEAR, FIBRES = 0.3, 8.0, 2.0, {"SA1": 4, "RA": 9}  # [mm]
PLACES = [(x, y) for x in (-1.4, -0.5, 0.5, 1.4) for y in (-1.4, -0.5, 0.5, 1.4)]  # [mm] of receptors
FS, SECONDS = 1000.0, 0.6
GRATINGS = [("ridges 1/2", 0.5e-3), ("ridges 1/4", 0.5e-3), ("sinusoid", 0.5e-3), ("ridges 1/2", 0.1e-3)]
FORCE = 0.5  # [N]


def pins(shape: str, height: float) -> list[float]:
    """Mean rates [1/s] of SA1 and RA1 in the authors' software."""
    from touchsim.classes import Afferent, AfferentPopulation, Stimulus
    from touchsim.transduction import skin_touch_profile

    line = np.arange(-17, 18) * PIN
    at = np.array([(x, y) for x in line for y in line if np.hypot(x, y) <= line[-1]])
    s, h = (1e3 * each for each in grating(shape, height))
    moved = 1e3 * SPEED * np.arange(round(SECONDS * FS)) / FS
    relief = np.interp((at[:, :1] + moved) % (1e3 * PERIOD), s, h) - h.max()
    relief -= (at**2).sum(axis=1)[:, None] / (2.0 * FINGER)
    low, high = 0.2, 4.0  # [mm] depth, by bisection of the mean force over one period
    for _ in range(10):
        depth = 0.5 * (low + high)
        carried = skin_touch_profile(np.maximum(relief[:, :38:4] + depth, 0.0), at, FS, PIN / 2.0)[0].sum(axis=1).mean()
        low, high = (depth, high) if carried < FORCE else (low, depth)
    stimulus = Stimulus(trace=np.maximum(relief + depth, 0.0), location=at, fs=FS, pin_radius=PIN / 2.0)
    rates = []
    for kind, count in FIBRES.items():
        units = AfferentPopulation()
        units.afferents += [Afferent(kind, location=np.array(p), idx=n) for n in range(count) for p in PLACES]
        spikes = units.response(stimulus).spikes
        rates.append(float(np.mean([np.sum(np.array(each) > 0.2) for each in spikes])) / (SECONDS - 0.2))
    return rates


def main() -> None:
    if len(sys.argv) != 2 or not (Path(sys.argv[1]) / "touchsim" / "transduction.py").is_file():
        sys.exit("give the folder of a clone of https://github.com/hsaal/touchsim; it is not part of palpate")
    sys.path.insert(0, sys.argv[1])
    warnings.simplefilter("ignore")
    print(f"SA1, RA1 [1/s], {FORCE:g} N: the authors' software, the model")
    for shape, height in GRATINGS:
        found = fire(feel(*grating(shape, height), FORCE, reach=1e-3 * NEAR, kernel="hertz"), "published")
        theirs = pins(shape, height)
        print(
            f"{shape}, {1e3 * height:g} mm: {theirs[0]:.0f}, {theirs[1]:.0f}   {found[0]:.0f}, {found[1]:.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
