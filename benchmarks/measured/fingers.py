"""Presses of people's index fingers and the shipped fingertips, compared without their touch points.

    python benchmarks/measured/fingers.py FOLDER [-o fingers.png]

Reads finger_F1.csv to finger_F4.csv: press, travel [mm], force [N]. The touch points are unknown, so laws are compared
by their stiffness at a force, df/ds = b + m f for an exponential, and by the travel between two forces.
"""

from __future__ import annotations

import numpy as np
from source import parser, presses_of_people

from palpate.models.fit.finger import fit_fingers
from palpate.nodes.contact import Series
from palpate.physics.contact.people import PEOPLE
from palpate.views.pictures import style

FORCES = (0.02, 0.05, 0.1, 0.2)


def main() -> None:
    given = parser(__doc__).parse_args()
    people = presses_of_people(given.folder)
    fitted = fit_fingers(people)
    print(
        f"one m for all: {fitted.hardening:.0f} 1/m; b of each person: "
        + ", ".join(f"{b:.1f}" for b in fitted.stiffness)
        + f" N/m; residual {1e3 * fitted.residual:.1f} mN rms"
    )
    if fitted.intervals:
        print("95 %: " + ", ".join(f"{low:.3g} to {high:.3g}" for low, high in fitted.intervals) + " (b of each, m)")
    laws = {f"person {k + 1}": (b, fitted.hardening) for k, b in enumerate(fitted.stiffness)}
    laws |= {"default": (Series().finger_stiffness, Series().finger_hardening)} | PEOPLE
    print(
        "stiffness b + m f [N/m] at     " + "".join(f"{f:8g} N" for f in FORCES) + "   travel from 0.01 to 0.1 N [mm]"
    )
    for name, (b, m) in laws.items():
        travel = 1e3 / m * np.log((b + m * 0.1) / (b + m * 0.01))
        print(f"{name:30}" + "".join(f"{b + m * f:10.0f}" for f in FORCES) + f"{travel:20.2f}")
    if given.out:
        draw(given.out, laws)


@style.look()
def draw(path, laws) -> None:
    """Force [N] over travel [m] of laws (b [N/m], m [1/m]) by name."""
    figure = style.figure(8.0, 5.0, "Fingertips: force over travel from 0.02 N on")
    axes = figure.subplots()
    f = np.linspace(0.02, 0.4, 100)
    for name, (b, m) in laws.items():
        s = 1e3 / m * np.log((b + m * f) / (b + m * 0.02))
        shipped = not name.startswith("person")
        axes.plot(s, f, label=name if shipped else None, linewidth=2 if shipped else 1,
                  color=None if shipped else style.FAINT)  # fmt: skip
    axes.set(xlabel="travel [mm]", ylabel="force [N]")
    axes.legend(title="grey: fits to four people")
    figure.savefig(path)
    print(f"written {path}")


if __name__ == "__main__":
    main()
