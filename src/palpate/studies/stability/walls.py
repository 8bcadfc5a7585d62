"""Stiffest wall of a device: by theory, and in the simulated loop with and without passivity control."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from palpate.physics.archive import replacing
from palpate.physics.device import stability as theory
from palpate.physics.device.wall_loop import WallDevice, felt_stiffness, run, settles
from palpate.physics.errors import ArgumentError

COLUMNS = {
    "rate": "Hz", "delay": "1", "damping": "N s/m", "passive": "N/m", "stable": "N/m", "quantised": "N/m",
    "bare": "N/m", "controlled": "N/m", "commanded": "N/m", "given_out": "J",
}  # fmt: skip
HIGH = 1e7  # [N/m] Upper bound of the simulated walls
SECONDS = 3.0
"""[s] Duration of the loop with the controller. Without it, oscillations near the stability limit grow or decay slowly:
see `_long`."""
SHOWN = ("passive", "stable", "quantised", "bare", "controlled")


@dataclass(frozen=True)
class StabilityStudy:
    """Settings of a study: rates [Hz], delays [1], wall dampings [N s/m], velocity estimate and faults (see `row`)."""

    device: WallDevice
    rates: Sequence[float]
    delays: Sequence[int]
    dampings: Sequence[float]
    order: int = 1
    lost: float = 0.0
    jitter: float = 0.0
    seed: int = 0

    @property
    def cases(self) -> list[tuple[float, int, float]]:
        return list(product(sorted(self.rates), sorted(self.delays), sorted(self.dampings)))

    def check(self) -> None:
        """ArgumentError: an option is out of range."""
        device = self.device
        for name, value, low, high, expected in (
            ("--mass", device.mass, 1e-6, 1e3, "1e-6 to 1000 kg"),
            ("--drag", device.drag, 1e-6, 1e4, "1e-6 to 10000 N s/m; theory has no bound without drag"),
            ("--coulomb", device.coulomb, 0.0, 1e3, "0 to 1000 N"),
            ("--resolution", device.resolution, 0.0, 1e-2, "0 to 0.01 m"),
            ("--limit", device.limit, 1e-3, 1e4, "0.001 to 10000 N"),
            ("--filter", self.order, 1, 1000, "1 to 1000"),
            ("--lost", self.lost, 0.0, 0.99, "0 to 0.99"),
            ("--jitter", self.jitter, 0.0, 0.99, "0 to 0.99"),
            *(("--rate", f, 1.0, 1e5, "1 to 100000 Hz") for f in self.rates),
            *(("--delay", d, 0, 100, "0 to 100 samples") for d in self.delays),
            *(("--damping", b, 0.0, 1e4, "0 to 10000 N s/m") for b in self.dampings),
        ):
            if not low <= value <= high:
                raise ArgumentError(f"{name}: found {value:g}, expected {expected}")

    def run(self, folder: Path, show: Callable[[str, float], None]) -> dict[str, Any]:
        """Compute and write all rows; returns rows and files, with "" for the picture if matplotlib is missing. `show`
        is called with each loop and its rate [Hz].

        ArgumentError: see `check`. OSError: the folder cannot be written.
        """
        self.check()
        rows: list[dict[str, Any]] = []
        for f, d, b in self.cases:
            rows.append(row(self.device, f, d, b, self.order, self.lost, self.jitter, self.seed))
            show(f"{f:g} Hz, {d} samples late, damping {b:g} N s/m", f)
        table, picture = folder / "stability.csv", folder / "stability.png"
        folder.mkdir(parents=True, exist_ok=True)
        with replacing(table) as part, part.open("w", newline="", encoding="utf-8") as file:
            write = csv.writer(file)
            write.writerow([f"{name} [{unit}]" for name, unit in COLUMNS.items()])
            write.writerows([[f"{one[name]:.6g}" for name in COLUMNS] for one in rows])
        try:
            from palpate.studies.stability.pictures import draw_walls
        except ModuleNotFoundError:
            drawn = ""
        else:
            draw_walls(rows, picture)
            drawn = str(picture)
        return {"table": str(table), "picture": drawn, "rows": rows}


def row(device: WallDevice, rate: float, delay: int, damping: float, order: int, lost: float, jitter: float, seed: int
        ) -> dict[str, float]:  # fmt: skip
    """One row of the table, stiffnesses in N/m.

    Bounds by theory; `bare`: stiffest wall at which the simulated loop comes to rest without the controller;
    `commanded`: the same with the controller; `controlled`: stiffness that the hand feels at that wall. Also the
    largest energy [J] that the loop injected at any wall."""
    period, most = 1.0 / rate, [0.0]
    bare, short = (_steps(rate, seconds, lost, jitter, seed) for seconds in (_long(device), SECONDS))

    def path(stiffness: float, controlled: bool, push: float = 0.5) -> np.ndarray:
        steps, missing = short if controlled else bare
        return run(device, stiffness, damping, controlled=controlled, steps=steps, delay=delay, order=order,
                   lost=missing, push=push)  # fmt: skip

    def settles_at(stiffness: float) -> bool:
        with_controller = path(stiffness, True)
        most[0] = max(most[0], float(with_controller[:, 2].max()))
        return settles(with_controller[:, 0], device.resolution)

    commanded = largest(settles_at)
    pushes = (device.limit / 8.0, device.limit / 2.0)
    return {
        "rate": rate,
        "delay": delay,
        "damping": damping,
        "passive": theory.passive_stiffness(damping, device.drag, period, delay, order),
        "stable": theory.stable_stiffness(damping, device.mass, device.drag, period, delay, order),
        "quantised": theory.quantised_stiffness(device.drag, device.coulomb, period, device.resolution),
        "bare": largest(lambda k: settles(path(k, False)[:, 0], device.resolution)),
        "controlled": felt_stiffness((path(commanded, True, pushes[0]), path(commanded, True, pushes[1])))
        if commanded
        else 0.0,
        "commanded": commanded,
        "given_out": most[0],
    }


def _long(device: WallDevice) -> float:
    """Time [s] for an oscillation near the stability limit to decay or grow: 10 time constants 2 m/b of the free
    device, limited to 3 ... 60 s."""
    return float(min(max(20.0 * device.mass / device.drag, SECONDS), 60.0))


def _steps(rate: float, seconds: float, lost: float, jitter: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Durations [s] of the steps of the loop, and whether each sample is lost."""
    rng = np.random.default_rng(seed)
    steps = (1.0 + jitter * rng.uniform(-1.0, 1.0, round(max(seconds * rate, 600)))) / rate
    return steps, rng.random(len(steps)) < lost


def largest(settled: Callable[[float], bool], low: float = 10.0) -> float:
    """Stiffness [N/m] up to which the loop comes to rest, found upwards in steps of 1/8 octave. `HIGH` if it always
    comes to rest, 0 if it does not for the softest wall."""
    k = low
    while k < HIGH:
        if not settled(k):
            return k * 2**-0.125 if k > low else 0.0
        k *= 2**0.125
    return HIGH


def answer(rows: list[dict[str, float]]) -> str:
    """The stiffest wall at the middle rate and the shortest delay, as a sentence."""
    rates = sorted({one["rate"] for one in rows})
    rate, delay = rates[len(rates) // 2], min(one["delay"] for one in rows)
    part = [one for one in rows if (one["rate"], one["delay"]) == (rate, delay)]
    best = {name: max(one[name] for one in part) for name in SHOWN}
    tried = "all walls tried" if min(one["commanded"] for one in part) >= HIGH else "most walls"
    return (
        f"At {rate:g} Hz and {delay:g} samples of delay this device renders walls up to {best['bare']:.3g} N/m without "
        f"the controller (theory: {best['stable']:.3g}). With it, it renders {tried}; the hand feels at most "
        f"{best['controlled']:.3g} N/m."
    )
