"""The job of a worker process: nodes, wiring, clock. Plain typed data, sent as JSON."""

import msgspec

from palpate.engine.imports import full_name
from palpate.engine.plan import Plan
from palpate.nodes.base import inputs


class InputJob(msgspec.Struct, frozen=True):
    """One connected input; a port that takes many senders has several.

    every     divisor of the producer
    loop      true for an edge that closes a loop
    optional  the node runs without it after the death of the sender
    rank      position of the producer in the order of execution; -1 for a loop edge
    waits     on the real clock, wait up to one period for this tick's message, because the sender is on the force path
    """

    port: str
    stream: str
    producer: str
    every: int = 1
    loop: bool = False
    optional: bool = False
    rank: int = 0
    waits: bool = True


class NodeJob(msgspec.Struct, frozen=True):
    """One node: full name of its class, settings, inputs, output streams and their wanted fields."""

    name: str
    cls: str
    settings: dict[str, object]
    every: int
    inputs: tuple[InputJob, ...]
    streams: tuple[str, ...]
    wanted: tuple[str, ...] | None = None


class StreamJob(msgspec.Struct, frozen=True):
    """One stream of an observer: full name of the message type, sender and its divisor."""

    type: str
    producer: str
    every: int = 1


class ObserverJob(msgspec.Struct, frozen=True):
    """One observer and its streams."""

    name: str
    cls: str
    settings: dict[str, object]
    streams: dict[str, StreamJob]


class Job(msgspec.Struct, frozen=True):
    """The job of one worker process.

    rate      [Hz] base rate
    ticks     number of ticks of the run; None: until stopped
    pace      simulated time over real time; None: as fast as possible
    links     number of held, required inputs on the force path in all groups. After a death each of them may expire in
              turn, so they share the time limit
    phase     number of the worker, so that workers send their bursts to the observers at different ticks
    leads     true if one of the nodes is paced
    external  streams of this group that other groups read, with the names of those groups
    about     provenance of the run for a recording: graph, settings, versions, machine
    """

    group: str
    nodes: tuple[NodeJob, ...]
    observers: tuple[ObserverJob, ...] = ()
    clock: str = "simulated"
    rate: float = 1000.0
    ticks: int | None = None
    pace: float | None = None
    links: int = 0
    core: tuple[int, ...] | None = None
    priority: int | None = None
    host: str | None = None
    phase: int = 0
    leads: bool = False
    external: dict[str, tuple[str, ...]] = {}
    about: dict[str, object] = {}


def members(job: Job) -> tuple[NodeJob | ObserverJob, ...]:
    """Nodes and observers of a job."""
    return job.nodes + job.observers


def node_job(plan: Plan, name: str, path: set[str]) -> NodeJob:
    """The job of one node. `path`: the nodes of the force path."""
    spec = plan.graph.nodes[name]
    optional = {port.name: port.optional for port in inputs(spec.cls)}
    return NodeJob(
        name=name,
        cls=full_name(spec.cls),
        settings=spec.settings,
        every=spec.every,
        inputs=tuple(
            InputJob(
                port=edge.port,
                stream=edge.stream,
                producer=edge.producer,
                every=plan.graph.nodes[edge.producer].every,
                loop=edge.loop,
                rank=-1 if edge.loop else plan.order.index(edge.producer),
                optional=optional[edge.port],
                waits=edge.producer in path or name not in path,
            )
            for edge in plan.edges[name]
        ),
        streams=tuple(spec.streams),
        wanted=tuple(sorted(plan.fields(name))),
    )


def observer_job(plan: Plan, name: str) -> ObserverJob:
    """The job of one observer."""
    spec = plan.graph.nodes[name]
    senders = {stream: plan.graph.nodes[node] for node in plan.order for stream in plan.graph.nodes[node].streams}
    streams = {
        stream: StreamJob(full_name(plan.graph.streams[stream]), senders[stream].name, senders[stream].every)
        for stream in plan.observers[name]
    }
    return ObserverJob(name=name, cls=full_name(spec.cls), settings=spec.settings, streams=streams)
