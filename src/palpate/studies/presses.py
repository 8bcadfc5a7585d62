"""Measured presses from tables of numbers and from recordings."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from palpate.messages import Contact, Pose
from palpate.models.fit.probes.read import Probes, read_probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.afm import SUFFIXES, read_afm
from palpate.models.fit.tissue.measured import MeasuredPress, prepare_press, read_presses
from palpate.physics.table_numbers import check_dialect
from palpate.records.reader import Recording
from palpate.units.quantity import UnitError, convert, split

OPTIONAL = ("time", "specimen")  # columns that may be left out: time=
APART = 0.02  # [1] Share of the greatest force below which the probe counts as free


class PressReader:
    """Reads the presses of a file.

    columns  "force=F": names of the columns of a table
    units    "F=mN": units of columns whose header has none
    dialect  of the numbers of a table, if it cannot be detected
    bone     whether the depth of a recording is the displacement of the finger bone, not the tissue indentation

    SessionError: a text has another form.
    """

    def __init__(self, columns: Iterable[str], units: Iterable[str], bone: bool, dialect: str = "") -> None:
        try:
            check_dialect(dialect)
        except ValueError as error:
            raise SessionError(str(error)) from None
        self.dialect = dialect
        self.names, self.units, self.bone = _pairs("--columns", columns, OPTIONAL), _pairs("--unit", units), bone
        for key in set(self.names) - {"force", "indentation", *OPTIONAL}:
            raise SessionError(f"--columns: found {key!r}, expected time, force, indentation, specimen")

    def __call__(self, file: Path) -> list[MeasuredPress]:
        """All presses of a file. SessionError, RecordingError: the file is faulty."""
        if file.suffix == ".mcap":
            return [self._read_press(file)]
        if file.suffix in SUFFIXES:
            return read_afm(file)
        return read_presses(file, self.names, self.units, self.dialect)

    def probes(self, file: Path) -> Probes | None:
        """The sparse probes of a file; None: few presses, or many rows in each. SessionError: the file is faulty."""
        return None if file.suffix in (".mcap", *SUFFIXES) else read_probes(file, self.names, self.units, self.dialect)

    def _read_press(self, file: Path) -> MeasuredPress:
        recording = Recording(file)
        contacts, poses = ([s for s, c in recording.streams.items() if c.type is kind] for kind in (Contact, Pose))
        if len(contacts) != 1 or len(poses) > 1:
            found = f"{len(contacts)} streams of Contact and {len(poses)} of Pose"
            raise SessionError(f"{file}: found {found}, expected one press: one stream of each")
        felt = [m for m in recording.messages(contacts[0]) if isinstance(m, Contact)]
        moved = [m for name in poses for m in recording.messages(name) if isinstance(m, Pose)]
        return recorded_press(file.name, moved, felt, self.bone)


def length(option: str, text: str) -> float:
    """Length [m] from the command line. SessionError: no length, or no unit."""
    if not split(text)[1]:
        raise SessionError(f"{option}: found {text!r}, expected a length with its unit, such as {option} '{text} mm'")
    try:
        return convert(text, "m")
    except UnitError as error:
        raise SessionError(f"{option}: {error}") from None


def _pairs(option: str, texts: Iterable[str], empty: Sequence[str] = ()) -> dict[str, str]:
    """Parse `key=value` texts; the values of the keys `empty` may be missing. SessionError: one has another form."""
    found = {}
    for text in filter(None, (t.strip() for t in texts)):
        key, sign, value = text.partition("=")
        if not (sign and key.strip() and (value.strip() or key.strip() in empty)):
            raise SessionError(f"{option}: found {text!r}, expected name=value")
        found[key.strip()] = value.strip()
    return found


def recorded_press(name: str, poses: Sequence[Pose], contacts: Sequence[Contact], bone: bool) -> MeasuredPress:
    """The deepest press of a stream of contacts.

    poses  path of the probe; used if the contacts are of a force sensor, which measures no indentation
    bone   whether depth is the approach of the finger bone, that is indentation plus compression of the fingertip

    SessionError: no press, or `prepare_press` rejects it.
    """
    force = np.array([m.force for m in contacts], float)
    if not len(force):
        raise SessionError(f"{name}: no messages of Contact, expected a press")
    time = np.array([m.time for m in contacts], float)
    depth = np.array([m.indentation + (m.compression if bone else 0.0) for m in contacts], float)
    if not depth.any():  # a force sensor measures no indentation
        if not poses:
            raise SessionError(f"{name}: contacts of a force sensor without a stream of Pose, expected the probe path")
        when = np.array([m.time for m in poses], float)
        depth = -np.interp(time, when, np.array([m.position for m in poses]) @ np.array(contacts[0].normal))
    rows = _deepest_touch(depth, force)
    return prepare_press(name, 1e-9 * time[rows], depth[rows], force[rows])


def _deepest_touch(depth: np.ndarray, force: np.ndarray) -> slice:
    """Rows of the deepest touch, with the free motion before and after it."""
    pressed = force > APART * force.max()
    at = int(np.argmax(np.where(pressed, depth, -np.inf)))
    begin, end = at - int(np.argmin(pressed[at::-1])), at + int(np.argmin(pressed[at:]))
    begin, end = (begin if not pressed[begin] else 0), (end if not pressed[end] else len(force))
    before, after = np.flatnonzero(pressed[:begin]), np.flatnonzero(pressed[end:])
    return slice(int(before[-1]) + 1 if len(before) else 0, end + int(after[0]) if len(after) else len(force))
