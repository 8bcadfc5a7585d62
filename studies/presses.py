"""Measured presses from files: tables of numbers, and recordings of palpate's own."""

from collections.abc import Iterable
from pathlib import Path

from palpate.launch.load.values.units import convert
from palpate.messages import Contact, Pose
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.measured import Press, read_presses
from palpate.models.fit.tissue.recorded import recorded_press
from palpate.records.reader import Recording


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

    def __call__(self, file: Path) -> list[Press]:
        """SessionError, RecordingError: what is wrong with it."""
        if file.suffix == ".mcap":
            return [self._recorded(file)]
        return read_presses(file, self.names, self.units, convert)

    def _recorded(self, file: Path) -> Press:
        recording = Recording(file)
        contacts, poses = ([s for s, c in recording.streams.items() if c.type is kind] for kind in (Contact, Pose))
        if len(contacts) != 1 or len(poses) > 1:
            found = f"{len(contacts)} streams of Contact and {len(poses)} of Pose"
            raise SessionError(f"{file}: found {found}, expected one press: one stream of each")
        felt = [m for m in recording.messages(contacts[0]) if isinstance(m, Contact)]
        moved = [m for name in poses for m in recording.messages(name) if isinstance(m, Pose)]
        return recorded_press(file.name, moved, felt, self.bone)


def _pairs(option: str, texts: Iterable[str]) -> dict[str, str]:
    """`key=value` texts. SessionError: one that is none."""
    found = {}
    for text in filter(None, (t.strip() for t in texts)):
        key, sign, value = text.partition("=")
        if not (sign and key.strip() and value.strip()):
            raise SessionError(f"{option}: found {text!r}, expected name=value")
        found[key.strip()] = value.strip()
    return found
