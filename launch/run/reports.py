"""The control messages of launcher, workers and fork server.

Orders go from the launcher to workers, reports from workers to the launcher, requests from the launcher to the fork
server, and answers back. The decoders check types and raise `msgspec.DecodeError` for anything else.
"""

import signal

import msgspec

from palpate.engine.health import Counters
from palpate.engine.job import Job
from palpate.launch.run.result import NodeFault
from palpate.launch.run.wire.keys import Key
from palpate.launch.run.work.activity import Activity


class Take(msgspec.Struct, frozen=True, tag=True):
    """To a worker that was started by hand: its job, the name of the run, and `tasks.task.sources` of the launcher."""

    job: Job
    run: str
    sources: str


class OutletAddress(msgspec.Struct, frozen=True):
    """An outlet to connect to: its group, address, and the streams to read; `observed`: for observers, not nodes."""

    group: str
    address: str
    streams: tuple[str, ...]
    observed: bool
    secured: bool


class Connect(msgspec.Struct, frozen=True, tag=True):
    """Connect to these outlets, then wait for the readers of this worker: `observed`, number of other workers that
    observe each stream, and the nodes of the job's `external`. A restarted worker (not `awaited`) waits for its
    observers for a limited time, as they may have ended, and for no nodes: they connect later and skip what they miss.
    """

    sources: tuple[OutletAddress, ...]
    observed: dict[str, int]
    awaited: bool = True


class Go(msgspec.Struct, frozen=True, tag=True):
    """Start. `origin` [ns]: time of tick 0 on the launcher's monotonic clock, which shows `sent` [ns]."""

    origin: int
    sent: int


class Gone(msgspec.Struct, frozen=True, tag=True):
    """These nodes have died, or are back; `blocked`: nodes that cannot run without them."""

    nodes: tuple[str, ...]
    blocked: tuple[str, ...]
    back: bool = False


class End(msgspec.Struct, frozen=True, tag=True):
    """The run ends after this tick."""

    tick: int


class Stop(msgspec.Struct, frozen=True, tag=True):
    """Shut down gracefully: nodes end after a tick, observers when their senders have ended."""


class Close(msgspec.Struct, frozen=True, tag=True):
    """All nodes have ended: observers end when they have received all messages. `lost`: groups without a clean exit."""

    lost: tuple[str, ...] = ()


class Quit(msgspec.Struct, frozen=True, tag=True):
    """Shut down the nodes immediately."""


class Beat(msgspec.Struct, frozen=True, tag=True):
    """Heartbeat for workers on other machines. `received`: number of the last report that has arrived; `sent` [ns]:
    time of the launcher's monotonic clock."""

    received: int
    sent: int


class Hello(msgspec.Struct, frozen=True, tag=True):
    """A worker that was started by hand asks for its job."""


class Starting(msgspec.Struct, frozen=True, tag=True):
    """A node is being started. kernels: number compiled so far."""

    node: str
    kernels: int = 0


class Compiling(msgspec.Struct, frozen=True, tag=True):
    """The compiler has begun with a function (`active`), or has ended. It cannot report while it works."""

    active: bool


class InCall(msgspec.Struct, frozen=True, tag=True):
    """Answer to `ASK`, by which the launcher asks a silent worker: the node whose call is running."""

    node: str


class Pulse(msgspec.Struct, frozen=True, tag=True):
    """What the process of a worker on another machine does, from a second process there, about twice a second."""

    found: Activity


class Ready(msgspec.Struct, frozen=True, tag=True):
    """All nodes are built. endpoints: addresses by outlet; refused: privileges that the system denied."""

    endpoints: dict[str, list[str]]
    refused: list[str] = []
    secured: bool = False


class Linked(msgspec.Struct, frozen=True, tag=True):
    """All readers of its streams are connected."""


class Alive(msgspec.Struct, frozen=True, tag=True):
    """Heartbeat: counters of each node. `awaits`: on the simulated clock, stream and tick of the message that blocks
    the worker."""

    nodes: dict[str, Counters]
    awaits: tuple[str, int] | None = None


class Paused(msgspec.Struct, frozen=True, tag=True):
    """A paced worker waits after this tick, or in it for a message, for the number of the last tick."""

    tick: int


class Note(msgspec.Struct, frozen=True, tag=True):
    """A line for the user, about a node ("": about the run), at a time [s] on the graph's clock."""

    text: str
    node: str = ""
    time: float = 0.0


class Observes(msgspec.Struct, frozen=True, tag=True):
    """The nodes of a worker have ended, and its observers still receive messages of other groups."""


class NodesEnded(msgspec.Struct, frozen=True, tag=True):
    """All nodes have ended; their messages are being delivered, after a clean exit with an end-of-stream marker."""

    clean_exit: bool


Order = Take | Connect | Go | Gone | End | Stop | Close | Quit | Beat
Report = (
    Hello
    | Starting
    | Compiling
    | InCall
    | Pulse
    | Ready
    | Linked
    | Alive
    | Paused
    | NodeFault
    | Note
    | Observes
    | NodesEnded
)


class Addressed(msgspec.Struct, frozen=True):
    """A report and the group that sends it. `number` of the report, if it is sent again until it has arrived."""

    group: str
    report: Report
    number: int = 0


REPEATED = (Ready, Linked, Paused, NodeFault, Note, Observes, NodesEnded)
"""Reports that a worker on another machine numbers and sends again, as its connection may break."""


class Prepare(msgspec.Struct, frozen=True, tag=True):
    """To the fork server: import these modules."""

    modules: list[str]


class Start(msgspec.Struct, frozen=True, tag=True):
    """To the fork server: fork a worker. key, guarded: see `Bus`."""

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
    """A worker's process has ended; `status` as in `os.waitstatus_to_exitcode`, `REPORTED` after a reported failure."""

    group: str
    status: int


KILL = int(getattr(signal, "SIGKILL", 9))  # numbers for `Kill`; Windows has no names for them
ASK = int(getattr(signal, "SIGUSR1", 10))
"""It prints the traceback of a worker and has it report the node whose call is running."""
REPORTED = 70  # exit code of a worker that has reported its failure, as EX_SOFTWARE in sysexits.h

ORDERS = msgspec.json.Decoder(Order)
REPORTS = msgspec.msgpack.Decoder(Addressed)
REQUESTS = msgspec.json.Decoder(Prepare | Start | Kill)
ANSWERS = msgspec.json.Decoder(Started | Exited)
