"""What stands in the file of a recording: its streams as typed messages or as columns of numbers, and what it knows of
its run."""

import contextlib
import json
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from mcap.records import Channel, Metadata, Schema

from palpate.engine.faults import choices
from palpate.engine.imports import full_name, recorded_class
from palpate.messages import Message, MessageError, fields, unpack
from palpate.physics.errors import MISUSE, PalpateError
from palpate.records.format.head import PROFILE, SCHEMA_VERSION
from palpate.records.format.mcap_file import MAGIC, MOST_HEAD, Broken, Records, declared, messages, opened

_MOST_TICKS = 1 << 31
BLOCK = 10_000  # messages that are decoded at a time
M = TypeVar("M", bound=Message)
_BAD_DATA = (
    msgspec.MsgspecError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError,
)  # fmt: skip


class RecordingError(PalpateError, ValueError):
    """A file that cannot be read as a recording, or not for this purpose; says what can still be done."""

    exit_code = MISUSE


@dataclass(frozen=True)
class Channelled:
    """One stream of a recording: name, message type, sending node, divisor of the base rate, and `thin`: of how many
    messages one was kept; `schema` is the JSON schema as it stands in the file. `kept` is "checks" for a stream that is
    to be computed, "heads" where the heads of its other messages are there too, else ""."""

    name: str
    schema: dict[str, Any]
    producer: str
    every: int
    thin: int
    path: Path
    kept: str = ""

    @property
    def type(self) -> type[Message]:
        """RecordingError: the class cannot be imported."""
        try:
            return recorded_class(self.schema["class"], Message)
        except (ImportError, AttributeError) as error:
            raise RecordingError(
                f"{self.path}: stream {self.name!r} holds {self.schema['class']}: {error}. The other streams can be "
                "read."
            ) from None


@contextlib.contextmanager
def damaged(path: Path, what: str = "") -> Iterator[None]:
    """RecordingError for whatever unexpected data of this file, or of this part of it, raise: it may say anything."""
    try:
        yield
    except PalpateError:
        raise
    except _BAD_DATA as error:
        where = f" in {what}" if what else ""
        raise RecordingError(f"{path}: damaged{where}, or not written by palpate: {error!r}") from error


class Stored:
    """What a file of a recording holds; of one of sources only these, and checks (`Recording` computes the rest).

    path       of the file
    streams    what it holds, by name
    about      provenance of the run
    counts     per stream, how many messages were written and how many the logger did not get; empty after a crash
    times      per node, its steps and their duration [s] (median, p99) on the machine of the run; empty after a crash
    restarted  nodes that were started again during the run, and the tick from which they began anew
    complete   false where the file was cut off or is damaged: it is read up to there
    damage     where that is, and what was found; None where there is none

    RecordingError: missing, not MCAP, not palpate's, or of a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.streams: dict[str, Channelled] = {}
        self.about: dict[str, Any] = {}
        self.counts: dict[str, dict[str, int]] = {}
        self.times: dict[str, dict[str, float]] = {}
        self.restarted: dict[str, list[int]] = {}
        self.damage: Broken | None = None
        self.channels: dict[int, str] = {}  # number in the file -> stream
        try:
            with open(self.path, "rb") as file:
                begin = file.read(8)
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from None
        if begin != MAGIC:
            what = "an empty file" if not begin else "not an MCAP file"
            raise RecordingError(f"{path}: {what}; recordings are written by `palpate run --record FILE`")
        self._read_head()

    def as_whole(self) -> set[str]:
        """Take the streams for those of a file that holds all messages; returns those of which it holds checks only."""
        checked = {name for name, stream in self.streams.items() if stream.kept}
        for name in checked:
            self.streams[name] = replace(self.streams[name], thin=1, kept="")
            self.counts.pop(name, None)
        return checked

    def file(self) -> Path:
        """The file that the messages are read from."""
        return self.path

    @property
    def complete(self) -> bool:
        return self.damage is None

    @property
    def ending(self) -> str:
        """Where the file is cut off or damaged, and what helps, in one line; empty for a complete one."""
        if self.damage is None:
            return ""
        return (
            f"{self.path} is {self.damage} (of {self.path.stat().st_size}); what is before that is read. "
            f"`palpate recover {self.path}` makes a complete file of it."
        )

    def _read_head(self) -> None:
        schemas: dict[int, Any] = {}
        for record in self._head():
            if isinstance(record, Schema):
                with damaged(self.path, f"the schema {record.name!r}"):
                    schemas[record.id] = json.loads(record.data)
            elif isinstance(record, Channel):
                self._channel(record, schemas)
            else:
                self._told(record)
        if not self.about:
            cut = f"{self.damage}, before its first message" if self.damage else f"no {PROFILE}.about in it"
            raise RecordingError(
                f"{self.path}: an MCAP file, but not a recording of palpate ({cut}); nothing to recover"
            )
        self._check_names()

    def _head(self) -> list[Any]:
        """Schemas, channels and metadata, from the index of a complete file, else up to where it is damaged."""
        with open(self.path, "rb") as file:
            records = Records(file)
            try:
                return records.indexed()
            except Broken as damage:
                self.damage = damage
            entries: dict[tuple[type, int], Any] = {}
            size = 0
            try:
                for record in records:
                    for each in declared(record) if isinstance(record, bytes) else [record]:
                        if not isinstance(each, Schema | Channel | Metadata):
                            continue
                        key = type(each), len(entries) if isinstance(each, Metadata) else each.id
                        if key not in entries:  # chunks repeat them
                            entries[key] = each
                            size += _size(each)
                        if size > MOST_HEAD:
                            raise Broken(0, f"more than {MOST_HEAD} bytes of streams and metadata")
            except Broken as damage:
                self.damage = damage
            return list(entries.values())

    def _told(self, metadata: Metadata) -> None:
        """Take what the file says beside its messages."""
        entries = metadata.metadata
        with damaged(self.path, f"its metadata {metadata.name!r}"):
            match metadata.name:
                case "palpate.about" | "palpate.counts" | "palpate.times" as name:
                    setattr(self, name.partition(".")[2], {key: json.loads(value) for key, value in entries.items()})
                case "palpate.restarted":
                    self.restarted.setdefault(entries["node"], []).append(int(entries["tick"]))

    def _check_names(self) -> None:
        """RecordingError: a stream that is none of the recorded graph's."""
        plan = self.about.get("plan")
        with damaged(self.path, "what it says of its nodes"):
            nodes = {item["name"] for item in plan.get("nodes", ())} if isinstance(plan, dict) else set()
        for name, stream in self.streams.items():
            if nodes and (stream.producer not in nodes or name.partition(".")[0] != stream.producer):
                raise RecordingError(
                    f"{self.path}: stream {name!r} of node {stream.producer!r}, which the recorded graph does not have "
                    f"(nodes: {', '.join(sorted(nodes))}): the file is damaged, or not written by palpate"
                )

    def _channel(self, channel: Channel, schemas: dict[int, Any]) -> None:
        about = channel.metadata
        with damaged(self.path, f"what it says of stream {channel.topic!r}"):
            schema = schemas[channel.schema_id]
            stream = Channelled(
                channel.topic, schema, about["producer"], int(about["every"]), int(about.get("thin", "1")), self.path,
                about.get("kept", ""),
            )  # fmt: skip
            version, _, _ = schema.get("version"), schema["class"], schema["title"]
        if version != SCHEMA_VERSION:
            raise RecordingError(
                f"{self.path}: stream {channel.topic!r} has schema version {version!r}, this palpate reads "
                f"{SCHEMA_VERSION!r}; `palpate export` of the version that wrote it can convert it"
            )
        self.streams[channel.topic] = stream
        self.channels[channel.id] = channel.topic

    def raw(self) -> Iterator[tuple[str, int, int, bytes]]:
        """Stream, tick, time [ns] and wire bytes of each message, in the order in which they were recorded, up to
        where the file is cut off or damaged."""
        channels = self.channels
        try:
            for chunk in opened(self.file()):
                if not isinstance(chunk, bytes):
                    continue
                for channel, tick, time, payload in messages(chunk):
                    name = channels.get(channel)
                    if name is not None:
                        yield name, tick, time, payload
        except Broken as damage:
            self.damage = damage

    def payloads(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Stream, time [ns] and wire bytes of each message of these streams (of all, if none is named), in the
        order in which they were recorded."""
        wanted = {self.known(name).name for name in names} or set(self.streams)
        for name, _, time, payload in self.raw():
            if name in wanted:
                yield name, time, payload

    def ticks(self) -> dict[str, np.ndarray]:
        """Of each stream the ticks at which it has a message, in order.

        RecordingError: a stream with one tick twice, as no run writes it.
        """
        rows = {name: array("I") for name in self.streams}
        for name, tick, _, _ in self.raw():
            if tick >= _MOST_TICKS:
                raise RecordingError(f"{self.path}: stream {name!r}: tick {tick}, expected less than 2^31")
            rows[name].append(tick)
        ticks = {name: np.sort(np.array(row, dtype=np.uint32)) for name, row in rows.items()}
        for name, row in ticks.items():
            twice = row[1:][row[1:] == row[:-1]]
            if len(twice):
                raise RecordingError(f"{self.path}: stream {name!r} has tick {twice[0]} twice; `palpate info` and "
                                     "`export` can still read it")  # fmt: skip
        return ticks

    def messages(self, name: str) -> Iterator[Message]:
        """The messages of one stream. RecordingError: no such stream, or bytes that do not fit its type."""
        kind = self.known(name).type
        for stream, tick, _, payload in self.raw():
            if stream == name:
                yield self.decoded(name, tick, payload, kind)

    def columns(self, name: str) -> dict[str, np.ndarray]:
        """Time [s], tick and all numbers and vectors of one stream, one row a message; fields with arrays of
        changing length are left out."""
        stream_messages = self.messages(name)
        plain = [field.name for field in fields(self.known(name).type) if field.dtype is None and field.type is not str]
        blocks: dict[str, list[np.ndarray]] = {name: [] for name in ("tick", "time", *plain)}
        while block := list(islice(stream_messages, BLOCK)):  # a million messages at once would take a gigabyte
            for name in list(blocks):
                values = [getattr(m, name) for m in block]
                if len({len(v) if isinstance(v, tuple) else -1 for v in values}) == 1:
                    blocks[name].append(np.array(values))
                else:
                    del blocks[name]
        columns = {name: np.concatenate(rows or [np.zeros(0)]) for name, rows in blocks.items()
                   if len({row.shape[1:] for row in rows}) <= 1}  # fmt: skip
        return columns | {"tick": columns["tick"].astype(np.int64), "time": columns["time"] / 1e9}

    def decoded(self, name: str, tick: int, payload: bytes, kind: type[M]) -> M:
        """A message of a stream. RecordingError: bytes that do not fit its type."""
        try:
            return unpack(payload, kind)
        except MessageError as error:
            raise RecordingError(f"{self.path}: stream {name!r}, tick {tick}: {error}") from None

    def stream_of(self, kind: type[Message]) -> str | None:
        """The first stream of this message type, in the order of the graph; None where there is none."""
        wanted = full_name(kind)
        return next((name for name, stream in self.streams.items() if stream.schema["class"] == wanted), None)

    def lack(self, name: str) -> str:
        """Why not every message of a stream is there; empty where it is."""
        if name not in self.streams:
            return "was left out of the recording"
        return "was thinned out" if self.streams[name].thin > 1 else ""

    def rename(self, old: str, new: str, producer: str) -> None:
        """Call a stream otherwise, as if this node had sent it."""
        self.streams[new] = replace(self.streams.pop(old), name=new, producer=producer)
        self.channels = {key: new if name == old else name for key, name in self.channels.items()}

    def known(self, name: str) -> Channelled:
        """The stream of this name. RecordingError: there is none; names the nearest."""
        if name not in self.streams:
            raise RecordingError(f"{self.path}: no stream {name!r}. {choices('Streams', name, self.streams)}")
        return self.streams[name]


def _size(record: Schema | Channel | Metadata) -> int:
    """[bytes] What a record holds, about."""
    if isinstance(record, Schema):
        return 64 + len(record.data)
    return 64 + sum(map(len, (*record.metadata, *record.metadata.values())))
