"""Frames of recordings at any time, read on request."""

import contextlib
from bisect import bisect_right
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from palpate.engine.imports import full_name
from palpate.messages import Contact, Message, Surface
from palpate.records.format.mcap_file import Broken, McapRecords
from palpate.records.format.mcap_file import messages as messages_of
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError
from palpate.views.errors import PageError
from palpate.views.page.feed import Curve, FrameSource, frame, kinds_of, mesh_frame, picture
from palpate.views.page.steered import watched_part
from palpate.views.shown import fingers, links_of
from palpate.views.surface.colour import able

POINTS = 4000  # points of the curves of force and indentation: more than the pixels of a screen
MOST = 2  # recordings side by side
BACK = 8  # chunks that are searched backwards for the last message of a sparse stream


class RecordingSource:
    """One recording.

    curves  times, forces and indentations of each finger, decimated to `POINTS` by their largest forces

    RecordingError: it cannot be read, or has no touch or no surface.
    """

    def __init__(self, path: Path) -> None:
        self.recording = Recording(path)
        found = fingers(*links_of(self.recording))
        for kind, what in ((Contact, "touch"), (Surface, "body")):
            if not any(full_name(kind) in finger for finger in found):
                streams = ", ".join(sorted(self.recording.streams)) or "none"
                raise RecordingError(f"{path}: no {what} in it to show: no stream of {kind.__name__} among {streams}")
        try:
            self.touched = watched_part(plan_of(self.recording), found)
        except PageError as error:
            raise RecordingError(f"{path}: {error}") from None
        self._file = self.recording.file().open("rb")
        self._records = McapRecords(self._file)
        self._open = lru_cache(maxsize=BACK + 2)(self._decode_chunk)
        self._begins: list[float] = []
        self._places: list[int] = []
        kinds = kinds_of(self.touched)
        self._kinds = {stream: kind for stream, kind in kinds.items() if stream in self.recording.streams}
        try:
            self.curves = self._listen([finger[Contact] for finger in self.touched.fingers])
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        self._file.close()

    def _listen(self, contacts: list[str]) -> list[Curve]:
        """Read the file once: the time at which each chunk begins, and the contacts."""
        rows: dict[str, list[tuple[float, float, float]]] = {contact: [] for contact in contacts}
        channels = {number: name for number, name in self.recording.channels.items() if name in rows}
        for at, chunk in self._records.chunks():
            first = None
            for channel, tick, time, payload in self._inside(chunk):
                first = time if first is None else min(first, time)
                if (contact := channels.get(channel)) is not None:
                    message = self.recording.decode(contact, tick, payload, Contact)
                    rows[contact].append((time * 1e-9, message.force, message.indentation))
            if first is not None:
                self._begins.append(first * 1e-9)
                self._places.append(at)
        for contact, samples in rows.items():
            if not samples:
                raise RecordingError(f"{self.recording.path}: no messages of {contact!r} in it")
        thinned = [_thin_rows(np.array(sorted(samples))).T.tolist() for samples in rows.values()]
        return [dict(zip("tfs", columns, strict=True)) for columns in thinned]

    def _inside(self, chunk: bytes) -> Iterator[tuple[int, int, int, bytes]]:
        try:
            yield from messages_of(chunk)
        except Broken as damage:
            raise RecordingError(f"{self.recording.path} is {damage}") from None

    def _decode_chunk(self, at: int) -> list[tuple[str, float, int, bytes]]:
        """Stream, time [s], tick and bytes of the shown messages of a chunk."""
        channels = self.recording.channels
        return [
            (name, time * 1e-9, tick, payload)
            for channel, tick, time, payload in self._inside(self._records.chunk(at))
            if (name := channels.get(channel)) in self._kinds and name is not None
        ]

    def last(self, time: float) -> dict[str, Message]:
        """The last message of each stream at or before this time [s] of the graph's clock."""
        found: dict[str, tuple[float, int, bytes]] = {}
        k = bisect_right(self._begins, time) - 1
        for chunk in range(k, max(k - BACK, -1), -1):
            for name, at, tick, payload in reversed(self._open(self._places[chunk])):
                if at <= time and (name not in found or at > found[name][0]):
                    found[name] = (at, tick, payload)
            if len(found) == len(self._kinds) and chunk < k:
                break
        return {
            name: self.recording.decode(name, tick, payload, self._kinds[name])
            for name, (_, tick, payload) in found.items()
        }

    def begin(self, number: int, name: str) -> bytes:
        """The first message to a page: surface, curves and colours. `number`: index of the recording on the page."""
        about = {"reel": number, "name": name, "colours": self._colours(), "others": self.curves[1:]}
        return mesh_frame(self.touched, about | self.curves[0])

    def _colours(self) -> list[str]:
        """The available colours of the surface at the instant of the largest force."""
        time = max((f, t) for curve in self.curves for t, f in zip(curve["t"], curve["f"], strict=True))[1]
        newest = self.last(time)
        surface = self.touched.bodies.surface({name: one for name, one in newest.items() if isinstance(one, Surface)})
        loads = ["load"] if any(name in self.touched.bodies.loads for name in newest) else []
        return loads + (able(surface) if surface is not None else ["displacement", "strain"])

    def frame(self, time: float, number: int) -> bytes:
        """The frame at a time [s], clamped to the recording."""
        times = self.curves[0]["t"]
        newest = self.last(min(max(time, times[0]), times[-1]))
        head: dict[str, Any] = {"kind": "frame", "reel": number, "asked": time}
        return picture(head, newest, self.touched) or frame(head, None)


class Ask(msgspec.Struct, forbid_unknown_fields=True):
    """The request of a page: a time [s]."""

    at: float


class Reels(FrameSource):
    """One recording, or two side by side; each page requests the times to show. RecordingError."""

    files = ("view.html", "view.js")
    command = "palpate view"

    def __init__(self, files: list[Path]) -> None:
        super().__init__()
        if len(files) > MOST:
            raise RecordingError(f"{len(files)} recordings: expected one, or two to see them side by side")
        with contextlib.ExitStack() as opened:
            self.reels = [opened.enter_context(contextlib.closing(RecordingSource(file))) for file in files]
            opened.pop_all()

    def begin(self) -> list[bytes]:
        names = titles([reel.recording.path for reel in self.reels])
        return [reel.begin(number, name) for number, (reel, name) in enumerate(zip(self.reels, names, strict=True))]

    def take(self, page: object, text: str | bytes) -> list[bytes]:
        at = msgspec.json.decode(text, type=Ask).at
        return [reel.frame(at, number) for number, reel in enumerate(self.reels)]

    def close(self) -> None:
        for reel in self.reels:
            reel.close()


def _thin_rows(rows: np.ndarray) -> np.ndarray:
    """At most `POINTS` rows (k,3): the largest force of each interval, and the first and the last row."""
    if len(rows) <= POINTS:
        return rows
    parts = np.array_split(rows[1:-1], POINTS - 2)
    return np.concatenate([rows[:1], [part[np.argmax(part[:, 1])] for part in parts], rows[-1:]])


def titles(paths: list[Path]) -> list[str]:
    """The names of files, with as many parent folders as needed to distinguish them."""
    whole = [path.absolute().parts for path in paths]
    count = 1
    while len({parts[-count:] for parts in whole}) < len(set(whole)):
        count += 1
    return ["/".join(parts[-count:]) for parts in whole]
