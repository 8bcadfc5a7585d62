"""Force, stiffness and generated energy by the delay of a network between the hand and a remote kidney.

    python benchmarks/remote.py [--picture FILE] [--json]

The graph `remote` (press, hold, release) on simulated time with three controllers: without passivity control, with
passivity control that ignores the delay (`controller.delay=0`), and with the delay set. Printed for each run:

    generated       max of -E with the work of the hand on the display E = sum of -F . dx [J]
    beyond drag     max of -(E + b int |v|^2 dt): the part that the drag b of grip and fingers does not dissipate
    force error     RMS over the run of |F - F_0|, % of the peak of F_0, the force without delay
    felt stiffness  mean F over mean depth of the grip [N/m] during the hold; bound: b/t + 0.01 m/t^2, t = T (d + 1/2)
    peak to peak    motion of the grip during the hold
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.progress import track
from tables import parser, print_tables

from palpate.calling import describe_run
from palpate.nodes.controller import Haptic
from palpate.nodes.device import Simulated
from palpate.stepping import Stepper

DELAYS = (0, 1, 2, 5, 10, 20, 30, 50, 70, 100)
"""[ms] each way."""
CASES = ((20, 20, 0.3), (100, 0, 0.2), (100, 50, 0.9), (100, 100, 0.3))
"""Delay, jitter [ms] and loss [1] on a bad network."""
CONTROLLERS = {"none": (False, False), "delay unknown": (True, False), "delay known": (True, True)}
HELD = slice(1500, 2000)
"""Ticks of the hold."""
TOUCH = 0.109
"""[m] Height of the grip at first contact of finger and kidney."""


def press(delay: float, jitter: float, loss: float, controller: str) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Force on the hand [N] and position of the grip [m] (k,3) after each tick, and the controller's settings for mass
    [kg] and drag [N s/m]; delay and jitter [s]."""
    passive, known = CONTROLLERS[controller]
    network = {"delay": delay, "jitter": jitter, "loss": loss}
    sets = [f"scene.network.{name}={value}" for name, value in network.items()]
    sets += [f"controller.passivity={str(passive).lower()}", f"controller.delay={round(2e3 * delay) if known else 0}"]
    stepper = Stepper(describe_run("remote", scene=None, duration=None, sets=sets, nodes={}))
    stepper.start()
    device, display = stepper.node("device"), stepper.node("controller")
    assert isinstance(device, Simulated) and isinstance(display, Haptic)
    forces, places = [], []
    for _ in range(stepper.last or 3000):
        forces.append(stepper.tick().controller.force)  # type: ignore[union-attr]
        places.append(device.own["motion"]["position"].copy())
    stepper.stop()
    return np.array(forces), np.array(places), display.mass, display.drag


def energies(force: np.ndarray, place: np.ndarray, drag: float, dt: float = 1e-3) -> tuple[float, float]:
    """Energy [J] that the display generates, and the part that the drag does not dissipate.

    The force of a tick acts until the next tick.
    """
    moved = np.diff(place, axis=0)
    work = -np.cumsum(np.einsum("ij,ij->i", force[:-1], moved))
    dragged = np.cumsum(drag * np.einsum("ij,ij->i", moved, moved) / dt)
    return max(0.0, -float(work.min())), max(0.0, -float((work + dragged).min()))


def row(delay: float, jitter: float, loss: float, controller: str, free: np.ndarray) -> dict[str, object]:
    """One row of a table; delay and jitter [ms]; free: the force [N] (k,3) without delay."""
    force, place, mass, drag = press(delay * 1e-3, jitter * 1e-3, loss, controller)
    generated, beyond = energies(force, place, drag)
    late = 1e-3 * ((round(2 * delay) if controller == "delay known" else 0) + 0.5)
    figures: dict[str, object] = {"delay [ms]": delay}
    figures |= {"jitter [ms]": jitter, "loss": loss} if jitter or loss else {}
    figures |= {"controller": controller, "generated [mJ]": 1e3 * generated, "beyond drag [mJ]": 1e3 * beyond}
    error = np.sqrt(np.mean(np.sum((force - free) ** 2, axis=1))) / np.linalg.norm(free, axis=1).max()
    felt = float(np.mean(force[HELD, 2]) / (TOUCH - np.mean(place[HELD, 2])))
    bound = drag / late + 0.01 * mass / late**2 if controller == "delay known" else None
    figures |= {"force error [%]": 100 * float(error), "felt stiffness [N/m]": felt, "bound [N/m]": bound}
    return figures | {"peak to peak [mm]": 1e3 * float(np.ptp(place[HELD, 2]))}


def draw(rows: list[dict[str, object]], file: Path) -> None:
    """Draw the picture of docs/delay.md."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    for column, axis in zip(("generated [mJ]", "force error [%]", "felt stiffness [N/m]"), axes, strict=True):
        for name in CONTROLLERS:
            curve = [each for each in rows if each["controller"] == name]
            axis.plot([e["delay [ms]"] for e in curve], [e[column] for e in curve], "o-", ms=3, label=name)
        axis.set(xlabel="delay each way [ms]", ylabel=column)
    axes[0].set_yscale("symlog", linthresh=1.0)
    axes[0].set(title="energy that the hand receives", ylim=(-0.2, 1e3))
    axes[1].set_title("force error, RMS, % of peak")
    known = [each for each in rows if each["controller"] == "delay known" and each["delay [ms]"]]
    axes[2].plot([e["delay [ms]"] for e in known], [e["bound [N/m]"] for e in known], "k:", label="b/t + 0.01 m/t²")
    axes[2].set(title="stiffness felt during the hold", ylim=(0, 250))
    lines, names = axes[2].get_legend_handles_labels()
    figure.legend(lines, names, title="passivity control", loc="outside right center", frameon=False)
    figure.savefig(file, dpi=110)


def main() -> None:
    options = parser(__doc__)
    options.add_argument("--picture", type=Path, help="draw the picture into this file")
    given = options.parse_args()
    free, *_ = press(0.0, 0.0, 0.0, "delay known")
    steady = [(float(delay), 0.0, 0.0, name) for delay in DELAYS for name in CONTROLLERS]
    bad = [(*map(float, case), name) for case in CASES for name in CONTROLLERS]
    rows = [row(*case, free) for case in track([*steady, *bad], transient=True)]
    print_tables({"Delay": rows[: len(steady)], "Jitter and loss": rows[len(steady) :]}, given.json, digits=3)
    if given.picture:
        draw(rows[: len(steady)], given.picture)


if __name__ == "__main__":
    main()
