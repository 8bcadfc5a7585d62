"""`palpate bench stability`: how stiff a wall may be on a device, by theory and in the simulated loop."""

from __future__ import annotations

import csv
from itertools import groupby, product
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.launch.commands.common import Json, console, tell
from palpate.launch.commands.progress import steps
from palpate.physics.errors import MISUSE, PalpateError

COLUMNS = {
    "rate": "Hz", "delay": "1", "damping": "N s/m", "passive": "N/m", "stable": "N/m", "quantised": "N/m",
    "bare": "N/m", "controlled": "N/m", "commanded": "N/m", "given_out": "J",
}  # fmt: skip
HIGH = 1e7
"""[N/m] The stiffest wall that is tried."""
PER_SECOND = 1e-3
"""[s] that a loop takes for each Hz of its rate: some 200 simulated walls."""
SECONDS = 3.0
"""[s] of the loop with the controller; without it a swing near the border grows or decays slowly, see `_long`."""


class StabilityError(PalpateError, ValueError):
    """Options that describe no device."""

    exit_code = MISUSE


def stability(
    rate: Annotated[list[float] | None, typer.Option(help="Rate of the loop, Hz; may be given again.")] = None,
    delay: Annotated[list[int] | None, typer.Option(help="Whole samples of delay; may be given again.")] = None,
    damping: Annotated[list[float] | None, typer.Option(help="Of the wall, N s/m; may be given again.")] = None,
    mass: Annotated[float, typer.Option(help="Of the device's grip, kg.")] = 0.1,
    drag: Annotated[float, typer.Option(help="Of the device, N s/m.")] = 0.2,
    coulomb: Annotated[float, typer.Option(help="Dry friction of the device, N.")] = 0.0,
    resolution: Annotated[float, typer.Option(help="Step of the device's position, m; 0: exact.")] = 60e-6,
    limit: Annotated[float, typer.Option(help="Greatest force of the device, N.")] = 9.0,
    order: Annotated[int, typer.Option("--filter", help="Differences in the mean that is the velocity.")] = 1,
    lost: Annotated[float, typer.Option(help="Share of samples that repeat the one before.")] = 0.0,
    jitter: Annotated[float, typer.Option(help="Share by which the length of a step varies.")] = 0.0,
    seed: Annotated[int, typer.Option(help="Of lost samples and jitter.")] = 0,
    body: Annotated[
        list[str] | None, typer.Option(help="A body in place of the wall: deformation.ReducedFE; may be given again.")
    ] = None,
    plane: Annotated[
        bool, typer.Option("--regions", help="Also the plane of drag and dry friction, with the encoder.")
    ] = False,
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder of pictures and tables.")] = Path("stability"),
    as_json: Json = False,
) -> None:
    """The stiffest wall that a device can hold: by theory, and simulated with and without the controller.

    `passive` and `stable` are exact for a linear loop, `quantised` for a spring without delay. `bare` is the simulated
    loop with a hand, a wall that lets go, and the encoder: the last stiffness, on eighths of an octave, at which the
    swing decays. `controlled` is the stiffness that the hand feels with the controller at the stiffest such wall,
    `commanded`. A body is made stiffer by all of its moduli; its stiffness is that at a push of 0.1 N, `stable` by the
    poles with its own damping.
    """
    from palpate.launch.commands import stability_more as more
    from palpate.physics.device.wall_loop import Device

    device = Device(mass, drag, coulomb, resolution, limit)
    rates, delays, dampings = rate or [500.0, 1000.0, 4000.0], delay or [0, 1, 2, 5], damping or [0.0, 0.05, 0.1, 0.2]
    _check(device, rates, delays, dampings, order, lost, jitter)
    if plane and not resolution:
        raise StabilityError("--regions: found --resolution 0, expected an encoder: the plane has its step in it")
    cases = list(product(sorted(rates), sorted(delays), sorted(dampings)))
    rows = []
    work = sum(f for f, _, _ in cases)
    with steps(f"bench stability: {len(cases)} loops", work, silent=as_json, seconds=PER_SECOND * work) as done:
        for f, d, b in cases:
            rows.append(row(device, f, d, b, order, lost, jitter, seed))
            done(f"{f:g} Hz, {d} samples late, damping {b:g} N s/m", weight=f)
    out.mkdir(parents=True, exist_ok=True)
    table = out / "stability.csv"
    with table.open("w", newline="", encoding="utf-8") as file:
        write = csv.writer(file)
        write.writerow([f"{name} [{unit}]" for name, unit in COLUMNS.items()])
        write.writerows([[f"{one[name]:.6g}" for name in COLUMNS] for one in rows])
    files = [str(table), _picture(rows, out / "stability.png")]
    told: dict[str, Any] = {"table": str(table), "picture": files[1], "rows": rows}
    if body:
        told["bodies"] = more.bodies(device, body, rates, delays, as_json)
        more.write_bodies(told["bodies"], out / "bodies.csv")
        files += [str(out / "bodies.csv"), more.draw_bodies(told["bodies"], out / "bodies.png")]
    if plane:
        period = 1.0 / sorted(rates)[len(rates) // 2]
        told["regions"] = more.regions(device, 2.0 * drag / period, period)
        files.append(more.draw_regions(told["regions"], device, period, out / "regions.png"))
    if as_json:
        tell(told)
        return
    _print(rows, device)
    if body:
        more.print_bodies(told["bodies"])
    typer.echo(", ".join(filter(None, files)) + ("" if files[1] else "; no pictures without matplotlib: palpate[view]"))


def _check(device: Any, rates: list[float], delays: list[int], dampings: list[float], order: int, lost: float,
           jitter: float) -> None:  # fmt: skip
    for name, value, low, high, expected in (
        ("--mass", device.mass, 1e-6, 1e3, "1e-6 to 1000 kg"),
        ("--drag", device.drag, 1e-6, 1e4, "1e-6 to 10000 N s/m; theory has no bound without drag"),
        ("--coulomb", device.coulomb, 0.0, 1e3, "0 to 1000 N"),
        ("--resolution", device.resolution, 0.0, 1e-2, "0 to 0.01 m"),
        ("--limit", device.limit, 1e-3, 1e4, "0.001 to 10000 N"),
        ("--filter", order, 1, 1000, "1 to 1000"),
        ("--lost", lost, 0.0, 0.99, "0 to 0.99"),
        ("--jitter", jitter, 0.0, 0.99, "0 to 0.99"),
        *(("--rate", f, 1.0, 1e5, "1 to 100000 Hz") for f in rates),
        *(("--delay", d, 0, 100, "0 to 100 samples") for d in delays),
        *(("--damping", b, 0.0, 1e4, "0 to 10000 N s/m") for b in dampings),
    ):
        if not low <= value <= high:
            raise StabilityError(f"{name}: found {value:g}, expected {expected}")


def row(device: Any, rate: float, delay: int, damping: float, order: int, lost: float, jitter: float, seed: int
        ) -> dict[str, float]:  # fmt: skip
    """One row of the table: bounds on the stiffness [N/m] by theory; up to where the simulated loop comes to rest
    without the controller (`bare`); with it, the stiffest wall at which it does (`commanded`), the stiffness that is
    felt there (`controlled`), and the most energy [J] that the loop gave to the hand at any wall."""
    import numpy as np

    from palpate.physics.device import stability as theory
    from palpate.physics.device.wall_loop import felt_stiffness, run, settles

    period, most = 1.0 / rate, [0.0]
    bare, short = (_steps(rate, seconds, lost, jitter, seed) for seconds in (_long(device), SECONDS))

    def path(stiffness: float, controlled: bool, push: float = 0.5) -> np.ndarray:
        steps, missing = short if controlled else bare
        return run(device, stiffness, damping, controlled=controlled, steps=steps, delay=delay, order=order,
                   lost=missing, push=push)  # fmt: skip

    def held(stiffness: float) -> bool:
        with_controller = path(stiffness, True)
        most[0] = max(most[0], float(with_controller[:, 2].max()))
        return settles(with_controller[:, 0], device.resolution)

    commanded = largest(held)
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


def _long(device: Any) -> float:
    """[s] after which a swing near the border of stability has decayed or grown: ten time constants 2 m/b of the free
    device, within 3 to 60 s."""
    return float(min(max(20.0 * device.mass / device.drag, SECONDS), 60.0))


def _steps(rate: float, seconds: float, lost: float, jitter: float, seed: int) -> tuple[Any, Any]:
    """Lengths [s] of the steps of the loop, and which samples are lost."""
    import numpy as np

    rng = np.random.default_rng(seed)
    steps = (1.0 + jitter * rng.uniform(-1.0, 1.0, round(max(seconds * rate, 600)))) / rate
    return steps, rng.random(len(steps)) < lost


def largest(settled: Any, low: float = 10.0) -> float:
    """The first stiffness [N/m] at which a loop no longer comes to rest, on eighths of an octave; `HIGH` where there is
    none, 0 where the softest does not."""
    k = low
    while k < HIGH:
        if not settled(k):
            return k * 2**-0.125 if k > low else 0.0
        k *= 2**0.125
    return HIGH


SHOWN = ("passive", "stable", "quantised", "bare", "controlled")


def _print(rows: list[dict[str, float]], device: Any) -> None:
    """The answer in a sentence, then a row for each rate and delay; the file has one for each damping as well."""
    from rich.table import Table

    out = console()
    out.print(answer(rows), style="bold", markup=False)
    shown = Table(box=None, pad_edge=False, header_style="bold", title="stiffest wall at the best damping [N/m]",
                  title_justify="left")  # fmt: skip
    names = [name for name in SHOWN if name != "quantised" or device.coulomb]
    for title in ("rate\n\\[Hz]", "delay\n", *(f"\n{name}" for name in names), "given out\n\\[mJ]"):
        shown.add_column(title, justify="right", no_wrap=True)
    for (rate, delay), group in groupby(rows, lambda one: (one["rate"], one["delay"])):
        part = list(group)
        best = [f"{max(one[name] for one in part):.4g}" for name in names]
        shown.add_row(f"{rate:g}", f"{delay:g}", *best, f"{1e3 * max(one['given_out'] for one in part):.2g}")
    out.print(shown)
    out.print(
        "passive, stable: theory of the linear loop, with any passive hand and with none; bare: simulated, without the "
        "controller; controlled: what the hand feels with it; given out: energy that it gave to the hand at most",
        style="dim",
    )
    if device.resolution and not device.coulomb:
        out.print("no dry friction is given (--coulomb): seen through an encoder no wall is strictly passive, "
                  "`quantised` is 0", style="dim")  # fmt: skip


def answer(rows: list[dict[str, float]]) -> str:
    """How stiff a wall may be, in a sentence, at the middle rate and the least delay."""
    rates = sorted({one["rate"] for one in rows})
    rate, delay = rates[len(rates) // 2], min(one["delay"] for one in rows)
    part = [one for one in rows if (one["rate"], one["delay"]) == (rate, delay)]
    best = {name: max(one[name] for one in part) for name in SHOWN}
    tried = "any wall that was tried" if min(one["commanded"] for one in part) >= HIGH else "most walls"
    return (
        f"At {rate:g} Hz and {delay:g} samples of delay this device holds walls up to {best['bare']:.3g} N/m without "
        f"the controller (theory: {best['stable']:.3g}); with it, {tried}, of which the hand feels at most "
        f"{best['controlled']:.3g} N/m."
    )


def _picture(rows: list[dict[str, float]], path: Path) -> str:
    """Left: stiffness over damping at the middle rate and least delay. Right: stiffness over delay at each rate. The
    path of the picture, "" where matplotlib is missing."""
    try:
        from palpate.views.pictures.style import ENERGY, FINGER, NORMAL, SPEED, figure

        drawn = figure(11.0, 5.0, "How stiff a wall the device can hold")
    except ModuleNotFoundError:
        return ""
    left, right = drawn.subplots(1, 2)
    rates = sorted({one["rate"] for one in rows})
    delay, rate = min(one["delay"] for one in rows), rates[len(rates) // 2]
    plane = [one for one in rows if one["rate"] == rate and one["delay"] == delay]
    lines = (
        ("passive", NORMAL, "-", "passive, theory"),
        ("stable", SPEED, "-", "stable, theory"),
        ("bare", FINGER, "o", "simulated, bare"),
        ("controlled", ENERGY, "^", "felt with the controller"),
    )
    for name, colour, mark, label in lines:
        points = [(one["damping"], one[name]) for one in plane if one[name] > 0.0]
        left.plot(*zip(*points, strict=True) if points else ([], []), mark, color=colour, label=label)
    left.set(xlabel="damping of the wall  B  [N s/m]", ylabel="stiffness of the wall  K  [N/m]", yscale="log",
             title=f"{rate:g} Hz, {delay:g} samples of delay")  # fmt: skip
    left.legend(loc="best")
    least = min(one["damping"] for one in rows)
    for f, width in zip(rates, (0.8, 1.6, 2.6, 3.4, 4.2), strict=False):
        part = [one for one in rows if one["rate"] == f and one["damping"] == least]
        for name, colour, mark, _ in lines:
            points = [(one["delay"], one[name]) for one in part if one[name] > 0.0]
            right.plot(*zip(*points, strict=True) if points else ([], []), mark, color=colour, linewidth=width,
                       markersize=3 + 1.5 * width)  # fmt: skip
        right.annotate(f"{f:g} Hz", (part[0]["delay"], max(part[0]["stable"], 1.0)), fontsize=9)
    right.set(xlabel="delay [samples]", yscale="log", title=f"B = {least:g} N s/m; thicker: faster")
    drawn.savefig(path)
    return str(path)
