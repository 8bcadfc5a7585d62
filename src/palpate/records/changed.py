"""The plan of a replay: the recorded one, with other settings, or that of another graph."""

import copy
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from palpate.engine.faults import Location
from palpate.engine.graph import Graph
from palpate.engine.imports import UntrustedError, check_trusted, full_name
from palpate.engine.plan import Plan
from palpate.launch.load.classes import body, is_shipped
from palpate.launch.load.effects import trim_fields
from palpate.launch.load.files import Override
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.load.organ import place_organ
from palpate.launch.load.organ_file import OrganFile
from palpate.launch.load.plan import plan
from palpate.launch.load.recording import set_recording
from palpate.launch.load.values.source import YamlSource
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def change_plan(recording: Recording, overrides: Sequence[str] = (), graph: str | None = None) -> Plan:
    """The plan to replay.

    overrides  `tissue.use=deformation.Rigid`, `scene.tissue.friction=off`, ... as for `palpate run`
    graph      another graph instead of the recorded one: its device is played from the recording

    RecordingError, GraphError: the overrides or the graph do not fit the recording.
    """
    if graph is not None:
        loaded = find(graph).but(overrides=overrides).load()
        _match_devices(recording, loaded)
    elif overrides:
        loaded = _recorded_graph(recording, overrides)
    else:
        return plan_of(recording)
    recorded = recording.about.get("plan", {})
    if loaded.rate != (rate := recorded.get("rate", loaded.rate)):
        raise RecordingError(
            f"{recording.path}: recorded at {rate:g} Hz, and a replay keeps these ticks: found "
            f"rate={loaded.rate:g}, expected {rate:g}. A node may run less often: --set NODE.every=2"
        )
    set_recording(loaded, recording.path)  # a logger reads every stream, as in a recorded run
    return _with_fields(plan(loaded), recorded.get("wanted", {}))


def organ_overrides(recording: Recording, organ: OrganFile, overrides: Sequence[str] = ()) -> tuple[list[str], str]:
    """Overrides, as of `--set`, that put a mesh file in the place of the recorded organ, and the notes on it.

    Its top lies where the path of the recorded scene first touches. The recorded motion does not follow its surface.

    RecordingError, GraphError, MeshError, SettingError: the organ or the overrides do not fit the recording.
    """
    changes, notes = place_organ(lambda changed: _recorded_graph(recording, changed), overrides, organ, follow=False)
    return [f"{'.'.join(change.keys)}={json.dumps(change.value.data)}" for change in changes], "\n".join(notes)


def _with_fields(planned: Plan, recorded: Mapping[str, Collection[str]]) -> Plan:
    """The plan with all recorded fields, except those of effects that are off now."""
    nodes = planned.graph.nodes
    kinds = planned.graph.streams
    wanted = {s: names | body(kinds[s]).intersection(recorded.get(s, ())) for s, names in planned.wanted.items()}
    return replace(planned, wanted=trim_fields(wanted, planned.graph.effects, [nodes[name] for name in planned.edges]))


def no_idle(overrides: Sequence[str], plan: Plan, running: Collection[str]) -> None:
    """RecordingError: an override of a node that does not run because its recorded messages are played."""
    for override in overrides:
        path = override.partition("=")[0]
        name = path.partition(".")[0]
        if name in plan.order and name not in running:
            raise RecordingError(
                f"{path}: {name!r} is played from the recording, so this has no effect. A played node runs with "
                f"--only {name}; a source reacts to new forces only in a new run (palpate run)"
            )


def _recorded_graph(recording: Recording, overrides: Sequence[str | Override]) -> Graph:
    recorded = recording.about.get("plan", {})
    if not recorded.get("source"):
        raise RecordingError(f"{recording.path}: it does not contain its graph; give one with --graph GRAPH")
    name = f"the graph in {recording.path}"
    modules = [str(line.get("use")).rpartition(".")[0] for line in recorded["source"].get("nodes", {}).values()]
    try:
        check_trusted(*(module for module in modules if not is_shipped(module)))
    except UntrustedError as error:
        raise RecordingError(f"{recording.path}: {error}") from None

    def with_overrides(given: Sequence[str | Override]) -> Graph:
        return load(
            recorded["path"],
            overrides=given,
            scene=copy.deepcopy(recorded["scene"]),
            wanted=recorded["streams"],
            source=YamlSource(copy.deepcopy(recorded["source"]), {(): Location(name)}),
        )

    graph = with_overrides(overrides)
    _keep_settings(graph, with_overrides(()), plan_of(recording).graph, {_path_of(override) for override in overrides})
    return graph


def _path_of(override: str | Override) -> str:
    return override.partition("=")[0] if isinstance(override, str) else ".".join(override.keys)


def _keep_settings(graph: Graph, defaults: Graph, recorded: Graph, overridden: Collection[str]) -> None:
    """Set settings without an override to their recorded values, since defaults may have changed."""
    for name, spec in graph.nodes.items():
        now, then = defaults.nodes.get(name), recorded.nodes.get(name)
        if now is None or then is None or not spec.cls is now.cls is then.cls:
            continue
        for key in spec.settings.keys() & then.settings.keys():
            if spec.settings[key] == now.settings[key] and f"{name}.{key}" not in overridden:
                spec.settings[key] = then.settings[key]


def _match_devices(recording: Recording, graph: Graph) -> None:
    """Play each source of the graph from the stream with its name, or from the only stream of its type."""
    for name, spec in graph.nodes.items():
        if not spec.cls.paced:
            continue
        for stream, kind in spec.streams.items():
            wanted = full_name(kind)
            fitting = [s.name for s in recording.streams.values() if s.schema["class"] == wanted]
            if stream in fitting:
                continue
            if len(fitting) != 1:
                names = ", ".join(fitting) if fitting else "none"
                raise RecordingError(
                    f"{recording.path}: the source {name!r} of {graph.path.name} sends {kind.__name__}; streams of "
                    f"that type in the recording: {names}. Expected one, or one with the name {stream!r}."
                )
            recording.rename(fitting[0], stream, name)


def sources(recording: Recording, planned: Plan) -> list[str]:
    """The paced nodes of a plan. RecordingError: a stream of theirs is not in the recording."""
    paced = [name for name in planned.order if planned.graph.nodes[name].cls.paced]
    for name in paced:
        for stream in planned.graph.nodes[name].streams:
            if lack := recording.lack(stream):
                raise RecordingError(
                    f"{recording.path}: the stream {stream!r} of the source {name!r}, which drives the graph, {lack}; "
                    "the other streams can be read and exported (`palpate info`, `echo`, `export`)"
                )
    return paced
