"""The arguments of `palpate.run`, `steps`, `Ensemble` and the gym as a run, as the options of `palpate run` are."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.organ_file import organ_of
from palpate.launch.load.values.overrides import of_keywords
from palpate.launch.load.values.units import UnitError, convert
from palpate.physics.errors import ArgumentError

Organ = str | Path | Mapping[str, Any] | None


def describe_run(
    graph: str | Path,
    *,
    scene: str | None,
    duration: float | str | None,
    sets: Sequence[str] | Mapping[str, Any],
    nodes: Mapping[str, str | Mapping[str, Any]],
    organ: Organ = None,
) -> LaunchFile:
    """The run that these arguments of `palpate.run` describe, with its organ at its place. GraphError, ArgumentError,
    MeshError: they are invalid."""
    if isinstance(sets, Mapping):
        sets = [f"{path}={value}" for path, value in sets.items()]
    if isinstance(sets, str):
        raise ArgumentError(f"sets: found the text {sets!r}, expected a list of texts, [{sets!r}]")
    return (
        find(str(graph))
        .but(
            overrides=[*sets, *of_keywords(nodes)],
            scene=None if scene is None else find_file(scene, SCENES, what="scene"),
            duration=None if duration is None else _seconds(duration),
            organ=None if organ is None else organ_of(organ),
        )
        .settle_organ()
    )


def _seconds(duration: float | str) -> float:
    try:
        length = convert(str(duration), "s")
    except UnitError as error:
        raise ArgumentError(f"duration: {error}") from None
    if not 1e-9 <= length <= 1e9:
        raise ArgumentError(f"duration: found {duration!r}, expected a time from 1e-9 to 1e9 s")
    return length
