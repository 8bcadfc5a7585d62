"""Forces at equally spaced depths from the messages of a press."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError
from palpate.physics.archive import replacing
from palpate.physics.readable import MOST_TEXT, check_readable

HEAD = ["subject", "session", "depth [mm]", "rate [mm/s]", "force [N]"]
AROUND = 10e6  # [ns] averaging time of the rate before and after a sample, because of encoder quantization
NOISE = 5.0  # [1] noise limit of a force, in standard deviations of the force before the press


@dataclass(frozen=True)
class Loading:
    """The first loading of a press: depth [m] (n) from 0 in equal steps, rate [m/s] (n) of the depth, force [N] (n)."""

    depth: np.ndarray
    rate: np.ndarray
    force: np.ndarray


def press_of(
    poses: Sequence[Pose], contacts: Sequence[Contact], deepest: float, step: float, touch: float, file: Path
) -> Loading:
    """The first loading in the messages of one press.

    deepest  [m]  of the result, in steps of `step` [m]
    touch    [N]  force of contact; depth 0 is the last sample before it with a force within the noise
    file     source of the messages, for errors

    SessionError: no contact, or a smaller depth.
    """
    if not poses or not contacts:
        raise SessionError(f"{file}: nothing was recorded")
    times = np.array([m.time for m in contacts], float)
    forces = np.array([m.force for m in contacts])
    normal = np.array(contacts[0].normal)
    when = np.array([m.time for m in poses], float)
    position = -np.interp(times, when, np.array([m.position for m in poses]) @ normal)
    late, early = np.minimum(times + AROUND, times[-1]), np.maximum(times - AROUND, times[0])
    speed = 1e9 * (np.interp(late, times, position) - np.interp(early, times, position)) / np.maximum(late - early, 1.0)
    first = int(np.argmax(forces > touch))
    if not forces[first] > touch:
        raise SessionError(f"{file}: never more than {forces.max():.3g} N, expected a touch of more than {touch:g} N")
    start = _onset(forces[: first + 1])
    depth = position[start:] - position[start]
    last = int(np.argmax(depth >= deepest))
    if not depth[last] >= deepest:
        raise SessionError(
            f"{file}: pressed {1e3 * depth.max():.3g} mm deep, expected {1e3 * deepest:g} mm. Press deeper, or set a"
            " smaller --depth."
        )
    deep = np.maximum.accumulate(depth[: last + 1])
    rising = np.concatenate([[True], np.diff(deep) > 0.0])  # monotone envelope, without tremor
    depths = np.arange(0.0, deepest + 0.5 * step, step)
    at = (np.interp(depths, deep[rising], series[start:][: last + 1][rising]) for series in (speed, forces))
    return Loading(depths, *at)


def _onset(forces: np.ndarray) -> int:
    """Index of the last force [N] (n) within the noise; the last element is the first contact."""
    middle = float(np.median(forces))
    noise = 1.4826 * float(np.median(np.abs(forces - middle)))  # standard deviation from the median absolute deviation
    quiet = np.flatnonzero(forces <= middle + NOISE * noise)
    return int(quiet[-1])


def rows_before(file: Path, subject: str, session: str) -> list[list[str]]:
    """Rows of a CSV file with its header, to which this session can be added.

    SessionError: the file has another header, or contains this session.
    """
    if not file.exists():
        return []
    check_readable(file, MOST_TEXT)
    with file.open(encoding="utf-8", newline="") as text:
        rows = [row for row in csv.reader(text) if row]
    if rows and rows[0] != HEAD:
        raise SessionError(f"{file}: its header is {','.join(rows[0])}, expected {','.join(HEAD)}. Use another file.")
    if any(row[:2] == [subject, session] for row in rows[1:]):
        raise SessionError(f"{file}: subject {subject}, session {session} exists. Use another --session.")
    return rows


def add_session(file: Path, subject: str, session: str, press: Loading) -> int:
    """Append a session to a CSV file, with a header if it is new. Returns the number of sessions of the subject.

    SessionError: as `rows_before`.
    """
    rows = rows_before(file, subject, session)
    before = file.read_bytes().decode() if file.is_file() else ""
    with replacing(file) as part, part.open("w", encoding="utf-8", newline="") as text:
        writer = csv.writer(text)
        text.write(before if before.endswith("\n") or not before else f"{before}\n")
        if not rows:
            writer.writerow(HEAD)
        for depth, rate, force in zip(press.depth, press.rate, press.force, strict=True):
            writer.writerow([subject, session, f"{1e3 * depth:.6g}", f"{1e3 * rate:.6g}", f"{force + 0.0:.6g}"])
    return len({row[1] for row in rows[1:] if row[0] == subject} | {session})
