"""What launcher, workers and fork server tell one another: typed, and checked where it arrives.

Orders go from the launcher to workers, reports from workers to the launcher, requests from the launcher to the fork
server, and answers back. Each decoder raises `msgspec.DecodeError` for what is none of these.
"""

import msgspec

from palpate.engine.health import Counters
from palpate.engine.job import Job
from palpate.launch.run.wire.keys import Key


class Take(msgspec.Struct, frozen=True, tag=True):
    """To a worker that was started by hand: its job, the name of the run, and its key."""

    job: Job
    run: str


class OutletAddress(msgspec.Struct, frozen=True):
    """An outlet to connect to: whose it is, its address, the streams to read there, for observers or for nodes."""

    group: str
    address: str
    streams: tuple[str, ...]
    observed: bool
    secured: bool


class Connect(msgspec.Struct, frozen=True, tag=True):
    """Read from these outlets. `observed`: how many of the other workers observe each stream of this one."""

    sources: tuple[OutletAddress, ...]
    observed: dict[str, int]


class Go(msgspec.Struct, frozen=True, tag=True):
    """Begin. `origin` [ns]: time of tick 0 on the machine's monotonic clock."""

    origin: int


class Gone(msgspec.Struct, frozen=True, tag=True):
    """These nodes have died, or are back; `blocked`: nodes that cannot go on without them."""

    nodes: tuple[str, ...]
    blocked: tuple[str, ...]
    back: bool = False


class End(msgspec.Struct, frozen=True, tag=True):
    """The run ends after this tick."""

    tick: int


class Stop(msgspec.Struct, frozen=True, tag=True):
    """End in order: nodes at the end of a tick; observers go on until their senders are gone."""


class Close(msgspec.Struct, frozen=True, tag=True):
    """All nodes have ended: observers end when they have what was sent. `lost`: groups that could not say so."""

    lost: tuple[str, ...] = ()


class Quit(msgspec.Struct, frozen=True, tag=True):
    """Nodes end at once."""


class Beat(msgspec.Struct, frozen=True, tag=True):
    """A sign of life for workers on other machines."""


class Hello(msgspec.Struct, frozen=True, tag=True):
    """A worker that was started by hand asks for its job."""


class Starting(msgspec.Struct, frozen=True, tag=True):
    """A node is being started. kernels: how many the worker has compiled so far."""

    node: str
    kernels: int = 0


class Ready(msgspec.Struct, frozen=True, tag=True):
    """All nodes are built. endpoints: addresses by outlet; refused: what the system did not permit."""

    endpoints: dict[str, list[str]]
    refused: list[str] = []
    secured: bool = False


class Linked(msgspec.Struct, frozen=True, tag=True):
    """All readers of its streams are there."""


class Alive(msgspec.Struct, frozen=True, tag=True):
    """A sign of life: the counters of each node, and how many frames were dropped as none of this run's. `awaits`: on
    the simulated clock, the stream and the tick of the message without which the worker cannot go on."""

    nodes: dict[str, Counters]
    foreign: int = 0
    awaits: tuple[str, int] | None = None


class Paused(msgspec.Struct, frozen=True, tag=True):
    """A paced worker waits after this tick to hear which one is the last."""

    tick: int


class NodeFault(msgspec.Struct, frozen=True, tag=True):
    """A node has failed; an empty name stands for the worker as a whole."""

    node: str
    where: str
    text: str
    trace: str = ""


class Note(msgspec.Struct, frozen=True, tag=True):
    """A line that the user should see, once."""

    text: str


class NodesEnded(msgspec.Struct, frozen=True, tag=True):
    """All nodes have ended; what they sent before is being delivered, and, after an orderly end, that it was all."""

    clean_exit: bool


Order = Take | Connect | Go | Gone | End | Stop | Close | Quit | Beat
Report = Hello | Starting | Ready | Linked | Alive | Paused | NodeFault | Note | NodesEnded


class Addressed(msgspec.Struct, frozen=True):
    """A report and who sends it."""

    group: str
    report: Report


class Prepare(msgspec.Struct, frozen=True, tag=True):
    """To the fork server: import these modules."""

    modules: list[str]


class Start(msgspec.Struct, frozen=True, tag=True):
    """To the fork server: fork a worker. key, guarded: as `Bus` takes them."""

    job: Job
    run: str
    control: str
    reports: str
    key: Key | None = None
    guarded: bool = False


class Kill(msgspec.Struct, frozen=True, tag=True):
    """To the fork server: send a signal to a worker."""

    group: str
    signal: int


class Started(msgspec.Struct, frozen=True, tag=True):
    """The fork server has forked this worker."""

    group: str
    pid: int


class Exited(msgspec.Struct, frozen=True, tag=True):
    """A worker's process has ended; `status` as of `os.waitstatus_to_exitcode`."""

    group: str
    status: int


ORDERS = msgspec.json.Decoder(Order)
REPORTS = msgspec.msgpack.Decoder(Addressed)
REQUESTS = msgspec.json.Decoder(Prepare | Start | Kill)
ANSWERS = msgspec.json.Decoder(Started | Exited)
