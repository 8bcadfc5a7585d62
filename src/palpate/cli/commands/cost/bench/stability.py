"""`palpate bench stability`: the stiffest virtual wall that a device can render."""

from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.terminal.options import Json, out_option
from palpate.cli.terminal.output import console, print_json, say, table, write
from palpate.launch.run.progress import steps
from palpate.physics.extras import missing

EXAMPLE = "palpate bench stability --mass 0.15 --rate 1000"
PER_SECOND = 1e-3  # [s] computing time of a loop per Hz of its rate: about 200 simulated walls


def stability(
    rate: Annotated[list[float] | None, typer.Option(help="Loop rate, Hz; may be repeated.")] = None,
    delay: Annotated[list[int] | None, typer.Option(help="Delay, whole samples; may be repeated.")] = None,
    damping: Annotated[list[float] | None, typer.Option(help="Damping of the wall, N s/m; may be repeated.")] = None,
    mass: Annotated[float, typer.Option(help="Mass of the device at the grip, kg.")] = 0.1,
    drag: Annotated[float, typer.Option(help="Viscous damping of the device, N s/m.")] = 0.2,
    coulomb: Annotated[float, typer.Option(help="Dry friction of the device, N.")] = 0.0,
    resolution: Annotated[float, typer.Option(help="Encoder resolution, m; 0: exact.")] = 60e-6,
    limit: Annotated[float, typer.Option(help="Largest force of the device, N.")] = 9.0,
    order: Annotated[int, typer.Option("--filter", help="Velocity averaging window (samples).")] = 1,
    lost: Annotated[float, typer.Option(help="Fraction of samples lost; the previous value is reused.")] = 0.0,
    jitter: Annotated[float, typer.Option(help="Relative variation of the step length.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Random seed for lost samples and jitter.")] = 0,
    out: Annotated[Path, out_option("Folder of pictures and tables.")] = Path("stability"),
    as_json: Json = False,
) -> None:
    """Compute the stiffest wall that a device can render.

    Theory: `passive` and `stable` are exact for a linear loop, `quantised` for a spring without delay. Simulation with
    a hand, a unilateral wall and the encoder: `bare` is the largest stiffness, in steps of 1/8 octave, at which the
    oscillation decays without passivity control, `commanded` the largest with the controller, and `controlled` the
    stiffness that the hand feels then.
    """
    from palpate.physics.device.wall_loop import WallDevice
    from palpate.physics.writable import check_folder
    from palpate.studies.stability.walls import StabilityStudy

    device = WallDevice(mass, drag, coulomb, resolution, limit)
    study = StabilityStudy(
        device, rate or [500.0, 1000.0, 4000.0], delay or [0, 1, 2, 5], damping or [0.0, 0.05, 0.1, 0.2], order, lost,
        jitter, seed,
    )  # fmt: skip
    study.check()
    check_folder(out)
    work = sum(one[0] for one in study.cases)
    title = f"bench stability: {len(study.cases)} loops"
    with steps(title, work, silent=as_json, seconds=PER_SECOND * work) as done:
        results = study.run(out, done)
    if as_json:
        print_json(results)
        return
    _print(results["rows"], device)
    write(", ".join(filter(None, (results["table"], results["picture"]))))
    if not results["picture"]:
        say(missing("no pictures", "matplotlib", "view"), err=True)


def _print(rows: list[dict[str, Any]], device: Any) -> None:
    """Print the result in one sentence, then a row for each rate and delay. The files also list every damping."""
    from palpate.studies.stability.walls import SHOWN, answer

    out = console()
    out.print(answer(rows), style="bold")
    names = [name for name in SHOWN if name != "quantised" or device.coulomb]
    cells = []
    for (rate, delay), group in groupby(rows, lambda one: (one["rate"], one["delay"])):
        part = list(group)
        best = [f"{max(one[name] for one in part):.4g}" for name in names]
        cells.append((f"{rate:g}", f"{delay:g}", *best, f"{1e3 * max(one['given_out'] for one in part):.2g}"))
    heads = (">rate\n[Hz]", ">delay\n", *(f">\n{name}" for name in names), ">injected\n[mJ]")
    out.print(table(heads, cells, title="stiffest wall at the best damping [N/m]", fixed=heads))
    out.print(
        "passive, stable: theory of the linear loop, with any passive hand and with none; bare: simulated, without "
        "passivity control; controlled: what the hand feels with it; injected: largest energy given to the hand",
        style="dim",
    )
    if device.resolution and not device.coulomb:
        words = "without dry friction (--coulomb) no wall is strictly passive through an encoder, so `quantised` is 0"
        out.print(words, style="dim")
