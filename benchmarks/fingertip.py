"""The layered fingertip beside the paper's Table III, and which of its statements hold.

    palpate fe fingertip --plate steel --material literal --to runs/fingertip
    palpate fe fingertip --plate silicone --to runs/fingertip
    python benchmarks/fingertip.py runs/fingertip/steel-literal-6-0.2 runs/fingertip/silicone-calibrated-6-0.2

One run on steel serves every divisor of the moduli: on a rigid plate the motion is the same and the force is divided.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from palpate.fe.fingertip import CALIBRATED, PAPER
from palpate.fe.record import Record, fit_divisor, read_record
from palpate.physics.tactile import growth

LOW, HIGH = 0.11, 0.50


def depth(record: Record, force: float) -> float | None:
    """Indentation [mm] at a force; None where the record does not reach it."""
    return 1e3 * record.at(force)[0] if force <= record.force[-1] else None


def statements(steel: Record, silicone: Record) -> list[dict[str, object]]:
    """The paper's statements and what the model gives for both plates between the two forces of Table III."""
    rows: list[dict[str, object]] = []
    at = 1.3e-3
    forces = [r.at_depth(at) for r in (steel, silicone)]
    rows.append({"statement": "force at 1.3 mm, N (lower on silicone)", "steel": forces[0], "silicone": forces[1],
                 "holds": forces[1] < forces[0]})  # fmt: skip
    ends = [(r.at(LOW), r.at(HIGH)) for r in (steel, silicone)]
    area = [1e6 * float(growth(a[1], b[1], LOW, HIGH)) for a, b in ends]
    rows.append({"statement": "area growth, mm²/N (faster on silicone)", "steel": area[0], "silicone": area[1],
                 "holds": area[1] > area[0]})  # fmt: skip
    for k, level in enumerate(steel.levels):
        rate = [1e9 * float(growth(a[2][k], b[2][k], LOW, HIGH)) for a, b in ends]
        rows.append({"statement": f"dV/dP at strain {level:g}, mm³/N (larger on silicone)", "steel": rate[0],
                     "silicone": rate[1], "holds": rate[1] > rate[0]})  # fmt: skip
    return rows


def points(steel: Record, silicone: Record) -> list[dict[str, object]]:
    """Table III: literal, calibrated, paper, in mm."""
    rows: list[dict[str, object]] = []
    for plate, record in (("steel", steel.softened(CALIBRATED)), ("silicone", silicone)):
        for force, paper in PAPER[plate]:
            rows.append({
                "plate": plate, "force N": force, "paper mm": 1e3 * paper, "calibrated mm": depth(record, force),
                "literal mm": depth(steel, force) if plate == "steel" else None,
            })  # fmt: skip
    return rows


def picture(steel: Record, silicone: Record, path: Path) -> None:
    """Force and area curves, and growth of volume against strain, as the paper's Figures 3 and 5."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    _, axes = plt.subplots(1, 3, figsize=(13, 4))
    for name, record, colour in (("steel", steel, "tab:blue"), ("silicone", silicone, "tab:orange")):
        axes[0].plot(1e3 * record.indentation, record.force, color=colour, label=name)
        axes[0].plot([1e3 * d for _, d in PAPER[name]], [f for f, _ in PAPER[name]], "o", color=colour,
                     label=f"{name}, paper")  # fmt: skip
        axes[1].plot(record.force, 1e6 * record.area, color=colour, label=name)
        low, high = record.at(LOW)[2], record.at(HIGH)[2]
        axes[2].plot(record.levels, 1e9 * growth(low, high, LOW, HIGH), "o-", color=colour, label=name)
    for axis, labels in zip(axes, (("indentation [mm]", "force [N]"), ("force [N]", "area [mm²]"),
                                   ("equivalent strain", "dV/dP [mm³/N]")), strict=True):  # fmt: skip
        axis.set_xlabel(labels[0])
        axis.set_ylabel(labels[1])
        axis.legend()
    axes[0].set_ylim(0, 0.8)
    axes[1].set_xlim(0, 0.6)
    plt.tight_layout()
    plt.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("steel", type=Path, help="folder of the literal run on steel")
    parser.add_argument("silicone", type=Path, help="folder of the calibrated run on silicone")
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    steel, silicone = read_record(given.steel), read_record(given.silicone)
    tables = {"Table III": points(steel, silicone), "statements": statements(steel.softened(CALIBRATED), silicone)}
    if given.picture:
        picture(steel.softened(CALIBRATED), silicone, given.picture)
    if given.json:
        json.dump(tables | {"divisor": fit_divisor(steel)}, sys.stdout, indent=2)
        return
    from tables import show

    for title, rows in tables.items():
        show(title, rows)
    print(f"divisor fitted to the steel points: {fit_divisor(steel):.3g} (the calibrated set has {CALIBRATED})")


if __name__ == "__main__":
    main()
