"""Launch files: one run with its graph, scene, placement, clock, duration, recording and overrides. The `run:` of a
graph says the same of its usual run, without `graph`.

graph: kidney.yaml
place: two
clock: real
duration: 10 s
record: runs/kidney.mcap       # or `sources`, or `all`: what to record, in a file of this name
set: {tissue.stiffness: 2e3, rate: 500}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate.engine.faults import Faults, GraphError, choices
from palpate.engine.graph import Graph
from palpate.engine.plan import Plan
from palpate.launch.load.files import GRAPHS, PLACES, SCENES, Override, find_file
from palpate.launch.load.graph import load
from palpate.launch.load.placement import BUILT_IN, Placement, load_place
from palpate.launch.load.plan import plan
from palpate.launch.load.values.source import YamlSource, read
from palpate.launch.load.values.units import UnitError, convert

CLOCKS = ("simulated", "real")
ALL, SOURCES = RECORDED = ("all", "sources")
"""What a run records: all messages, or those of its sources, from which a reader computes the others."""
KEYS = ("graph", "scene", "place", "clock", "duration", "record", "set", "wanted", "pace")


@dataclass(frozen=True)
class LaunchFile:
    """One run.

    path       the file, None where a graph was named
    graph      file of the graph
    scene      file or mapping in place of the graph's own scene
    place      placement, its file, "fused", "auto" (see `placement.auto`), or None: a process per node
    clock      "simulated", "real", or None: real with hardware, else simulated
    duration   [s] None: until stopped
    record     file of the recording, None: no recording
    only       what is recorded, of `RECORDED`; None: all messages
    pace       [1] simulated time runs at this multiple of real time; None: as fast as the machine allows
    wanted     streams to compute; None: what scene or graph say
    overrides  values set from outside, the later ones win
    """

    graph: Path
    path: Path | None = None
    scene: Path | dict[str, Any] | None = None
    place: Path | str | Placement | None = None
    clock: str | None = None
    duration: float | None = None
    record: Path | None = None
    pace: float | None = None
    wanted: tuple[str, ...] | None = None
    overrides: tuple[str | Override, ...] = ()
    only: str | None = None

    def load(self) -> Graph:
        """The checked graph of this run. GraphError: whatever is wrong."""
        return load(self.graph, overrides=self.overrides, scene=self.scene, wanted=self.wanted)

    def plan(self) -> Plan:
        """What runs. GraphError: whatever is wrong."""
        return plan(self.load())

    def placement(self, planned: Plan, times: Mapping[str, float] | None = None) -> Placement:
        """Where it runs; step times [s] of the nodes are for `--place auto`. GraphError: whatever is wrong with the
        placement file."""
        return load_place(self.place, planned, times)

    def but(self, **changes: Any) -> LaunchFile:
        """The same run with some things changed; None leaves a thing as it is, overrides are added."""
        added = tuple(changes.pop("overrides", ()))
        given = {key: value for key, value in changes.items() if value is not None}
        return replace(self, overrides=self.overrides + added, **given)


def find(name: str) -> LaunchFile:
    """The run that a name means: that of a graph that ships, or of the path of a launch file or graph.

    GraphError: there is none, or what is wrong with it.
    """
    shipped = GRAPHS / f"{name}.yaml"
    ships = "/" not in name and shipped.is_file()
    return _read(shipped if ships else find_file(name, GRAPHS, what="launch file or graph"))


def names() -> list[str]:
    """Names of the graphs that ship."""
    return sorted(path.stem for path in GRAPHS.glob("*.yaml"))


def _read(path: Path) -> LaunchFile:
    source = read(path)
    data = source.data
    if isinstance(data, dict) and "graph" in data and "nodes" not in data:
        return _run(source, path, KEYS)
    if isinstance(data, dict) and data.get("run") is not None:
        return replace(_run(source.sub("run"), path, KEYS[1:]), path=None)
    return _like_its_base(path, data)


def _run(source: YamlSource, path: Path, keys: tuple[str, ...]) -> LaunchFile:
    """What a launch file says, or the `run:` of a graph. GraphError: what is wrong with it."""
    data = source.data
    faults = Faults()
    if not isinstance(data, dict):
        faults.add(f"run: found {data!r}, expected a mapping such as {{duration: 2 s}}", "", source.place())
        faults.done()
    for key in data:
        if key not in keys:
            faults.add(f"unknown key {key!r}", choices("Keys", str(key), keys), source.place(key))
    clock = data.get("clock")
    if clock is not None and clock not in CLOCKS:
        faults.add(f"clock: found {clock!r}", choices("Clocks", str(clock), CLOCKS), source.place("clock"))
    wanted = data.get("wanted")
    wanted = [wanted] if isinstance(wanted, str) and wanted != "all" else None if wanted == "all" else wanted
    if wanted is not None and not (isinstance(wanted, list) and all(isinstance(w, str) for w in wanted)):
        faults.add(f"wanted: found {wanted!r}, expected a list of streams", "", source.place("wanted"))
        wanted = None
    record, only = _recorded(source, path, faults)
    scene = data.get("scene")
    launch = LaunchFile(
        graph=_file("graph", source, GRAPHS, path, faults) or path,
        path=path,
        scene=scene if isinstance(scene, dict) else _file("scene", source, SCENES, path, faults),
        place=place if (place := data.get("place")) in BUILT_IN else _file("place", source, PLACES, path, faults),
        clock=clock,
        duration=_positive("duration", "s", source, faults),
        record=record,
        only=only,
        pace=_positive("pace", "1", source, faults, least=1e-3, most=1e6),
        wanted=None if wanted is None else tuple(wanted),
        overrides=_overrides(source, faults),
    )
    faults.done()
    return launch


def _like_its_base(path: Path, data: Any) -> LaunchFile:
    """The run of a graph without `run:`: as long as that of the graph that it extends, and recorded like it."""
    file, seen = path, {path}
    while isinstance(data, dict) and isinstance(data.get("extends"), str):
        try:
            file = find_file(data["extends"], GRAPHS, file.parent)
            source = read(file)
            data = source.data
        except GraphError:  # the loader tells it
            break
        if isinstance(data, dict) and data.get("run") is not None:
            run = _run(source.sub("run"), file, KEYS[1:])
            return LaunchFile(
                path, duration=run.duration, record=run.record and Path(f"{path.stem}.mcap"), only=run.only
            )
        if file in seen:
            break
        seen.add(file)
    return LaunchFile(path)


def _recorded(source: YamlSource, path: Path, faults: Faults) -> tuple[Path | None, str | None]:
    """The file of `record:`, and what is recorded. A word of `RECORDED` means a file named like the launch file."""
    given = source.data.get("record")
    if given is None:
        return None, None
    if given in RECORDED:
        return Path(f"{path.stem}.mcap"), given
    if isinstance(given, str) and (Path(given).suffix or "/" in given):
        return Path(given), None
    cure = "" if not isinstance(given, str) else choices("Words", given, RECORDED)
    faults.add(f"record: found {given!r}, expected the name of a file, as NAME.mcap, or {' or '.join(RECORDED)}", cure,
               source.place("record"))  # fmt: skip
    return None, None


def _file(key: str, source: YamlSource, folder: Path, path: Path, faults: Faults) -> Path | None:
    given = source.data.get(key)
    if given is None:
        return None
    if not isinstance(given, str):
        faults.add(f"{key}: found {given!r}, expected the name of a file", "", source.place(key))
        return None
    return faults.keep(find_file, given, folder, path.parent, source.place(key), key)


def _positive(
    key: str, unit: str, source: YamlSource, faults: Faults, least: float = 1e-9, most: float = 1e9
) -> float | None:
    given = source.data.get(key)
    if given is None:
        return None
    try:
        value = convert(given, unit) if isinstance(given, str) else given
        if isinstance(value, bool) or not isinstance(value, int | float) or not (least <= value <= most):
            raise UnitError(f"found {given!r}; expected a number above 0, from {least:g} to {most:g}")
        return float(value)
    except UnitError as error:
        faults.add(f"{key} [{unit}]: {error}", "", source.place(key))
        return None


def _overrides(source: YamlSource, faults: Faults) -> tuple[Override, ...]:
    """`set:` as a mapping of targets, dotted or nested, to values."""
    given = source.data.get("set")
    if given is None:
        return ()
    if not isinstance(given, dict):
        faults.add(
            f"set: found {given!r}, expected a mapping such as {{tissue.stiffness: 2e3}}", "", source.place("set")
        )
        return ()
    return tuple(_flat(source.sub("set"), ()))


def _flat(source: YamlSource, head: tuple[str, ...]) -> list[Override]:
    """Mappings lead on, except one that is the value of a node's setting."""
    overrides = []
    for key, value in source.data.items():
        keys = (*head, *key.split("."))
        leads_on = isinstance(value, dict) and (keys[0] == "scene" or len(keys) == 1 or keys[1:] == ("in",))
        overrides += _flat(source.sub(key), keys) if leads_on else [Override(keys, source.sub(key))]
    return overrides
