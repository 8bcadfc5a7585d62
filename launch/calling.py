"""A run that Python code asks for: from keywords to its opened recording."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.loading.files import SCENES, find_file
from palpate.launch.loading.launchfile import find
from palpate.launch.loading.units import UnitError, convert
from palpate.launch.recording.samples import Run
from palpate.launch.running.execute import execute
from palpate.physics.errors import MISUSE, PalpateError


class CallError(PalpateError, ValueError):
    """An argument that cannot be used; says what was expected."""

    exit_code = MISUSE


class RunFailed(PalpateError, RuntimeError):
    """A node failed during a run; what was recorded before stays in its file."""


def run_and_open(
    graph: str | Path,
    *,
    record: str | Path | None,
    duration: float | str | None,
    scene: str | None,
    clock: str | None,
    sets: Sequence[str],
    nodes: Mapping[str, str | Mapping[str, Any]],
) -> Run:
    """Run a graph and open its recording; the arguments are those of `palpate.run`.

    GraphError, CallError: what is wrong with them. RunFailed: which node failed. RecordingError: nothing was recorded.
    """
    if clock not in (None, "simulated", "real"):
        raise CallError(f"clock: found {clock!r}, expected 'simulated' or 'real'")
    if isinstance(sets, str):
        raise CallError(f"sets: found the text {sets!r}, expected a list of texts, [{sets!r}]")
    name = Path(graph).stem
    launch = find(str(graph)).but(
        overrides=[*sets, *_overrides(nodes)],
        scene=None if scene is None else find_file(scene, SCENES, what="scene"),
        clock=clock,
        duration=None if duration is None else _seconds(duration),
        record=Path(record) if record is not None else _fresh(name),
    )
    if launch.duration is None:
        raise CallError(f"{name}: the graph says no duration, so it would never end; give duration=2.0 [s]")
    outcome = execute(launch)
    if not outcome.result.ok:
        kept = f" What was recorded before is in {outcome.recording}."
        raise RunFailed("; ".join(map(str, outcome.result.deaths)) + kept)
    if not outcome.ok:
        raise RunFailed("; ".join(outcome.result.notes) or f"the recording {outcome.recording} is not whole")
    assert outcome.recording is not None
    return Run(outcome.recording)


def _fresh(name: str) -> Path:
    """The file of a new recording, as `palpate run` names it; a number follows where there is one already."""
    folder = Path("runs") / f"{name}-{datetime.datetime.now():%Y%m%d-%H%M%S}"
    number, free = 1, folder
    while free.exists():
        number += 1
        free = folder.with_name(f"{folder.name}-{number}")
    return free / f"{name}.mcap"


def _overrides(nodes: Mapping[str, str | Mapping[str, Any]]) -> Iterator[str]:
    for name, what in nodes.items():
        if isinstance(what, str):
            yield f"{name}.use={what}"
        elif isinstance(what, Mapping):
            yield from (f"{name}.{key}={_text(f'{name}.{key}', value)}" for key, value in what.items())
        else:
            raise CallError(
                f"{name}: found {what!r}, expected a model, {name}='deformation.ReducedFE', or settings, "
                f"{name}={{'stiffness': 2e3}}"
            )


def _text(name: str, value: Any) -> str:
    """A value as it stands after `--set`: texts with units as they are, all else as JSON, which YAML reads."""
    if isinstance(value, str):
        return value
    try:
        return json.dumps(value.tolist() if hasattr(value, "tolist") else value)
    except TypeError:
        raise CallError(f"{name}: found {type(value).__name__}, expected a number, a text, a list or a dict") from None


def _seconds(duration: float | str) -> float:
    try:
        length = convert(str(duration), "s")
    except UnitError as error:
        raise CallError(f"duration: {error}") from None
    if not 1e-9 <= length <= 1e9:
        raise CallError(f"duration: found {duration!r}, expected a time from 1e-9 to 1e9 s")
    return length
