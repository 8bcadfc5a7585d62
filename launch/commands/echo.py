"""`palpate echo`: the messages of a stream, of a recording or of a running graph, with units."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.launch.commands.common import Trust, console
from palpate.physics.errors import PalpateError

if TYPE_CHECKING:
    from palpate.messages import Message


def echo(
    first: Annotated[str, typer.Argument(help="Recording, or the stream of a running graph.", metavar="FILE|STREAM")],
    second: Annotated[str | None, typer.Argument(help="Stream of the recording.", metavar="[STREAM]")] = None,
    count: Annotated[int | None, typer.Option("--count", "-n", help="Stop after that many messages.", min=1)] = None,
    every: Annotated[int, typer.Option(help="Only every n-th message.", min=1)] = 1,
    run: Annotated[str | None, typer.Option(help="Name of the run, if there are several.")] = None,
    trust: Trust = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per line.")] = False,
) -> None:
    """Print the messages of a stream with units: `echo FILE STREAM`, or `echo STREAM` of a running graph.

    Arrays are shortened to their size and largest magnitude. Ctrl-C ends it.
    """
    messages = _recorded(first, second) if _is_file(first, second) else _running(first, run)
    out = console(soft_wrap=True)
    try:
        for message in itertools.islice(messages, 0, None if count is None else count * every, every):
            if as_json:
                typer.echo(_json(message))
            else:
                out.print(line(message))
    except KeyboardInterrupt:
        raise typer.Exit from None


def _is_file(first: str, second: str | None) -> bool:
    return second is not None or Path(first).suffix == ".mcap" or Path(first).is_file()


def _recorded(file: str, stream: str | None) -> Iterator[Message]:
    from palpate.records.reader import Recording
    from palpate.records.stored import RecordingError

    recording = Recording(file)
    if stream is None:
        raise RecordingError(f"{file}: name a stream: {', '.join(recording.streams)}")
    recording.known(stream)
    return recording.messages(stream)


def _running(stream: str, run: str | None) -> Iterator[Message]:
    """The messages of a running graph, their type being known by the fields that they have."""
    import msgspec

    from palpate.engine.faults import choices
    from palpate.launch.run.bus import HEALTH
    from palpate.launch.run.discover import find, hear
    from palpate.messages import Health, unpack
    from palpate.physics.errors import RunError

    live_run = find(run)
    kind: type[Message] | None = Health if stream == HEALTH else None
    reports: dict[str, int] = {}
    heard = False
    for name, payload in hear(live_run, list({stream, HEALTH})):
        if name == stream:
            heard = True
            kind = kind or _type_of(payload)
            yield unpack(payload, kind)
        elif not heard:
            # Each node reports five times a second: after some reports a stream of no node is known to be none.
            source = msgspec.msgpack.decode(payload)["source"]
            reports[source] = reports.get(source, 0) + 1
            if reports[source] > 5 and stream.partition(".")[0] not in reports:
                raise RunError(f"run {live_run.name} has no stream {stream!r}. {choices('Nodes', stream, reports)}")


def _type_of(payload: bytes) -> type[Message]:
    """The message type whose fields a message on the wire has."""
    import msgspec

    from palpate.messages import Message
    from palpate.messages.docs import message_types

    names = set(msgspec.msgpack.decode(payload))
    for kind in message_types().values():
        if set(kind.__struct_fields__) == names:
            return kind
    if names >= set(Message.__struct_fields__):
        return Message  # of a type of the user's own: its header, at least
    raise PalpateError(f"a message with the fields {', '.join(sorted(names))} is of no type that is known here")


def line(message: Message) -> Any:
    """One message as a line of text, each value with its unit."""
    import numpy as np
    from rich.text import Text

    from palpate.messages import fields

    text = Text(f"{message.time * 1e-9:12.6f} s  {message.tick:>7} ", style="cyan")
    for field in fields(type(message)):
        value = getattr(message, field.name)
        if isinstance(value, np.ndarray):
            size = "x".join(map(str, value.shape))
            peak = f", up to {np.abs(value).max():.4g}" if value.size and value.dtype.kind == "f" else ""
            shown = f"({size}{peak})"
        elif isinstance(value, tuple):
            shown = f"({', '.join(f'{v:.5g}' for v in value)})"
        else:
            shown = f"{value:.5g}" if isinstance(value, float) else str(value)
        text.append(f"  {field.name} ", style="dim")
        text.append(shown, style="default")
        if field.unit != "1":
            text.append(f" {field.unit}", style="green")
    return text


def _json(message: Message) -> str:
    import msgspec

    from palpate.records.export.foxglove import as_plain

    return msgspec.json.encode(as_plain(message)).decode()
