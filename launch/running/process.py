"""The life of a worker process, from its job to its last report."""

from __future__ import annotations

import dataclasses
import faulthandler
import os
import signal
import sys
import traceback
from collections.abc import Mapping

import msgspec
import zmq

from palpate.launch.running.bus import Bus, PortInUse, order
from palpate.launch.running.clock import die_with_parent, real_time
from palpate.launch.running.ended import Ended
from palpate.launch.running.fused import death
from palpate.launch.running.inbox import Pair
from palpate.launch.running.job import Job
from palpate.launch.running.slot import NodeFault
from palpate.launch.running.worker import Worker


def serve(job: Job, run: str, control: str, reports: str, inboxes: Mapping[str, Pair], watch: bool = False) -> int:
    """Run a job: build, report ready, connect, report linked, wait for the start, run, report the end.

    inboxes  of the workers of this machine, by name
    watch    end when nothing is heard of the launcher, for a worker that is not its child

    Returns the exit code: 0, or 1 after a fault, which has been reported with its traceback.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the launcher decides when to stop
    faulthandler.enable(file=2, all_threads=False)  # a crash in compiled code tells where
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=False)
    os.register_at_fork(after_in_child=die_with_parent)  # what a node forks ends with it
    real = job.clock == "real"
    bus = Bus(run, job.group, control, reports, not real, inboxes, 1.0 / job.rate if real else 0.1)

    def report(what: dict) -> None:
        bus.reports.send(msgspec.msgpack.encode({"group": job.group, **what}))

    worker = None
    try:
        worker = Worker(job, bus, report)
        worker.watch = watch
        worker.start()
        refused = real_time(job.core, job.priority if real else None)
        report({"kind": "ready", "endpoints": bus.bind(job.host), "refused": refused})
        origin = _link(bus, job, report)
        if origin is not None:
            worker.run(origin)
        worker.stop()
        report({"kind": "done", "tick": worker.tick})
        return 0
    except Ended:
        return 0
    except (NodeFault, PortInUse) as error:
        report(_fault(error))
        _stop_rest(worker)
        return 1
    except Exception as error:
        report(
            {"kind": "fault", "node": "", "text": f"{type(error).__name__}: {error}", "trace": traceback.format_exc()}
        )
        return 1
    finally:
        bus.close()


def _link(bus: Bus, job: Job, report) -> int | None:
    """Connect to the other workers when told where they are; the time of tick 0, or None when told to stop."""
    readers = {stream: len(groups) for stream, groups in job.external.items()}
    while True:
        told = bus.orders()
        match told["do"]:
            case "connect":
                bus.forget()
                for address, streams in told["from"]:
                    bus.connect(address, streams)
                if not bus.wait_linked(readers, told["observed"], 10.0):
                    raise TimeoutError("the readers of its streams did not connect within 10 s")
                report({"kind": "linked"})
            case "go":
                bus.release()
                return told["origin"]
            case "stop" | "quit" | "close":
                return None


def _fault(error: NodeFault | PortInUse) -> dict:
    if isinstance(error, PortInUse):
        return {"kind": "fault", "node": "", "text": str(error), "trace": ""}
    return {"kind": "fault", **dataclasses.asdict(death(error))}


def _stop_rest(worker: Worker | None) -> None:
    """After a fault the other nodes still get their stop; a second fault there would hide the first."""
    if worker is not None:
        try:
            worker.stop()
        except NodeFault as error:
            print(f"after the fault, too: {error}", file=sys.stderr)


def join(address: str, group: str, patience: float) -> int:
    """Be the worker of this group for a launcher elsewhere; returns the exit code.

    address   of the launcher, `tcp://host:port`
    patience  [s] to wait for it

    TimeoutError: no launcher answered there.
    """
    host, _, port = address.removeprefix("tcp://").rpartition(":")
    control, reports = f"tcp://{host}:{port}", f"tcp://{host}:{int(port) + 1}"
    with zmq.Context() as context, context.socket(zmq.SUB) as heard, context.socket(zmq.PUSH) as said:
        heard.subscribe(f"~join-{group}".encode() + b"\0")
        heard.connect(control)
        said.set(zmq.LINGER, 0)
        said.connect(reports)
        for _ in range(max(1, round(patience / 0.25))):
            said.send(msgspec.msgpack.encode({"group": group, "kind": "hello"}))
            if heard.poll(250):
                told = order(heard.recv())
                break
        else:
            raise TimeoutError(f"no launcher at {address} that waits for group {group!r}")
    return serve(msgspec.convert(told["job"], Job), told["run"], control, reports, {}, watch=True)
