"""Listening to a run that goes on, from another process: which runs there are, and what they send."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import zmq

from palpate.launch.run.addresses import endpoint, key_of, runs
from palpate.launch.run.bus import split
from palpate.launch.run.keys import connect
from palpate.physics.errors import RunError


@dataclass
class Running:
    """A run that goes on: its name, and its groups of nodes (workers)."""

    name: str
    groups: list[str] = field(default_factory=list)


def running() -> list[Running]:
    """The runs of this user on this machine whose nodes have processes of their own, the newest last.

    A run that is fused in one process on simulated time has no sockets and cannot be seen.
    """
    return [Running(name, groups) for name, groups in runs() if groups]


def find(name: str | None = None) -> Running:
    """The run of this name, or the only one. RunError: there is none, or there are several and none was named."""
    live_runs = running()
    if name is not None:
        live_runs = [run for run in live_runs if run.name.startswith(name)]
    if len(live_runs) == 1:
        return live_runs[0]
    if not live_runs:
        which = f"run {name!r} is not active" if name else "no run is active"
        raise RunError(f"{which} on this machine (a run with --fused has no sockets to listen to); "
                    "start one: palpate run kidney --clock real")  # fmt: skip
    raise RunError(f"{len(live_runs)} runs are active: {', '.join(run.name for run in live_runs)}; name one with --run")


def hear(run: Running, streams: list[str]) -> Iterator[tuple[str, bytes]]:
    """Stream and payload of each message that a run sends on these streams, as they come, until it has ended."""
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.set(zmq.LINGER, 0)
        for stream in streams:
            socket.subscribe(stream.encode() + b"\0")
        for group in run.groups:
            connect(socket, endpoint(run.name, group, "observers"), key_of(run.name, group))
        while True:
            if socket.poll(200):
                yield split(socket.recv())
            elif not alive(run):
                return


def alive(run: Running) -> bool:
    """Whether any worker of the run still has its outlet open."""
    return any(run.name == other.name for other in running())
