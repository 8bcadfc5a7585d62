"""Summary of a finished run."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.terminal.output import console, print_json, say
from palpate.launch.run.interrupts import signal_of

if TYPE_CHECKING:
    from palpate.launch.run.execute import RunOutcome


def print_end(outcome: RunOutcome, name: str, folder: Path | None, as_json: bool, quiet: bool) -> None:
    """Print the summary and draw the pictures into a folder, unless it is None."""
    from palpate.launch.run.screen import print_death

    result = outcome.result
    if as_json:
        print_json(_data(outcome, _pictures(outcome, folder, silent=True)))
        return
    if result.ticks or result.ok:
        _summary(outcome, name, quiet)
    for note in (*outcome.plan.graph.notes, *result.notes):
        if note not in result.live:
            say(note, "yellow", wrap=True)
    before = len(result.notes)
    for picture in _pictures(outcome, folder, silent=quiet):
        say(f"picture   {picture}", wrap=True)
    for note in result.notes[before:]:
        say(note, "yellow", wrap=True)
    for death in result.deaths:
        print_death(death, console(stderr=True, soft_wrap=True))


def _summary(outcome: RunOutcome, name: str, quiet: bool) -> None:
    from rich.text import Text

    from palpate.launch.run.screen import table

    out, result = console(), outcome.result
    seconds = result.ticks / outcome.plan.graph.rate
    speed = f", {seconds / result.wall:.2f} x real time" if result.wall > 0 else ""
    took = f" {'interrupted after ' if result.interrupted else ''}{seconds:.3f} s, {result.ticks} ticks in "
    took += f"{result.wall:.2f} s{speed}; first tick {result.start:.2f} s after the start"
    out.print(Text.assemble((name, "bold"), took))
    if result.health and not quiet:
        out.print(table(result))
    if outcome.verdict is not None:
        _judge(outcome)
    for node, reason in () if quiet else outcome.plan.skipped.items():
        say(f"skipped {node}: {reason}", "dim", wrap=True)
    if outcome.recording is not None and outcome.recording.is_file() and result.ticks:
        say(f"recording {outcome.recording} ({outcome.recording.stat().st_size / 1e6:.1f} MB)", wrap=True)


def _judge(outcome: RunOutcome) -> None:
    """Print whether the run kept its rate, what its counters mean, and what would help."""
    from palpate.launch.load.placement import AUTO
    from palpate.launch.run.result import TROUBLES

    verdict = outcome.verdict
    assert verdict is not None
    say(verdict, "green" if verdict.kept else "bold yellow", wrap=True)
    for key, meaning in TROUBLES.items():
        if any(health[key] for health in outcome.result.health.values()):
            say(meaning, "dim", wrap=True)
    if not verdict.kept:
        place = f"try --place {AUTO} (force path in one process); " if outcome.placed != AUTO else ""
        say(f"{place}`palpate doctor` shows what slows this machine", wrap=True)


def _data(outcome: RunOutcome, drawn: list[Path]) -> dict[str, Any]:
    from msgspec.structs import asdict

    result, verdict = outcome.result, outcome.verdict
    return {
        "ok": outcome.ok,
        "ticks": result.ticks,
        "rate": outcome.plan.graph.rate,
        "start": result.start,
        "origin": result.origin,
        "wall": result.wall,
        "interrupted": result.interrupted,
        "verdict": verdict and {**dataclasses.asdict(verdict), "kept": verdict.kept},
        "recording": str(outcome.recording) if outcome.recording else None,
        "nodes": result.health,
        "skipped": outcome.plan.skipped,
        "notes": [*outcome.plan.graph.notes, *result.notes],
        "deaths": [asdict(death) for death in result.deaths],
        "pictures": [str(picture) for picture in drawn],
    }


def _pictures(outcome: RunOutcome, folder: Path | None, silent: bool) -> list[Path]:
    """Draw the pictures of a run that was not interrupted. Without pictures, add the reason to the run's notes."""
    from palpate.records.stored import RecordingError
    from palpate.views.errors import PictureError

    if folder is None or outcome.recording is None or not outcome.recording.is_file() or not outcome.result.ticks:
        return []
    if outcome.result.interrupted:
        outcome.result.notes.append(f"no pictures: interrupted; palpate picture {outcome.recording} draws them")
        return []
    try:
        return standard_pictures(outcome.recording, folder, silent)
    except (RecordingError, PictureError, OSError) as error:
        outcome.result.notes.append(f"no pictures: {error}")
    except KeyboardInterrupt as error:
        outcome.result.notes.append("no pictures: interrupted")
        outcome.result.signal = signal_of(error)
    return []


def standard_pictures(file: Path, folder: Path, silent: bool) -> list[Path]:
    """Draw the pictures of a recording into a folder. Unless silent, print progress, and a line for each picture that
    cannot be drawn. RecordingError, OSError. PictureError: nothing can be drawn; gives the reason."""
    from palpate.launch.run.progress import StageBars
    from palpate.views.errors import PictureError
    from palpate.views.pictures import draw_pictures

    lines: list[str] = []
    with StageBars(silent) as stages:
        done = stages.begin("drawing the pictures", "this takes seconds")
        made = draw_pictures(file, folder, lines.append, done)
    reason = "" if made else lines.pop() if lines else _without_picture(file)
    for text in () if silent else lines:
        say(text, "yellow")
    if reason:
        raise PictureError(reason).as_failure()
    return made


def _without_picture(file: Path) -> str:
    from palpate.messages import Contact
    from palpate.records.reader import Recording

    recording = Recording(file)
    found = [f"{name} ({stream.schema['title']})" for name, stream in recording.streams.items()]
    if any(stream.schema["title"] == Contact.__name__ for stream in recording.streams.values()):
        return f"{file}: nothing to draw: the finger touched nothing"
    names = ", ".join(found) or "no stream"
    return (
        f"{file}: nothing to draw: found {names}, expected Contact, Force, Vibration or Spikes. "
        f"Fields over time: palpate picture {file} STREAM.FIELD"
    )
