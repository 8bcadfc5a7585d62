"""Launch files: one run with its graph, scene, placement, clock, duration, recording and overrides. Shipped ones are in
`launch/`, one for each shipped graph and a few more. The `run:` of a graph has the same keys, except `graph`, for the
graph's default run.

graph: kidney.yaml
place: two
clock: real
duration: 10 s
record: runs/kidney.mcap       # or what to record, `sources` or `all`, in a file with the launch file's name
set: {tissue.stiffness: 2e3, rate: 500}
organ: liver.stl               # a mesh file instead of the scene's organ; or {file: liver.stl, unit: mm, piece: 2}
                               # or a label of a segmentation: {file: seg.nii.gz, label: liver}
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

import palpate.launch.load
from palpate.engine.faults import Fault, Faults, GraphError, choices
from palpate.engine.graph import Graph
from palpate.engine.plan import Plan
from palpate.launch.load.files import GRAPHS, PLACES, SCENES, Override, find_file
from palpate.launch.load.graph import load
from palpate.launch.load.organ_file import OrganFile, organ_of
from palpate.launch.load.placement import BUILT_IN, Placement, load_place
from palpate.launch.load.plan import plan
from palpate.launch.load.values.lines import fill, quantity
from palpate.launch.load.values.source import YamlSource, read

LAUNCH = Path(next(iter(palpate.launch.load.__path__))).resolve().parent
ALL, SOURCES = RECORDED = ("all", "sources")
"""What a run records: all messages, or only those of its sources, from which a reader recomputes the others."""
_FileName = Annotated[str, msgspec.Meta(description="the name of a file")]


class _RunKeys(msgspec.Struct):
    """The `run:` of a graph, see `LaunchFile`."""

    scene: _FileName | dict[str, Any] | None = None
    place: _FileName | None = None
    clock: Literal["simulated", "real"] | None = None
    duration: Annotated[float, quantity("s", 1e-9, 1e9)] | None = None
    record: Annotated[
        str | None, msgspec.Meta(description=f"the name of a file, as NAME.mcap, or {' or '.join(RECORDED)}")
    ] = None
    set: Annotated[dict[str, Any] | None, msgspec.Meta(description="a mapping such as {tissue.stiffness: 2e3}")] = None
    wanted: Annotated[list[str] | str | None, msgspec.Meta(description="a list of streams")] = None
    pace: Annotated[float, quantity("1", 1e-3, 1e6)] | None = None
    organ: _FileName | dict[str, Any] | None = None


class _LaunchKeys(_RunKeys, kw_only=True):
    graph: _FileName


@dataclass(frozen=True)
class LaunchFile:
    """One run.

    path       the launch file; None: a graph was named
    graph      file of the graph
    scene      file or mapping instead of the scene of the graph
    place      placement, its file, "fused", "auto" (see `placement.auto`), or None: a process per node
    clock      "simulated", "real", or None: real with hardware, else simulated
    duration   [s] None: until stopped
    record     file of the recording, None: no recording
    only       one of `RECORDED`; None: all messages
    pace       [1] simulated time runs at this multiple of real time; None: as fast as the machine allows
    wanted     streams to compute; None: those of scene or graph
    overrides  values set by the user; later ones win
    organ      file instead of the organ of the scene; None: that of the scene's key `organ:`, if it has one
    notes      what was changed for the organ; empty until it is placed
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
    organ: OrganFile | None = None
    notes: tuple[str, ...] = ()

    def load(self) -> Graph:
        """The checked graph of this run. GraphError: all faults. MeshError, SettingError: the organ cannot be used."""
        if self.organ is not None:
            return self.settle_organ().load()
        graph = self.read()
        if graph.organ is not None and not self.notes:
            return self.settle_organ(graph).load()
        graph.other_notes += self.notes
        return graph

    def read(self) -> Graph:
        """The checked graph with the organ of its scene. GraphError: all faults."""
        return load(self.graph, overrides=self.overrides, scene=self.scene, wanted=self.wanted)

    def settle_organ(self, graph: Graph | None = None) -> LaunchFile:
        """The run with the mesh file of its organ, if it has one, as values of its scene, so that it is placed once and
        not at each load. Overrides that are appended later do not move it. Errors as of `load`.

        graph  result of `read`, if known
        """
        organ = self.organ
        if organ is None:
            if self.notes or (given := (graph or self.read()).organ) is None:
                return self
            organ = organ_of(*given)
        organ.check()
        from palpate.launch.load.organ import place_organ  # numba and scipy, which few graphs need

        bare = replace(self, organ=None)
        changes, notes = place_organ(
            lambda changed: replace(bare, overrides=tuple(changed)).read(), self.overrides, organ
        )
        record = self.record and self.record.with_name(f"{organ.stem}.mcap")
        return replace(bare, overrides=(*changes, *self.overrides), record=record, notes=(*self.notes, *notes))

    def plan(self) -> Plan:
        """The plan of this run. GraphError: all faults."""
        return plan(self.load())

    def placement(self, planned: Plan, times: Mapping[str, float] | None = None) -> Placement:
        """The placement of this run. GraphError: all faults of the placement file.

        times  [s] step times of the nodes, for `--place auto`
        """
        return load_place(self.place, planned, times)

    def but(self, **changes: Any) -> LaunchFile:
        """A copy of this run with changes; None changes nothing, and overrides are appended."""
        added = tuple(changes.pop("overrides", ()))
        given = {key: value for key, value in changes.items() if value is not None}
        return replace(self, overrides=self.overrides + added, **given)


def find(name: str) -> LaunchFile:
    """The run of a shipped launch file, or of the path of a launch file or graph.

    GraphError: no such file, or its faults.
    """
    shipped = LAUNCH / f"{name}.yaml"
    ships = "/" not in name and shipped.is_file()
    return _read(shipped if ships else find_file(name, LAUNCH, what="launch file or graph"))


def names() -> list[str]:
    """The shipped launch files."""
    return sorted(path.stem for path in LAUNCH.glob("*.yaml"))


def purpose(launch: LaunchFile) -> str:
    """The comment in the first line of a launch file; empty without one."""
    first = (launch.path or launch.graph).read_text(encoding="utf-8").partition("\n")[0]
    return first.removeprefix("# ") if first.startswith("# ") else ""


def _read(path: Path) -> LaunchFile:
    source = read(path)
    data = source.data
    if isinstance(data, dict) and "graph" in data and "nodes" not in data:
        for key, what in (("over", "study"), ("vary", "experiment")):
            if key in data:
                text = f"{path.name}: found a file for `palpate {what}`, expected a graph or launch file"
                raise GraphError([Fault(text, f"`palpate {what} {path.name}` checks and runs it.")])
        return _run(source, path, _LaunchKeys)
    if isinstance(data, dict) and data.get("run") is not None:
        return replace(_run(source.sub("run"), path, _RunKeys), path=None)
    return _like_its_base(path)


def _run(source: YamlSource, path: Path, kind: type[_RunKeys]) -> LaunchFile:
    """The run of a launch file, or of the `run:` of a graph. GraphError: its faults."""
    data = source.data
    if not isinstance(data, dict):
        text = f"run: found {data!r}, expected a mapping such as {{duration: 2 s}}"
        raise GraphError([Fault(text, place=source.place())])
    faults = Faults()
    given = fill(kind, source, faults) or _RunKeys()
    wanted = (given.wanted,) if isinstance(given.wanted, str) else given.wanted
    record, only = _parse_record(given.record, source, path, faults)

    def file(key: str, name: str, folder: Path) -> Path | None:
        return faults.keep(find_file, name, folder, path.parent, source.place(key), key)

    def scene(named: Any) -> Any:
        if isinstance(named, dict) and isinstance(named.get("extends"), str):
            return {**named, "extends": str(file("scene", named["extends"], SCENES))}
        return file("scene", named, SCENES) if isinstance(named, str) else named

    launch = LaunchFile(
        graph=(file("graph", given.graph, GRAPHS) if isinstance(given, _LaunchKeys) else None) or path,
        path=path,
        scene=scene(given.scene),
        place=given.place if given.place in (None, *BUILT_IN) else file("place", given.place, PLACES),
        clock=given.clock,
        duration=given.duration,
        record=record,
        only=only,
        pace=given.pace,
        wanted=None if wanted is None or given.wanted == "all" else tuple(wanted),
        overrides=tuple(_flat(source.sub("set"), ())) if given.set else (),
        organ=None if given.organ is None else faults.keep(organ_of, given.organ, source.place("organ")),
    )
    faults.done()
    return launch


def _like_its_base(path: Path) -> LaunchFile:
    """The run of a graph without `run:`. A shipped graph has the launch file of its name; another one takes duration
    and recording of the nearest graph that it extends."""
    if path == GRAPHS / path.name and (LAUNCH / path.name).is_file():
        return _read(LAUNCH / path.name)
    try:
        base = _nearest_base(path)
    except GraphError:  # the loader reports it
        base = None
    if base is None:
        return LaunchFile(path)
    record = base.record and Path(f"{path.stem}.mcap")
    return LaunchFile(path, duration=base.duration, record=record, only=base.only)


def _nearest_base(path: Path) -> LaunchFile | None:
    """The run of the nearest graph that this one extends and that has one. GraphError: a missing or faulty file."""
    data, passed = read(path).data, {path}
    while isinstance(data, dict) and isinstance(name := data.get("extends"), str):
        path = find_file(name, GRAPHS, path.parent)
        if path in passed:
            return None
        passed.add(path)
        source = read(path)
        data = source.data
        if isinstance(data, dict) and data.get("run") is not None:
            return _run(source.sub("run"), path, _RunKeys)
        if path == GRAPHS / path.name and (LAUNCH / path.name).is_file():
            return _read(LAUNCH / path.name)
    return None


def _parse_record(given: str | None, source: YamlSource, path: Path, faults: Faults) -> tuple[Path | None, str | None]:
    """File and selection of `record:`. A word of `RECORDED` means a file named after the launch file."""
    if given in RECORDED:
        return Path(f"{path.stem}.mcap"), given
    if given is None:
        return None, None
    if Path(given).suffix == ".mcap":
        return Path(given), None
    faults.add(f"record: found {given!r}, expected the name of a file, as NAME.mcap, or {' or '.join(RECORDED)}",
               choices("Words", given, RECORDED), source.place("record"))  # fmt: skip
    return None, None


def _flat(source: YamlSource, head: tuple[str, ...]) -> list[Override]:
    """Flatten nested mappings to overrides, except a mapping that is the value of a node's setting."""
    overrides = []
    for key, value in source.data.items():
        keys = (*head, *key.split("."))
        nested = isinstance(value, dict) and (keys[0] == "scene" or len(keys) == 1 or keys[1:] == ("in",))
        overrides += _flat(source.sub(key), keys) if nested else [Override(keys, source.sub(key))]
    return overrides
