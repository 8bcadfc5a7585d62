"""`palpate bench stability`: how stiff a wall, or a body, may be on a device."""

from __future__ import annotations

import math
from itertools import groupby
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.launch.commands.common import Json, console, tell
from palpate.launch.commands.progress import steps

PER_SECOND = 1e-3
"""[s] that a loop takes for each Hz of its rate: some 200 simulated walls."""


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
    from palpate.physics.device.wall_loop import Device
    from palpate.studies.stability.study import Study

    device = Device(mass, drag, coulomb, resolution, limit)
    study = Study(
        device, rate or [500.0, 1000.0, 4000.0], delay or [0, 1, 2, 5], damping or [0.0, 0.05, 0.1, 0.2], order, lost,
        jitter, seed, body or [], plane,
    )  # fmt: skip
    count, work = len(study.cases) + len(study.loops), sum(one[0] for one in study.cases)
    total = work + sum(one[1] for one in study.loops)
    roughly = None if body else PER_SECOND * work
    with steps(f"bench stability: {count} loops", total, silent=as_json, seconds=roughly) as done:
        told = study.run(out, done)
    files = told.pop("files")
    if as_json:
        tell(told)
        return
    _print(told["rows"], device)
    if body:
        _print_bodies(told["bodies"])
    typer.echo(", ".join(filter(None, files)) + ("" if files[1] else "; no pictures without matplotlib: palpate[view]"))


def _print(rows: list[dict[str, Any]], device: Any) -> None:
    """The answer in a sentence, then a row for each rate and delay; the file has one for each damping as well."""
    from palpate.studies.stability.walls import SHOWN, answer

    out = console()
    out.print(answer(rows), style="bold", markup=False)
    names = [name for name in SHOWN if name != "quantised" or device.coulomb]
    table = []
    for (rate, delay), group in groupby(rows, lambda one: (one["rate"], one["delay"])):
        part = list(group)
        best = [f"{max(one[name] for one in part):.4g}" for name in names]
        table.append((f"{rate:g}", f"{delay:g}", *best, f"{1e3 * max(one['given_out'] for one in part):.2g}"))
    heads = ("rate\n\\[Hz]", "delay\n", *(f"\n{name}" for name in names), "given out\n\\[mJ]")
    _table("stiffest wall at the best damping [N/m]", heads, table)
    out.print(
        "passive, stable: theory of the linear loop, with any passive hand and with none; bare: simulated, without the "
        "controller; controlled: what the hand feels with it; given out: energy that it gave to the hand at most",
        style="dim",
    )
    if device.resolution and not device.coulomb:
        out.print("no dry friction is given (--coulomb): seen through an encoder no wall is strictly passive, "
                  "`quantised` is 0", style="dim")  # fmt: skip


def _print_bodies(rows: list[dict[str, Any]]) -> None:
    def stiffness(value: float) -> str:
        return "all rest" if math.isinf(value) else "none rests" if value == 0.0 else f"{value:.4g}"

    table = [
        (row["body"], f"{row['rate']:g}", f"{row['delay']:g}",
         *(stiffness(row[name]) for name in ("stable", "bare", "controlled")), f"{1e3 * row['given_out']:.2g}")
        for row in rows
    ]  # fmt: skip
    heads = ("\nbody", "rate\n\\[Hz]", "\ndelay", "\nstable", "\nbare", "\ncontrolled", "given out\n\\[mJ]")
    _table("stiffest body, N/m at a push of 0.1 N", heads, table)


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    from rich.table import Table

    shown = Table(box=None, pad_edge=False, header_style="bold", title=title, title_justify="left")
    for head in heads:
        shown.add_column(head, justify="left" if head == "\nbody" else "right", no_wrap=True)
    for row in rows:
        shown.add_row(*row)
    console().print(shown)
