"""`palpate fit finger PRESSES.csv`: the law of a fingertip, from presses of a rigid plate or ball."""

from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import Dialect, Json
from palpate.cli.terminal.output import print_json, say

EXAMPLE = "palpate fit finger presses.csv"


def finger(
    file: Annotated[Path, typer.Argument(help="CSV with units: travel in mm, force in N, and press if several.")],
    dialect: Dialect = "",
    as_json: Json = False,
) -> None:
    """Fit the law of a fingertip to presses against something rigid.

    The zero of the travel is arbitrary; the touch point of each press is fitted. Prints stiffness and hardening with
    95 % intervals from the differences between the presses, and the command that runs a graph with them.
    """
    from palpate.models.fit.finger import fit_fingers, read_presses, undetermined

    notes: list[str] = []
    presses = read_presses(file, notes, dialect)
    fitted = fit_fingers([presses])
    b, m, why = float(fitted.stiffness[0]), fitted.hardening, undetermined(presses, fitted)
    if as_json:
        print_json({
            "ok": True, "presses": len(presses), "finger_stiffness": b, "finger_hardening": m, "rms": fitted.residual,
            "intervals": fitted.intervals, "touch": fitted.touch.tolist(), "notes": notes, "not_determined": why,
        })  # fmt: skip
        return
    for text in notes:
        say(f"{file.name}: {text}", wrap=True)
    ranges = [f" (95 %: {low:.3g} to {high:.3g})" for low, high in fitted.intervals or ()] or ["", ""]
    say(f"{len(presses)} presses, residual {1e3 * fitted.residual:.3g} mN rms", wrap=True)
    stiff = "not determined" if why else f"{b:.4g} N/m{ranges[0]}"
    say(f"finger_stiffness {stiff}, finger_hardening {m:.4g} 1/m{ranges[1] if not why else ''}", wrap=True)
    if why:
        say(why, "yellow", wrap=True)
        return
    if fitted.intervals is None:
        say("intervals need three presses or more", "yellow")
    say(f"palpate run kidney --set scene.finger.finger_stiffness={b:.4g} --set scene.finger.finger_hardening={m:.4g}")
