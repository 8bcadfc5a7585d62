"""Listening to a run that goes on, from another process: which runs there are, and what they send."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import zmq

from palpate.launch.running.bus import endpoint, split

_OUTLET = re.compile(r"@palpate/([^/\s]+)/([^/\s]+)/observers$")
_SOCKETS = Path("/proc/net/unix")


class NoRun(RuntimeError):
    """No run goes on on this machine, or not the one that was asked for."""


@dataclass
class Running:
    """A run that goes on: its name, and its groups of nodes (workers)."""

    name: str
    groups: list[str] = field(default_factory=list)

    @property
    def endpoints(self) -> list[str]:
        """Outlets for observers, of all groups."""
        return [endpoint(self.name, group, "observers") for group in self.groups]


def running() -> list[Running]:
    """The runs on this machine whose nodes have processes of their own, the newest last. A run that is fused in one
    process on simulated time has no sockets and cannot be seen."""
    found: dict[str, Running] = {}
    for line in _SOCKETS.read_text().splitlines():
        match = _OUTLET.search(line)
        if match:
            run, group = match.groups()
            own = found.setdefault(run, Running(run))
            if group not in own.groups:
                own.groups.append(group)
    return list(found.values())


def find(name: str | None = None) -> Running:
    """The run of this name, or the only one. NoRun: there is none, or there are several and none was named."""
    runs = running()
    if name is not None:
        runs = [run for run in runs if run.name.startswith(name)]
    if len(runs) == 1:
        return runs[0]
    if not runs:
        which = f"no run {name!r} goes on" if name else "no run goes on"
        raise NoRun(f"{which} on this machine (a run with --fused has no sockets to listen to); "
                    "start one: palpate run kidney --clock real")  # fmt: skip
    raise NoRun(f"{len(runs)} runs go on: {', '.join(run.name for run in runs)}; name one with --run")


def hear(run: Running, streams: list[str]) -> Iterator[tuple[str, bytes]]:
    """Stream and payload of each message that a run sends on these streams, as they come, until it has ended."""
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.set(zmq.LINGER, 0)
        for stream in streams:
            socket.subscribe(stream.encode() + b"\0")
        for address in run.endpoints:
            socket.connect(address)
        while True:
            if socket.poll(200):
                yield split(socket.recv())
            elif not alive(run):
                return


def alive(run: Running) -> bool:
    """Whether any worker of the run still has its outlet open."""
    return any(run.name == other.name for other in running())
