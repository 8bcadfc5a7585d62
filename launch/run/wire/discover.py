"""Reads the streams of an active run from another process."""

import sys
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import msgspec
import zmq

from palpate.engine.faults import choices
from palpate.launch.run.wire.addresses import endpoint, has_unix_sockets, runs
from palpate.launch.run.wire.bus import HEALTH, split
from palpate.launch.run.wire.inlet import HIGH_WATER
from palpate.launch.run.wire.keys import Key, connect
from palpate.messages import Health, Message, unpack
from palpate.messages.docs import message_types
from palpate.physics.errors import PalpateError, RunError


class Running(NamedTuple):
    """An active run: its name, the groups of its workers that have Unix sockets, the TCP addresses of the others, and
    the key of these."""

    name: str
    groups: Sequence[str] = ()
    addresses: Sequence[str] = ()
    key: Key | None = None


def running() -> list[Running]:
    """The active runs of this user on this machine, the newest last.

    A run that is fused in one process on simulated time has no sockets and is not listed.
    """
    return [Running(name, groups) for name, groups in runs() if groups]


def find(name: str | None = None) -> Running:
    """The run of this name, or the only one. RunError: it is not active, or several are active and no name is given,
    or this system has no Unix sockets."""
    if not has_unix_sockets():
        raise RunError(f"found {sys.platform}: another program reads a run through Unix sockets, which needs Linux; "
                       "record the run, or show it with palpate touch or palpate run --view")  # fmt: skip
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


def subscriber(context: zmq.Context, run: Running, streams: list[str], limit: int, newest: bool = False) -> zmq.Socket:
    """A socket that receives these streams of a run: up to `limit` unread messages, or only the `newest` one."""
    socket = context.socket(zmq.SUB)
    socket.set(zmq.LINGER, 0)
    socket.set(zmq.RCVHWM, limit)
    socket.set(zmq.CONFLATE, newest)
    for stream in streams:
        socket.subscribe(stream.encode() + b"\0")
    for group in run.groups:
        socket.connect(endpoint(run.name, group, "observers"))
    for address in run.addresses:
        connect(socket, address, run.key)
    return socket


def receive_messages(run: Running, streams: list[str]) -> Iterator[tuple[str, bytes]]:
    """Stream and payload of each message of these streams of a run, until the run has ended."""
    with zmq.Context() as context, subscriber(context, run, streams, HIGH_WATER) as socket:
        while True:
            if socket.poll(200):
                yield split(socket.recv())
            elif not any(run.name == other.name for other in running()):
                return


def messages_of(stream: str, run: str | None) -> Iterator[Message]:
    """The messages of a stream of a run; their type is found by their fields.

    RunError: unknown run or stream. PalpateError: a message of unknown type.
    """
    live_run = find(run)
    kind: type[Message] | None = Health if stream == HEALTH else None
    reports: dict[str, int] = {}
    received = False
    for name, payload in receive_messages(live_run, list({stream, HEALTH})):
        if name == stream:
            received = True
            kind = kind or _type_of(payload)
            yield unpack(payload, kind)
        elif not received:
            # Each node reports five times a second: after five reports of one node all nodes are known.
            source = msgspec.msgpack.decode(payload)["source"]
            reports[source] = reports.get(source, 0) + 1
            if reports[source] > 5 and stream.partition(".")[0] not in reports:
                raise RunError(f"run {live_run.name} has no stream {stream!r}. {choices('Nodes', stream, reports)}")


def _omissible(kind: type[Message]) -> set[str]:
    """The fields that an encoded message may lack."""
    if not kind.__struct_config__.omit_defaults:
        return set()
    return {field.name for field in msgspec.structs.fields(kind) if field.default is not msgspec.NODEFAULT}


def _type_of(payload: bytes) -> type[Message]:
    """The message type with the fields of an encoded message, which lacks those that are omitted at their default."""
    names = {*msgspec.msgpack.decode(payload), "delayed"}  # which is absent from messages in time
    for kind in message_types().values():
        omitted = set(kind.__struct_fields__) - names
        if names <= set(kind.__struct_fields__) and omitted <= _omissible(kind):
            return kind
    if names >= set(Message.__struct_fields__):
        return Message  # a custom type: at least its header
    raise PalpateError(f"a message with the fields {', '.join(sorted(names))} has an unknown type")
