"""`palpate export`: a recording in the formats of other tools, or as a complete recording."""

import os
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.terminal.options import File, Json, Trust, one_of, out_option
from palpate.cli.terminal.output import print_json, say
from palpate.physics.errors import TROUBLE

EXAMPLE = "palpate export runs/kidney.mcap --to csv"
MCAP = "mcap"


def export(
    file: File,
    to: Annotated[
        str,
        typer.Option(
            help="foxglove, parquet, csv, lerobot; wav, hjif: texture; nwb: spikes; gltf: organ; mcap: whole recording."
        ),
    ],
    out: Annotated[Path | None, out_option("Folder (parquet, csv, lerobot) or file; default: next to FILE.")] = None,
    stream: Annotated[list[str] | None, typer.Option(help="Only this stream; may be repeated.")] = None,
    every: Annotated[
        int | None,
        typer.Option(help="Only every n-th message.", min=1),
    ] = None,
    subject: Annotated[
        list[str] | None,
        typer.Option(
            help="With --to nwb: subject_id=S1, age=P30Y, sex=F, species=...; may be repeated.", metavar="KEY=VALUE"
        ),
    ] = None,
    fps: Annotated[int | None, typer.Option(help="With --to lerobot: frames per second; default: 30.", min=1)] = None,
    touch_rate: Annotated[
        float | None, typer.Option(help="With --to lerobot: touch samples per second; default: 150.", min=1)
    ] = None,
    camera: Annotated[
        bool, typer.Option("--camera", help="With --to lerobot: a picture of each frame from the side.")
    ] = False,
    full: Annotated[
        bool, typer.Option("--full", help="With --to mcap, of a recording of sources: compute and write all messages.")
    ] = False,
    trust: Trust = None,
    as_json: Json = False,
) -> None:
    """Write a recording for other tools, or repair a truncated one.

    Writes MCAP with JSON (Foxglove, PlotJuggler), Parquet or CSV; poses and touch as a data set of LeRobot; the
    vibration of a texture as sound (WAV) or as MPEG haptics (.hjif, ISO/IEC 23090-31); the spikes of afferents as NWB;
    the organ's surface with its stiffness, friction and texture as glTF (MPEG_haptic_material). With --to mcap: a
    complete recording from the readable part of a truncated or damaged one. Exit code 1 if a message that --full
    computes differs from the recorded one; the messages before it are written.
    """
    if to == MCAP:
        if stream or every:
            raise typer.BadParameter("--to mcap writes all messages; leave out --stream and --every")
        _recover(file, out, full, as_json)
        return
    if full:
        raise typer.BadParameter(f"--full is for --to mcap, found --to {to}")
    from palpate.records.export import FORMATS
    from palpate.records.export import export as write
    from palpate.records.reader import Recording

    one_of("--to", to, *FORMATS, MCAP)
    recording = Recording(file)
    written = write(
        recording, to, out, stream or (), every=every, subject=_pairs(subject or []), fps=fps, touch_rate=touch_rate,
        camera=camera,
    )  # fmt: skip
    if as_json:
        files = [str(path) for path in written]
        print_json({"ok": True, "files": files, "complete": recording.complete, "ending": recording.ending})
        return
    size = sum(path.stat().st_size for path in written)
    where = os.path.commonpath(written)
    say(f"{where}: {len(written)} file{'s' * (len(written) != 1)}, {size / 1e6:.2f} MB", wrap=True)
    if not recording.complete:
        say(recording.ending, "yellow")


def _pairs(given: list[str]) -> dict[str, str]:
    """BadParameter: not KEY=VALUE."""
    for text in given:
        if not all(text.partition("=")[::2]):
            raise typer.BadParameter(f"--subject: found {text!r}, expected KEY=VALUE, such as subject_id=S1")
    return dict(text.split("=", 1) for text in given)


def _recover(file: Path, out: Path | None, full: bool, as_json: bool) -> None:
    from palpate.records.fill import explain_difference, recover, recover_full
    from palpate.records.reader import Recording

    if full:
        target, counts, report = recover_full(file, out)
        wrong = explain_difference(file, report, Recording(file).about) if report.first is not None else ""
    else:
        (target, counts), wrong = recover(file, out), ""
    if as_json:
        print_json({"ok": not wrong, "file": str(target), "counts": counts, "difference": wrong or None})
    else:
        say(f"{target}: {sum(counts.values())} messages of {len(counts)} streams", wrap=True)
        if wrong:
            say(wrong, "red", err=True)
    if wrong:
        raise typer.Exit(TROUBLE)
