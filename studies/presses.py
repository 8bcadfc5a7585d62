"""Measured presses from files: tables of numbers, and recordings of palpate's own."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from palpate.launch.load.values.units import UnitError, convert, split
from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import MeasuredPress, prepared, read_presses
from palpate.records.reader import Recording

APART = 0.02  # [1] Of the greatest force, below which it does not press


class Presses:
    """Reads the presses of a file.

    columns  "force=F": names of a table's columns
    units    "F=mN": units of those whose header has none
    bone     whether the depth of a recording is that of the bone's edge, which a fingertip pads

    SessionError: a text that is none of these.
    """

    def __init__(self, columns: Iterable[str], units: Iterable[str], bone: bool) -> None:
        self.names, self.units, self.bone = _pairs("--columns", columns), _pairs("--unit", units), bone
        for key in set(self.names) - {"time", "force", "indentation"}:
            raise SessionError(f"--columns: found {key!r}, expected time, force, indentation")

    def __call__(self, file: Path) -> list[MeasuredPress]:
        """SessionError, RecordingError: what is wrong with it."""
        if file.suffix == ".mcap":
            return [self._recorded(file)]
        return read_presses(file, self.names, self.units, convert)

    def _recorded(self, file: Path) -> MeasuredPress:
        recording = Recording(file)
        contacts, poses = ([s for s, c in recording.streams.items() if c.type is kind] for kind in (Contact, Pose))
        if len(contacts) != 1 or len(poses) > 1:
            found = f"{len(contacts)} streams of Contact and {len(poses)} of Pose"
            raise SessionError(f"{file}: found {found}, expected one press: one stream of each")
        felt = [m for m in recording.messages(contacts[0]) if isinstance(m, Contact)]
        moved = [m for name in poses for m in recording.messages(name) if isinstance(m, Pose)]
        return recorded_press(file.name, moved, felt, self.bone)


def length(option: str, text: str) -> float:
    """[m] of a length on the command line. SessionError: it is none, or has no unit."""
    if not split(text)[1]:
        raise SessionError(f"{option}: found {text!r}, expected a length with its unit, such as {option} '{text} mm'")
    try:
        return convert(text, "m")
    except UnitError as error:
        raise SessionError(f"{option}: {error}") from None


def _pairs(option: str, texts: Iterable[str]) -> dict[str, str]:
    """`key=value` texts. SessionError: one that is none."""
    found = {}
    for text in filter(None, (t.strip() for t in texts)):
        key, sign, value = text.partition("=")
        if not (sign and key.strip() and value.strip()):
            raise SessionError(f"{option}: found {text!r}, expected name=value")
        found[key.strip()] = value.strip()
    return found


def recorded_press(name: str, poses: Sequence[Pose], contacts: Sequence[Contact], bone: bool) -> MeasuredPress:
    """The deepest press of one stream of contacts; that of poses says the way of a probe whose contact is measured.

    bone  whether indentation means the approach of the fingertip's bone, not the tissue's own

    SessionError: nothing that presses, and what `prepared` refuses.
    """
    force = np.array([m.force for m in contacts], float)
    if not len(force):
        raise SessionError(f"{name}: no messages of Contact, expected a press")
    time = np.array([m.time for m in contacts], float)
    depth = np.array([m.indentation + (m.compression if bone else 0.0) for m in contacts], float)
    if not depth.any():  # a sensor knows no indentation
        if not poses:
            raise SessionError(
                f"{name}: contacts of a force sensor and no stream of Pose, expected the way of its probe"
            )
        when = np.array([m.time for m in poses], float)
        depth = -np.interp(time, when, np.array([m.position for m in poses]) @ np.array(contacts[0].normal))
    own = _deepest_touch(depth, force)
    return prepared(name, 1e-9 * time[own], depth[own], force[own])


def _deepest_touch(depth: np.ndarray, force: np.ndarray) -> slice:
    """The rows of the touch that goes deepest, with the free motion before and after it."""
    pressed = force > APART * force.max()
    at = int(np.argmax(np.where(pressed, depth, -np.inf)))
    begin, end = at - int(np.argmin(pressed[at::-1])), at + int(np.argmin(pressed[at:]))
    begin, end = (begin if not pressed[begin] else 0), (end if not pressed[end] else len(force))
    before, after = np.flatnonzero(pressed[:begin]), np.flatnonzero(pressed[end:])
    return slice(int(before[-1]) + 1 if len(before) else 0, end + int(after[0]) if len(after) else len(force))
