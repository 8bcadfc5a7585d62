"""The file of a recording: its streams as typed messages or columns of numbers, and the metadata of its run."""

import contextlib
import json
from array import array
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any, TypeVar

import msgspec
import numpy as np
from mcap.records import Channel, Metadata, Schema

from palpate.engine.faults import choices
from palpate.engine.imports import full_name, recorded_class
from palpate.messages import Message, MessageError, fields, unpack
from palpate.physics.errors import MISUSE, PalpateError
from palpate.physics.readable import check_readable
from palpate.records.format import mcap_append  # a constant pattern needs a dotted name
from palpate.records.format.attached import renamed, restore_files
from palpate.records.format.head import PROFILE, SCHEMA_VERSION
from palpate.records.format.mcap_file import (
    MAGIC,
    MOST_HEAD,
    Broken,
    McapRecords,
    messages,
    read_declarations,
    read_records,
)

_WRAP, _HALF = 1 << 32, 1 << 31
"""A message in a file has the low 32 bits of its tick (50 days at 1 kHz); the rest follows from its time."""
BLOCK = 10_000  # messages decoded at a time
M = TypeVar("M", bound=Message)
_BAD_DATA = (
    msgspec.MsgspecError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError,
)  # fmt: skip


class RecordingError(PalpateError, ValueError):
    """A file that is not a usable recording, or not for this purpose; says what would work."""

    exit_code = MISUSE


@dataclass(frozen=True)
class StoredStream:
    """One stream of a recording.

    schema    JSON schema of its messages, from the file
    producer  node that sent it
    every     divisor of the base rate
    thin      one of `thin` messages was recorded
    kept      "checks": a stream to be recomputed, with some messages as checks; "heads": also with the heads of the
              other messages; else ""
    """

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
                f"{self.path}: stream {self.name!r} contains {self.schema['class']}: {error}. The other streams can be "
                "read."
            ) from None


@contextlib.contextmanager
def report_damage(path: Path, what: str = "") -> Iterator[None]:
    """Turn exceptions on unexpected data of this file, or of one part of it, into RecordingError."""
    try:
        yield
    except PalpateError:
        raise
    except _BAD_DATA as error:
        where = f" in {what}" if what else ""
        raise RecordingError(f"{path}: damaged{where}, or not written by palpate: {error!r}") from error


class Stored:
    """The contents of a recording's file; for a recording of sources without the messages that `Recording` recomputes.

    path       the file
    streams    streams by name
    about      provenance of the run
    counts     numbers of written and lost messages per stream; empty after a crash
    times      number and duration [s] (median, p99) of the steps per node; empty after a crash
    restarted  nodes that were restarted during the run, and their ticks
    late       nodes that began later than the run, and their first ticks
    notes      lines for the user about the run: text, node and time [s]
    complete   False if the file is truncated or damaged: it is read up to there
    damage     position and kind of the damage; None: no damage
    files      data files of the run, names with hashes
    wrong      data files of the run that are missing here or have changed, with which, in words
    moved      by name of one of these, the copy that takes its place in `about`, from the recording

    RecordingError: missing, not MCAP, not a recording of palpate, or of a newer version.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.streams: dict[str, StoredStream] = {}
        self.about: dict[str, Any] = {}
        self.counts: dict[str, dict[str, int]] = {}
        self.times: dict[str, dict[str, float]] = {}
        self.restarted: dict[str, list[int]] = {}
        self.late: dict[str, int] = {}
        self.notes: list[tuple[str, str, float]] = []
        self.damage: Broken | None = None
        self.files: dict[str, str] = {}
        self.moved: dict[str, str] = {}
        self.wrong: dict[str, str] = {}
        self.channels: dict[int, str] = {}  # number in the file -> stream
        try:
            check_readable(self.path)
            with open(self.path, "rb") as file:
                begin = file.read(8)
                head = file.read(64)
        except IsADirectoryError:
            raise RecordingError(f"{path}: a folder, expected a recording, such as {self.path / 'NAME.mcap'}") from None
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from None
        if begin != MAGIC:
            what = "an empty file" if not begin else "not an MCAP file"
            raise RecordingError(f"{path}: {what}; recordings are written by `palpate run --record FILE`")
        if PROFILE.encode() not in head and len(head) == 64:  # neither its profile nor its library
            raise RecordingError(
                f"{path}: an MCAP file of another program, expected a recording of palpate; `mcap info` shows it"
            )
        self._read_head()

    def as_whole(self) -> set[str]:
        """Treat the streams as those of a file with all messages; returns those of which the file has only checks."""
        checked = {name for name, stream in self.streams.items() if stream.kept}
        for name in checked:
            self.streams[name] = replace(self.streams[name], thin=1, kept="")
            self.counts.pop(name, None)
        return checked

    def file(self) -> Path:
        return self.path

    @property
    def complete(self) -> bool:
        return self.damage is None

    @property
    def cut(self) -> bool:
        """Whether the run's last messages may be missing: the file is truncated, damaged, or recovered."""
        return not self.complete or "recovered_from" in self.about

    @property
    def ending(self) -> str:
        """Position of a truncation or damage, and the remedy, in one line; empty for a complete file."""
        if self.damage is None:
            return ""
        return (
            f"{self.path} is {self.damage} (of {self.path.stat().st_size}); the part before is read. "
            f"`palpate export {self.path} --to mcap` makes a complete file of it."
        )

    def _read_head(self) -> None:
        schemas: dict[int, Any] = {}
        for record in self._head():
            if isinstance(record, Schema):
                with report_damage(self.path, f"the schema {record.name!r}"):
                    schemas[record.id] = json.loads(record.data)
            elif isinstance(record, Channel):
                self._channel(record, schemas)
            else:
                self._add_metadata(record)
        if not self.about:
            cut = f"{self.damage}, before its first message" if self.damage else f"no {PROFILE}.about in it"
            raise RecordingError(
                f"{self.path}: an MCAP file, but not a recording of palpate ({cut}); nothing to recover"
            )
        self._check_names()
        self._restore_files()

    def _restore_files(self) -> None:
        with report_damage(self.path, "its list of files"):
            self.files = {str(name): str(found) for name, found in self.about.get("files", {}).items()}
        self.moved, self.wrong = restore_files(self.path, self.files)
        if self.moved:
            self.about = renamed(self.about, self.moved)

    def _head(self) -> list[Any]:
        """Schemas, channels and metadata, from the index of a complete file, else up to the damage."""
        with open(self.path, "rb") as file:
            records = McapRecords(file)
            try:
                return records.read_index()
            except Broken as damage:
                self.damage = damage
            entries: dict[tuple[type, int], Any] = {}
            size = 0
            try:
                for record in records:
                    for each in read_declarations(record) if isinstance(record, bytes) else [record]:
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

    def _add_metadata(self, metadata: Metadata) -> None:
        entries = metadata.metadata
        with report_damage(self.path, f"its metadata {metadata.name!r}"):
            match metadata.name:
                case "palpate.about" | "palpate.counts" | "palpate.times" as name:
                    setattr(self, name.partition(".")[2], {key: json.loads(value) for key, value in entries.items()})
                case mcap_append.NOTES:
                    given = json.loads(entries["notes"])
                    self.notes = [(str(text), str(node), float(time)) for text, node, time in given]
                case "palpate.restarted":
                    self.restarted.setdefault(entries["node"], []).append(int(entries["tick"]))
                case "palpate.late":
                    self.late[entries["node"]] = int(entries["tick"])

    def _check_names(self) -> None:
        """RecordingError: a stream that does not belong to the recorded graph."""
        plan = self.about.get("plan")
        with report_damage(self.path, "its list of nodes"):
            nodes = {item["name"] for item in plan.get("nodes", ())} if isinstance(plan, dict) else set()
        for name, stream in self.streams.items():
            if nodes and (stream.producer not in nodes or name.partition(".")[0] != stream.producer):
                raise RecordingError(
                    f"{self.path}: stream {name!r} of node {stream.producer!r}, which the recorded graph does not have "
                    f"(nodes: {', '.join(sorted(nodes))}): the file is damaged, or not written by palpate"
                )

    def _channel(self, channel: Channel, schemas: dict[int, Any]) -> None:
        about = channel.metadata
        with report_damage(self.path, f"the metadata of stream {channel.topic!r}"):
            schema = schemas[channel.schema_id]
            stream = StoredStream(
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

    def raw(self, names: Container[str] | None = None) -> Iterator[tuple[str, int, int, bytes]]:
        """Stream, tick, time [ns] and encoded bytes of each message of these streams (None: all), in recorded order, up
        to a truncation or damage."""
        channels = {key: name for key, name in self.channels.items() if names is None or name in names}
        rate = self._rate()
        late = 1e9 * _HALF / rate  # [ns] from when on a tick may have more than the 32 bits that the file has of it
        try:
            for chunk in read_records(self.file()):
                if not isinstance(chunk, bytes):
                    continue
                for channel, tick, time, payload in messages(chunk, channels):
                    if time >= late:
                        tick += round((time * rate / 1e9 - tick) / _WRAP) * _WRAP
                    yield channels[channel], tick, time, payload
        except Broken as damage:
            self.damage = damage

    def payloads(self, *names: str) -> Iterator[tuple[str, int, bytes]]:
        """Stream, time [ns] and encoded bytes of each message of these streams (default: all), in recorded order."""
        wanted = {self.find_stream(name).name for name in names} or set(self.streams)
        for name, _, time, payload in self.raw(wanted):
            yield name, time, payload

    def _rate(self) -> float:
        """[Hz] of the graph; without a plan that says it, 1 kHz."""
        with report_damage(self.path, "the rate of its graph"):
            rate = float(self.about.get("plan", {}).get("rate", 1000.0))
            if not 0 < rate < inf:
                raise ValueError(f"{rate} Hz")
        return rate

    def ticks(self) -> dict[str, np.ndarray]:
        """The sorted ticks of the messages of each stream.

        RecordingError: a duplicate tick.
        """
        rows, rate = {name: array("q") for name in self.streams}, self._rate()
        for name, tick, time, _ in self.raw():
            if tick >= (most := time * rate / 1e9 + _HALF):
                raise RecordingError(f"{self.path}: stream {name!r}: tick {tick} at {time / 1e9:g} s, expected less "
                                     f"than {most:.0f}")  # fmt: skip
            rows[name].append(tick)
        ticks = {name: np.sort(np.array(row, dtype=np.int64)) for name, row in rows.items()}
        for name, row in ticks.items():
            twice = row[1:][row[1:] == row[:-1]]
            if len(twice):
                raise RecordingError(f"{self.path}: stream {name!r} has tick {twice[0]} twice; `palpate info` and "
                                     "`export` can still read it")  # fmt: skip
        return ticks

    def instants(self, present: Mapping[str, np.ndarray]) -> Iterator[tuple[int, dict[str, bytes]]]:
        """Each tick at which one of these streams has a message, in order, with the encoded messages by stream. The
        file has them in order of arrival.

        present  ticks of the messages of each stream, from `ticks`

        The number of messages per tick is known beforehand, so only messages out of order are buffered.
        """
        if not present:
            return
        ticks, counts = np.unique(np.concatenate(list(present.values())), return_counts=True)
        order = zip(ticks, counts, strict=True)
        due, count = next(order, (None, 0))
        waiting: dict[int, dict[str, bytes]] = {}
        for name, tick, _, payload in self.raw(present):
            waiting.setdefault(tick, {})[name] = payload
            while due is not None and len(waiting.get(due, ())) == count:
                yield int(due), waiting.pop(due)
                due, count = next(order, (None, 0))

    def messages(self, name: str, within: tuple[float, float] | None = None) -> Iterator[Message]:
        """The messages of one stream, or those within these times [s]. RecordingError: unknown stream, or a message
        that does not fit its type."""
        kind = self.find_stream(name).type
        begin, end = _nanoseconds(within)
        for _, tick, time, payload in self.raw({name}):
            if time < begin:
                continue
            if time > end:  # the messages of a stream are sorted by time
                return
            yield self.decode(name, tick, payload, kind)

    def columns(self, name: str, within: tuple[float, float] | None = None) -> dict[str, np.ndarray]:
        """Time [s], tick and all numbers and vectors of one stream, one row per message, without arrays of variable
        length.

        within  [s] times of the first and last message to decode; None: all
        """
        return self.tables([name], within)[name]

    def tables(
        self, names: Iterable[str], within: tuple[float, float] | None = None, texts: bool = False
    ) -> dict[str, dict[str, np.ndarray]]:
        """The `columns` of several streams by name, for which the file is read once; with `texts` also those of text.

        RecordingError: unknown stream, or a message that does not fit its type.
        """
        tables = {name: _Table(self.find_stream(name).type, texts) for name in names}
        begin, end = _nanoseconds(within)
        ended: set[str] = set()
        for name, tick, time, payload in self.raw(tables):
            table = tables[name]
            if begin <= time <= end:
                table.add(self.decode(name, tick, payload, table.kind))
            elif time > end:  # the messages of a stream are sorted by time
                ended.add(name)
                if len(ended) == len(tables):
                    break
        return {name: table.columns() for name, table in tables.items()}

    def decode(self, name: str, tick: int, payload: bytes, kind: type[M]) -> M:
        """Decode a message of a stream. RecordingError: it does not fit its type."""
        try:
            return unpack(payload, kind)
        except MessageError as error:
            raise RecordingError(f"{self.path}: stream {name!r}, tick {tick}: {error}") from None

    def stream_of(self, kind: type[Message]) -> str | None:
        """The first stream of this message type, in the order of the graph; None if the recording has none."""
        wanted = full_name(kind)
        return next((name for name, stream in self.streams.items() if stream.schema["class"] == wanted), None)

    def lack(self, name: str) -> str:
        """Why a stream is incomplete; empty if it is complete."""
        if name not in self.streams:
            return "was left out of the recording"
        return "was thinned out" if self.streams[name].thin > 1 else ""

    def rename(self, old: str, new: str, producer: str) -> None:
        """Rename a stream, as if this node had sent it."""
        self.streams[new] = replace(self.streams.pop(old), name=new, producer=producer)
        self.channels = {key: new if name == old else name for key, name in self.channels.items()}

    def find_stream(self, name: str) -> StoredStream:
        """The stream of this name. RecordingError: unknown stream; suggests names."""
        if name not in self.streams:
            raise RecordingError(f"{self.path}: no stream {name!r}. {choices('Streams', name, self.streams)}")
        return self.streams[name]


class _Table:
    """Collects messages of one type into columns, one per field of plain values; with `texts` also of texts."""

    def __init__(self, kind: type[Message], texts: bool) -> None:
        self.kind = kind
        plain = [field for field in fields(kind) if field.dtype is None and (texts or field.type is not str)]
        self._vectors = {field.name for field in plain if field.shape}
        self._blocks: dict[str, list[np.ndarray]] = {name: [] for name in ("tick", "time", *(f.name for f in plain))}
        self._waiting: list[Message] = []

    def add(self, message: Message) -> None:
        self._waiting.append(message)
        if len(self._waiting) == BLOCK:  # a million decoded messages would need 1 GB
            self._convert()

    def _convert(self) -> None:
        for name in list(self._blocks):
            values = [getattr(message, name) for message in self._waiting]
            if name in self._vectors and len({len(value) if isinstance(value, tuple) else -1 for value in values}) > 1:
                del self._blocks[name]
            else:
                self._blocks[name].append(np.array(values))
        self._waiting.clear()

    def columns(self) -> dict[str, np.ndarray]:
        """A column per field, the time in s; without vectors whose length changes."""
        if self._waiting:
            self._convert()
        columns = {
            name: np.concatenate(rows or [np.zeros(0)])
            for name, rows in self._blocks.items()
            if len({row.shape[1:] for row in rows}) <= 1
        }
        return columns | {"tick": columns["tick"].astype(np.int64), "time": columns["time"] / 1e9}


def _nanoseconds(within: tuple[float, float] | None) -> tuple[float, float]:
    """Times [s] as the bounds [ns] of messages."""
    return (-np.inf, np.inf) if within is None else (within[0] * 1e9 - 0.5, within[1] * 1e9 + 0.5)


def last_tick(present: Mapping[str, np.ndarray]) -> int:
    """The last tick of all streams; 0 without messages."""
    return max((int(row[-1]) for row in present.values() if len(row)), default=0)


def _size(record: Schema | Channel | Metadata) -> int:
    """Approximate size of a record [bytes]."""
    if isinstance(record, Schema):
        return 64 + len(record.data)
    return 64 + sum(map(len, (*record.metadata, *record.metadata.values())))
