"""`palpate echo`: the messages of a stream, of a recording or of a running graph, with units."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.cli.terminal.options import Trust
from palpate.cli.terminal.output import console, line, print_encoded

if TYPE_CHECKING:
    from palpate.messages import Message

EXAMPLE = "palpate echo runs/kidney.mcap contact -n 5"


def echo(
    first: Annotated[str, typer.Argument(help="Recording, or the stream of a running graph.", metavar="FILE|STREAM")],
    second: Annotated[str | None, typer.Argument(help="Stream of the recording.", metavar="[STREAM]")] = None,
    count: Annotated[int | None, typer.Option("--count", "-n", help="Stop after N messages.", min=1)] = None,
    every: Annotated[int, typer.Option(help="Only every n-th message.", min=1)] = 1,
    run: Annotated[str | None, typer.Option(help="Name of the run, if there are several.")] = None,
    trust: Trust = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object per line.")] = False,
) -> None:
    """Print the messages of a recorded or running stream, with units.

    `echo FILE STREAM` reads a recording, `echo STREAM` a running graph. Arrays are shortened to their size and largest
    magnitude. Ctrl-C ends it.
    """
    from palpate.launch.run.interrupts import StoppedError
    from palpate.launch.run.wire.discover import messages_of

    is_file = second is not None or Path(first).suffix == ".mcap" or Path(first).is_file()
    messages = _recorded_rows(first, second) if is_file else messages_of(first, run)
    out = console(soft_wrap=True)
    try:
        for message in itertools.islice(messages, 0, None if count is None else count * every, every):
            if as_json:
                print_encoded(_json(message))
            else:
                out.print(line(message))
    except KeyboardInterrupt as error:
        if isinstance(error, StoppedError):
            raise
        raise typer.Exit from None


def _recorded_rows(file: str, stream: str | None) -> Iterator[Message]:
    from palpate.records.reader import Recording
    from palpate.records.stored import RecordingError

    recording = Recording(file)
    if stream is None:
        raise RecordingError(f"{file}: name a stream: {', '.join(recording.streams)}")
    recording.find_stream(stream)
    return recording.messages(stream)


def _json(message: Message) -> str:
    import msgspec

    from palpate.records.export.foxglove import as_plain

    return msgspec.json.encode(as_plain(message)).decode()
