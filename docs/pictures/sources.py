"""Draw what the sources of palpate draw of their runs: python docs/pictures/sources.py [folder]

path.png               path of the finger over the kidney: `palpate run kidney`
friction.png           normal force, friction, and its part across the motion: `palpate run kidney`
display-4-newtons.png  profiles and states of the display: `palpate run softness --scene softness-4-newtons`
digit.png              commanded depth and predicted force of a digit: `palpate run digit`
tissues-kidney.png     the law of the shipped kidney: `palpate list tissues kidney-assumed -o tissues-kidney.png`
moving-average.png     gain, delay and noise of the moving average over eight points, and of the observer
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from palpate.launch.testing import FakeBus
from palpate.messages import DeviceState
from palpate.nodes.kinematics import Cartesian
from palpate.views.pictures.models.tissues import draw_tissues
from palpate.views.pictures.style import FAINT, FRICTION, INK, NORMAL, figure, log_ticks, look, save

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RUNS = {
    "path.png": ("kidney", "path", ()),
    "friction.png": ("kidney", "friction", ()),
    "display-4-newtons.png": ("softness", "profiles", (), "softness-4-newtons"),
    "digit.png": ("digit", "band", ()),
}
"""As in softness.py."""
RATE, COUNT = 1025.0, 60e-6  # [Hz] mean rate of the kidney study; [m] resolution of its device
SPEED = 20e-3  # [m/s] of the finger whose velocity is drawn
AMPLITUDE = 2e-3  # [m] of the motion for gain and delay
FREQUENCIES = np.geomspace(1.0, 250.0, 70)  # [Hz]
NULL = RATE / 8.0  # [Hz] of the average, above which its phase jumps
FILTERS = {
    "as measured": ({"resolution": 0.0}, FAINT),
    "moving average, 8": ({"average": 8}, FRICTION),
    "observer (default)": ({"resolution": COUNT}, NORMAL),
}
"""Label -> settings of the node, colour."""


def follow(places: np.ndarray, settings: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and velocities [m/s] (n) that a node computes from positions (n), read in whole counts."""
    bus = FakeBus(Cartesian(**settings), rate=RATE)
    read = np.round(places / COUNT) * COUNT
    poses = bus.publish(*[DeviceState(position=(place, 0.0, 0.0)) for place in read.tolist()])
    return tuple(np.array([getattr(pose, name)[0] for pose in poses]) for name in ("position", "velocity"))


def response(frequency: float, settings: dict[str, float]) -> complex:
    """The fundamental of the position of a sinusoidal motion, over that of the motion."""
    count = round(max(12 * RATE / frequency, 600))
    angle = 2.0 * math.pi * frequency * np.arange(count) / RATE
    late = slice(count // 3, None)  # after the start
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    seen = follow(AMPLITUDE * waves[:, 0], settings)[0]
    a, b = np.linalg.lstsq(waves[late], seen[late], rcond=None)[0]
    return complex(a, -b) / AMPLITUDE


@look()
def moving_average(path: Path) -> None:
    """Gain and delay over the frequency, and the velocity of a steady motion."""
    out = figure(13.2, 4.6, "Moving average over eight points and observer, 1025 Hz, counts of 60 µm")
    gain, delay, noise = out.subplots(1, 3)
    for label, (settings, colour) in FILTERS.items():
        found = np.array([response(frequency, settings) for frequency in FREQUENCIES])
        gain.plot(FREQUENCIES, 20.0 * np.log10(np.maximum(abs(found), 1e-3)), color=colour, label=label)
        below = (NULL if "average" in settings else np.inf) > FREQUENCIES
        delay.plot(FREQUENCIES[below], np.degrees(np.unwrap(np.angle(found[below]))), color=colour, label=label)
        _velocity(noise, label, settings, colour)
    corner = 0.44596 * NULL
    gain.axvline(corner, color=INK, linewidth=0.8, linestyle=":")
    gain.text(corner * 0.95, 2.0, f"−3 dB of the average\n{corner:.0f} Hz", fontsize=9, ha="right")
    gain.set(xlabel="frequency [Hz]", ylabel="gain of the position [dB]", ylim=(-30.0, 6.0), xlim=(1.0, 250.0))
    delay.set(xlabel="frequency [Hz]", ylabel="phase of the position [°]", ylim=(-200.0, 20.0), xlim=(1.0, 250.0))
    for axes in (gain, delay):
        log_ticks(axes)
    gain.legend(loc="lower left", fontsize=9)
    noise.set(xlabel="time [s]", ylabel="velocity [mm/s]", xlim=(0.5, 0.6), ylim=(-20.0, 115.0))
    noise.legend(loc="upper left", fontsize=9)
    noise.set_title("a steady motion of 20 mm/s", fontsize=11)
    save(out, path)


def _velocity(axes: Axes, label: str, settings: dict[str, float], colour: str) -> None:
    time = np.arange(round(0.7 * RATE)) / RATE
    speed = follow(SPEED * time, settings)[1]
    late = time > 0.3
    scatter = 1e3 * float(speed[late].std())
    axes.plot(time, 1e3 * speed, color=colour, linewidth=1.2, label=f"{label}: ± {scatter:.1f} mm/s")


def main(folder: Path) -> list[Path]:
    """Run, draw, compute."""
    from softness import copy_pictures

    made = copy_pictures(folder, RUNS)
    made += draw_tissues("kidney-assumed", folder / "tissues-kidney.png")
    moving_average(folder / "moving-average.png")
    return [*made, folder / "moving-average.png"]


if __name__ == "__main__":
    from target import folder

    for written in main(folder(__doc__)):
        print(written)
