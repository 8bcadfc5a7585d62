"""From the messages of a press to the forces at even depths."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError

HEAD = ["subject", "session", "depth [mm]", "rate [mm/s]", "force [N]"]
AROUND = 10e6  # [ns] before and after a sample, over which its rate is measured: steps of the encoder average out
NOISE = 5.0
"""[1] Standard deviations above the force before the press, from which a force is one."""


@dataclass(frozen=True)
class Press:
    """The first loading of a press: depth [m] (n) from 0 in even steps, rate [m/s] (n) of the depth, force [N] (n)."""

    depth: np.ndarray
    rate: np.ndarray
    force: np.ndarray


def press_of(
    poses: Sequence[Pose], contacts: Sequence[Contact], deepest: float, step: float, touch: float, file: Path
) -> Press:
    """The first loading that messages show, all of one press.

    deepest  [m]  touch  [N] above which it touches; the depth is counted from where the force last was within the noise
    file     where they are from, for what is said of them

    SessionError: it never touches, or not as deep.
    """
    if not poses or not contacts:
        raise SessionError(f"{file}: nothing was recorded")
    times = np.array([m.time for m in contacts], float)
    forces = np.array([m.force for m in contacts])
    normal = np.array(contacts[0].normal)
    when = np.array([m.time for m in poses], float)
    way = -np.interp(times, when, np.array([m.position for m in poses]) @ normal)
    late, early = np.minimum(times + AROUND, times[-1]), np.maximum(times - AROUND, times[0])
    speed = 1e9 * (np.interp(late, times, way) - np.interp(early, times, way)) / np.maximum(late - early, 1.0)
    first = int(np.argmax(forces > touch))
    if not forces[first] > touch:
        raise SessionError(f"{file}: never more than {forces.max():.3g} N, expected a touch of more than {touch:g} N")
    start = _onset(forces[: first + 1])
    depth = way[start:] - way[start]
    last = int(np.argmax(depth >= deepest))
    if not depth[last] >= deepest:
        raise SessionError(
            f"{file}: pressed {1e3 * depth.max():.3g} mm deep, expected {1e3 * deepest:g} mm. Press deeper, or take a"
            " smaller --depth."
        )
    deep = np.maximum.accumulate(depth[: last + 1])
    rising = np.concatenate([[True], np.diff(deep) > 0.0])  # the way in, without the tremor
    depths = np.arange(0.0, deepest + 0.5 * step, step)
    at = (np.interp(depths, deep[rising], series[start:][: last + 1][rising]) for series in (speed, forces))
    return Press(depths, *at)


def _onset(forces: np.ndarray) -> int:
    """Index of the last force [N] (n) within the noise before the touch that the last of them is."""
    middle = float(np.median(forces))
    noise = 1.4826 * float(np.median(np.abs(forces - middle)))  # as of a normal distribution, by the median deviation
    quiet = np.flatnonzero(forces <= middle + NOISE * noise)
    return int(quiet[-1])


def rows_before(file: Path, subject: str, session: str) -> list[list[str]]:
    """Rows of a CSV, its head included, to which this session can be added.

    SessionError: the file is another kind, or has this session already.
    """
    if not file.is_file():
        return []
    with file.open(encoding="utf-8", newline="") as text:
        rows = [row for row in csv.reader(text) if row]
    if rows and rows[0] != HEAD:
        raise SessionError(f"{file}: its head is {','.join(rows[0])}, expected {','.join(HEAD)}. Take another file.")
    if any(row[:2] == [subject, session] for row in rows[1:]):
        raise SessionError(f"{file}: subject {subject}, session {session} is there already. Take another --session.")
    return rows


def add_session(file: Path, subject: str, session: str, press: Press) -> int:
    """Add rows to a CSV; its head is written where there is none. The number of sessions that the subject then has.

    SessionError: as `rows_before`.
    """
    rows = rows_before(file, subject, session)
    ended = not file.is_file() or file.read_bytes()[-1:] in (b"\n", b"")
    with file.open("a", encoding="utf-8", newline="") as text:
        writer = csv.writer(text)
        if not ended:  # an editor has left its last line without an end
            text.write("\n")
        if not rows:
            writer.writerow(HEAD)
        for depth, rate, force in zip(press.depth, press.rate, press.force, strict=True):
            writer.writerow([subject, session, f"{1e3 * depth:.6g}", f"{1e3 * rate:.6g}", f"{force + 0.0:.6g}"])
    return len({row[1] for row in rows[1:] if row[0] == subject} | {session})
