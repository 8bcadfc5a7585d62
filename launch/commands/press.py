"""From the recording of a press to the forces at even depths."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from palpate.launch.recording.reader import Recording
from palpate.messages import Contact, Pose
from palpate.physics.errors import MISUSE, PalpateError

HEAD = ["subject", "session", "depth [mm]", "force [N]"]


class PressError(PalpateError, ValueError):
    """A recording that shows no press, or a file that a session cannot be added to."""

    exit_code = MISUSE


def press_of(file: Path, deepest: float, step: float, touch: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [m] (n) from 0 in even steps, and the forces [N] (n) of the first loading.

    file     recording with one stream of `Pose` and one of `Contact`
    deepest  [m]  touch  [N] above which it touches; the depth is counted from the last place before

    PressError: it never touches, or not as deep.
    """
    recording = Recording(file)
    poses, contacts = recording.stream_of(Pose), recording.stream_of(Contact)
    if poses is None or contacts is None:
        raise PressError(
            f"{file}: expected one stream of Pose and one of Contact; it has {', '.join(recording.streams)}"
        )
    pose = [(m.time, m.position) for m in recording.messages(poses) if isinstance(m, Pose)]
    felt = [(m.time, m.force, m.normal) for m in recording.messages(contacts) if isinstance(m, Contact)]
    if not pose or not felt:
        raise PressError(f"{file}: nothing was recorded")
    times = np.array([t for t, _, _ in felt], float)
    forces = np.array([f for _, f, _ in felt])
    normal = np.array(felt[0][2])
    when, where = np.array([t for t, _ in pose], float), np.array([p for _, p in pose])
    way = -np.interp(times, when, where @ normal)
    first = int(np.argmax(forces > touch))
    if not forces[first] > touch:
        raise PressError(f"{file}: never more than {forces.max():.3g} N, expected a touch of more than {touch:g} N")
    depth = way - way[max(first - 1, 0)]
    inwards = depth[first - 1 if first else 0 :]
    last = int(np.argmax(inwards >= deepest))
    if not inwards[last] >= deepest:
        raise PressError(
            f"{file}: pressed {1e3 * inwards.max():.3g} mm deep, expected {1e3 * deepest:g} mm. Press deeper, or take a"
            " smaller --depth."
        )
    start = first - 1 if first else 0
    deep, push = depth[start : start + last + 1], forces[start : start + last + 1]
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(deep)) > 0.0])  # the way in, without the tremor
    depths = np.arange(0.0, deepest + 0.5 * step, step)
    return depths, np.interp(depths, np.maximum.accumulate(deep)[rising], push[rising])


def add_session(file: Path, subject: str, session: str, depths: np.ndarray, forces: np.ndarray) -> None:
    """Add rows to a CSV; its head is written where there is none.

    PressError: the file is another kind, or has this session already.
    """
    rows: list[list[str]] = []
    if file.is_file():
        with file.open(encoding="utf-8", newline="") as text:
            rows = [row for row in csv.reader(text) if row]
        if rows and rows[0] != HEAD:
            raise PressError(f"{file}: its head is {','.join(rows[0])}, expected {','.join(HEAD)}. Take another file.")
        if any(row[:2] == [subject, session] for row in rows[1:]):
            raise PressError(f"{file}: subject {subject}, session {session} is there already. Take another --session.")
    with file.open("a", encoding="utf-8", newline="") as text:
        writer = csv.writer(text)
        if not rows:
            writer.writerow(HEAD)
        for depth, force in zip(depths, forces, strict=True):
            writer.writerow([subject, session, f"{1e3 * depth:.6g}", f"{force:.6g}"])
