"""The main function of a worker process, from its job to its last report."""

import contextlib
import faulthandler
import os
import signal
import socket
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from types import FrameType

import msgspec
import zmq
from zmq.utils.monitor import recv_monitor_message

from palpate.engine import clock
from palpate.engine.clock import Silence, real_time
from palpate.engine.imports import load_class
from palpate.engine.job import Job
from palpate.engine.slot import NodeError
from palpate.launch.run import reports
from palpate.launch.run.assign import cores_of
from palpate.launch.run.descendants import die_with_parent
from palpate.launch.run.result import NodeFault
from palpate.launch.run.wire.addresses import has_unix_sockets, is_tcp
from palpate.launch.run.wire.bus import LONGEST_ORDER, Bus, split
from palpate.launch.run.wire.keys import Key
from palpate.launch.run.work.activity import ENDED, Activity, activity
from palpate.launch.run.work.compiling import compiler_watched
from palpate.launch.run.work.far_clock import FarClock
from palpate.launch.run.work.fused import death
from palpate.launch.run.work.heartbeat import REPORT
from palpate.launch.run.work.loops import run
from palpate.launch.run.work.offered import refusal
from palpate.launch.run.work.watchdog import running_node
from palpate.launch.run.work.worker import ORPHANED, EndedError, Worker
from palpate.nodes.base import Node
from palpate.physics.errors import RunError

WAIT = 200  # [ms] for an order before tick 0, between two heartbeats
PULSE = 0.5  # [s] between two reports of what a worker that was started by hand does
LAST_PULSE = 0.5  # [s] from its end to the report of it, so that its last report arrives before
LINGER = 1000  # [ms] to send this report


def serve(start: reports.Start, alone: bool = False) -> int:
    """Set this process up and run a job in it; returns the exit code, see `work`.

    alone  the worker is not a child of the launcher: end on Ctrl-C, and without heartbeats of the launcher
    """
    if not alone:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the launcher decides when to stop
    faulthandler.enable(file=2, all_threads=False)  # prints a traceback if compiled code crashes
    if hasattr(os, "register_at_fork"):
        os.register_at_fork(after_in_child=die_with_parent)  # children of a node end with it
    job = start.job
    real = job.clock == "real"
    local = has_unix_sockets() and not alone
    bus = Bus(start.run, job.group, start.control, start.reports, real, job.external, start.key, start.guarded, local)
    _answer_when_silent(bus)
    return work(job, bus, alone)


def work(job: Job, bus: Bus, alone: bool, claim: Callable[..., list[str]] = real_time) -> int:
    """Run a job: build, report ready, connect, report linked, wait for the start, run, report the end.

    claim  takes the core and the priority for this process, and returns what the system refused

    Returns the exit code: 0, or 1 after a failure, which is reported with its traceback.
    """
    worker, begun, clean_exit, stack = None, None, False, contextlib.ExitStack()
    try:
        worker = Worker(job, bus, bus.report, alone)
        stack.enter_context(compiler_watched(lambda active: bus.report(reports.Compiling(active))))
        worker.start()
        refused = claim(job.core, job.priority if job.clock == "real" else None)
        endpoints = bus.bind(job.host)
        bus.report(reports.Ready(endpoints, refused, bool(job.host and bus.key)))
        with contextlib.suppress(EndedError):
            begun = _link(bus, worker.launcher_clock)
            run(worker, *begun)
        worker.stop()
        clean_exit = begun is not None
        return 0
    except (NodeError, RunError, KeyboardInterrupt) as error:
        stopped = NodeFault("", "process", str(error) or "stopped by its user")
        bus.report(death(error) if isinstance(error, NodeError) else stopped)
        if worker is not None:
            try:
                worker.stop()
            except NodeError as second:  # printed, so that it does not replace the first
                print(f"a second failure while stopping: {second}", file=sys.stderr)
        if isinstance(error, KeyboardInterrupt):
            raise
        return 1
    except Exception as error:
        # System errors need no traceback.
        trace = "" if isinstance(error, OSError) else traceback.format_exc()
        bus.report(NodeFault("", "process", f"{type(error).__name__}: {error}", trace))
        return 1
    finally:
        stack.close()
        bus.end(clean_exit)
        bus.close(clean_exit, _orphan_check(bus, alone))


def _orphan_check(bus: Bus, alone: bool) -> Callable[[], bool]:
    """Returns whether the launcher of a worker that was started by hand (`alone`) has ended; call it often."""
    launcher = Silence()

    def ended() -> bool:
        while alone and bus.order(1) is not None:
            launcher.reset()
        return alone and launcher.poll() > ORPHANED

    return ended


def _answer_when_silent(bus: Bus) -> None:
    """At SIGUSR1, which Windows lacks, print the traceback, also from compiled code, and report the node whose call is
    running."""
    if not hasattr(signal, "SIGUSR1"):
        return

    def answer(_: int, frame: FrameType | None) -> None:
        if node := running_node(frame):
            bus.report(reports.InCall(node))

    signal.signal(signal.SIGUSR1, answer)
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=False, chain=True)


def _link(bus: Bus, far: FarClock | None) -> tuple[int, set[str]]:
    """Connect to the other workers and wait for the start, with heartbeats. Returns the time of tick 0 [ns] and the
    groups that the observers here read. EndedError: the run ended before. RunError, for a worker that was started by
    hand (with `far`): the launcher sends nothing, or names a local socket."""
    senders: set[str] = set()
    alone = far is not None
    launcher, reported = Silence(), clock.now()

    def poll(wait: int = 0) -> reports.Order | None:
        nonlocal reported
        order = bus.order(wait)
        if isinstance(order, reports.Stop | reports.Quit | reports.Close):
            raise EndedError
        if order is not None:
            launcher.reset()
            if far is not None and isinstance(order, reports.Beat | reports.Go):
                far.hear(order.sent)
        elif alone and launcher.poll() > ORPHANED:
            raise RunError("the launcher sent nothing for 5 s; it has ended, or the network was interrupted")
        if clock.now() - reported > REPORT:
            reported = clock.now()
            bus.report(reports.Alive({}))
        return order

    while True:
        match poll(WAIT):
            case reports.Connect(sources, observed, awaited):
                for source in sources:
                    if alone and not is_tcp(source.address):
                        raise RunError(f"the launcher names {source.address}, expected an address tcp://host:port")
                    bus.connect(source.address, source.streams, source.observed, source.secured, source.group)
                senders = {source.group for source in sources if source.observed}
                bus.wait_linked(observed, poll, awaited)
                bus.report(reports.Linked())
            case reports.Go(origin):
                return origin if far is None else far.begin(origin), senders


MISMATCH = zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
REFUSED = MISMATCH | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_AUTH
FAREWELL = 2000  # [ms] for the report of a refusal
NO_RETRY = 3  # refusals after which to give up; a launcher that ends during the handshake causes fewer


def join(address: str, group: str, patience: float, key: Key | None = None) -> int:
    """Run a group as a worker of a launcher on another machine; returns the exit code.

    address   of the launcher, `tcp://host:port`
    patience  [s] to wait for the launcher
    key       encrypts the run; None: no encryption

    RunError: no launcher answers, it has a different key, or its job is refused (`offered`).
    """
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    orders_at, reports_at = f"tcp://{host}:{port}", f"tcp://{host}:{int(port) + 1}"
    take: reports.Take | None = None
    with zmq.Context() as context, context.socket(zmq.SUB) as incoming, context.socket(zmq.PUSH) as outgoing:
        incoming.set(zmq.MAXMSGSIZE, LONGEST_ORDER)
        for end in (incoming, outgoing):
            end.set(zmq.LINGER, 0)
            if key is not None:
                key.secure(end, server=False)
        faults = outgoing.get_monitor_socket(REFUSED)
        refusals = 0
        incoming.subscribe(f"~join-{group}".encode() + b"\0")
        incoming.connect(orders_at)
        outgoing.connect(reports_at)
        for _ in range(max(1, round(patience / 0.25))):
            # libzmq drops a refused connection, and a blocking send would never return
            with contextlib.suppress(zmq.Again):
                outgoing.send(msgspec.msgpack.encode(reports.Addressed(group, reports.Hello())), zmq.NOBLOCK)
            while faults.poll(0):
                refusals += NO_RETRY if recv_monitor_message(faults)["event"] == MISMATCH else 1
            if refusals >= NO_RETRY:
                raise RunError(f"{address} refuses the connection: its key is different, or only one side is encrypted")
            if incoming.poll(250):
                with contextlib.suppress(msgspec.MsgspecError, ValueError):  # another order, or not of a launcher
                    order = split(incoming.recv())[1].partition(b" ")[2]
                    take = msgspec.json.decode(order, type=reports.Take)
                    break
        else:
            what = "" if key is None else " and has the same key"
            raise RunError(f"no launcher at {address} that waits for group {group!r}{what}")
        assert take is not None
        if (fault := refusal(take.job, take.sources)) is not None:
            outgoing.set(zmq.LINGER, FAREWELL)
            with contextlib.suppress(zmq.Again):
                outgoing.send(msgspec.msgpack.encode(reports.Addressed(group, fault)), zmq.NOBLOCK)
            raise RunError(f"the launcher at {address}: {fault}")
    job = take.job
    if job.core is None and job.priority is not None:  # on the force path; the launcher may have other cores
        alone = all(load_class(node.cls, Node).paced for node in job.nodes)
        job = msgspec.structs.replace(job, core=cores_of(True, alone, groups=2))
    job = msgspec.structs.replace(job, host=job.host or _address_towards(host))
    with _pulse(reports_at, group, key):
        return serve(reports.Start(job, take.run, orders_at, reports_at, key, key is not None), alone=True)


@contextlib.contextmanager
def _pulse(address: str, group: str, key: Key | None) -> Iterator[None]:
    """While the block runs, a second process reports to the launcher what this one does: also while this one computes
    without reports, is stopped, or has been killed. No effect without `fork`."""
    if not hasattr(os, "fork"):
        yield
        return
    watched = os.getpid()
    helper = os.fork()
    if not helper:
        try:
            _report_activity(watched, address, group, key)
        finally:
            os._exit(0)
    try:
        yield
    finally:
        os.kill(helper, signal.SIGKILL)
        os.waitpid(helper, 0)


def _report_activity(watched: int, address: str, group: str, key: Key | None) -> None:
    """Report what the parent does until it has ended."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):  # a reader of the parent's output does not wait for this process
        os.dup2(nowhere, stream)
    with zmq.Context() as context, context.socket(zmq.PUSH) as outgoing:
        outgoing.set(zmq.LINGER, LINGER)
        if key is not None:
            key.secure(outgoing, server=False)
        outgoing.connect(address)
        found: Activity | None = None
        while found is None or found.state != ENDED:
            time.sleep(PULSE)
            found = activity(watched)
            if os.getppid() != watched:
                time.sleep(LAST_PULSE)
                found = Activity(ENDED)
            if found is not None:
                report = msgspec.msgpack.encode(reports.Addressed(group, reports.Pulse(found)))
                with contextlib.suppress(zmq.Again):
                    outgoing.send(report, zmq.NOBLOCK)


def _address_towards(host: str) -> str:
    """The address of this machine from which it reaches another one. RunError: it does not."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((host, 9))  # connecting a UDP socket sends nothing
            return str(probe.getsockname()[0])
    except OSError as error:
        raise RunError(f"found no way to {host}: {error.strerror or error}") from None
