"""The arguments of `palpate.run`, `steps`, `Ensemble` and the gym as a run, as the options of `palpate run` are."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.load.organ_file import organ_of
from palpate.launch.load.values.overrides import of_keywords
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError, convert

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
    check_texts("sets", sets, "tissue.stiffness=2e3")
    if scene is not None:
        scene = str(check_path("scene", scene))
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


def check_path(name: str, given: Any) -> Path:
    """An argument that names a file or folder. ArgumentError: it is no text and no path."""
    if not isinstance(given, str | Path) or "\0" in str(given):
        raise ArgumentError(f"{name}: found {given!r}, expected the name of a file or folder")
    return Path(given)


def check_texts(name: str, given: Any, example: str) -> None:
    """ArgumentError: an argument is not a list of texts."""
    if isinstance(given, str) or not isinstance(given, Sequence) or not all(isinstance(one, str) for one in given):
        raise ArgumentError(f"{name}: found {given!r}, expected a list of texts, such as [{example!r}]")


def check_over(given: Any) -> None:
    """ArgumentError: an argument is not a mapping."""
    if not isinstance(given, Mapping):
        raise ArgumentError(f"over: found {given!r}, expected what varies, such as {{'tissue.stiffness': [200, 400]}}")


def _seconds(duration: float | str) -> float:
    try:
        length = convert(str(duration), "s")
    except UnitError as error:
        raise ArgumentError(f"duration: {error}") from None
    if not 1e-9 <= length <= 1e9:
        raise ArgumentError(f"duration: found {duration!r}, expected a time from 1e-9 to 1e9 s")
    return length
