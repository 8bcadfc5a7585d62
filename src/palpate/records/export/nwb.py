"""Spikes of afferents as Neurodata Without Borders (NWB 2, HDF5)."""

import re
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.messages import Spikes
from palpate.physics.afferents.population import Population
from palpate.physics.afferents.published import RATE, TYPES
from palpate.physics.archive import replacing
from palpate.physics.extras import require_extra
from palpate.physics.readable import MOST_TEXT, check_readable
from palpate.records.export import source
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError, report_damage

COLUMNS = {
    "afferent_type": "type of the afferent: SA1, RA1 or PC",
    "x": "position of the receptor in the patch, from its centre [m]",
    "y": "position of the receptor in the patch, from its centre [m]",
    "depth": "depth of the receptor below the surface of the skin [m]",
}
"""Columns of the table of units, with their descriptions."""
SUBJECT = ("subject_id", "age", "sex", "species", "strain", "genotype", "weight", "description")
NONE: Mapping[str, str] = MappingProxyType({})
SIMULATED = {
    "subject_id": "simulated-finger", "species": "Homo sapiens", "sex": "U", "age": "P18Y/",
    "description": "Simulated adult fingertip: no human or animal was recorded",
}  # fmt: skip
PARTICIPANTS = "participants.tsv"  # of the folder of an experiment, in the layout of BIDS
_SEXES = {"female": "F", "male": "M", "other": "O", "f": "F", "m": "M", "o": "O"}


def participant(path: Path) -> dict[str, str]:
    """The subject of a recording in the folder of an experiment, from its list of participants; empty elsewhere."""
    name = next((part for part in path.absolute().parts if re.fullmatch(r"sub-\w+", part)), "")
    files = [folder / PARTICIPANTS for folder in path.absolute().parents if (folder / PARTICIPANTS).is_file()]
    if not name or not files:
        return {}
    check_readable(files[0], MOST_TEXT)
    head, *rows = (line.split("\t") for line in files[0].read_text(encoding="utf-8").splitlines() or [""])
    row: dict[str, str] = next((dict(zip(head, row, strict=False)) for row in rows if row[:1] == [name]), {})
    known = {key: value for key, value in row.items() if key in SUBJECT and value not in ("", "n/a")}
    if known.get("age", "").replace(".", "", 1).isdigit():
        known["age"] = f"P{known['age']}Y"
    if "sex" in known:
        known["sex"] = _SEXES.get(known["sex"].lower(), "U")
    return {"subject_id": name, "description": "Participant; the spikes are simulated"} | known


def write_nwb(
    recording: Recording, target: Path, streams: tuple[str, ...], every: int | None, subject: Mapping[str, str] = NONE
) -> list[Path]:
    """Write the units of the first stream of spikes: spike times [s] on the graph's clock, the observed interval, type,
    position and depth of each; no electrodes. Units without a spike have an empty list. The resolution is the step of
    the fibre model.

    subject  fields of the NWB subject; the others are those of the participant if the recording is of an experiment,
             and else those of a simulated human finger

    RecordingError: pynwb is missing, no stream of spikes, an unknown sender, or an unknown field of the subject.
    """
    with require_extra("NWB", "feel", RecordingError):
        from pynwb import NWBHDF5IO, NWBFile
        from pynwb.file import Subject
    if unknown := sorted(set(subject) - set(SUBJECT)):
        raise RecordingError(f"--subject: found {', '.join(unknown)}, expected {', '.join(SUBJECT)}")
    stream = source(recording, Spikes, streams, "`palpate run nodule --scene afferents` records one")
    made, unit, moment, span = _units(recording, stream)
    with report_damage(recording.path, "the date or the versions"):
        file = NWBFile(
            session_description=f"Simulated tactile afferents, stream {stream!r} of {recording.path.name}",
            identifier=f"{recording.path.stem}/{stream}",
            session_start_time=datetime.fromisoformat(recording.about["date"]),
            source_script=f"palpate {recording.about['versions']['palpate']}",
            source_script_file_name="palpate export",
        )
    try:
        file.subject = Subject(**(SIMULATED | participant(recording.path) | dict(subject)))
    except (TypeError, ValueError) as error:
        raise RecordingError(f"--subject: {' '.join(str(error).split())}") from None
    for name, text in COLUMNS.items():
        file.add_unit_column(name, text)
    order = np.argsort(unit, kind="stable")
    times = np.split(moment[order], np.searchsorted(unit[order], np.arange(1, len(made.kind))))
    for spikes, kind, at in zip(times, made.kind, made.at, strict=True):
        place = dict(zip(("x", "y", "depth"), map(float, at), strict=True))
        file.add_unit(spike_times=spikes, obs_intervals=[span], afferent_type=TYPES[kind], **place)
    if file.units is not None:
        file.units.resolution = 1.0 / RATE  # [s] of the spike times
    with replacing(target) as part, NWBHDF5IO(str(part), "w") as out:
        out.write(file)
    return [target]


def _units(recording: Recording, stream: str) -> tuple[Population, np.ndarray, np.ndarray, tuple[float, float]]:
    """The receptors, unit and time [s] of each spike, and begin and end [s] of the recorded messages."""
    sender = recording.streams[stream].producer
    try:
        node: Any = plan_of(recording).make(sender)
        made = node.make_population()
    except (AttributeError, ValueError) as error:
        raise RecordingError(
            f"{recording.path}: the receptors of node {sender!r} are not known here: {error}"
        ) from None
    sent: list[Any] = list(recording.messages(stream))
    if not sent or not len(made.kind):
        raise RecordingError(f"{recording.path}: stream {stream!r} has no messages or no units; record a longer run")
    unit, moment = (np.concatenate([getattr(each, name) for each in sent]) for name in ("unit", "moment"))
    if len(unit) and not 0 <= int(unit.min()) <= int(unit.max()) < len(made.kind):
        raise RecordingError(
            f"{recording.path}: stream {stream!r} has spikes of unit {int(unit.max())}, but node {sender!r} has "
            f"{len(made.kind)} units here; has its file of units changed?"
        )
    return made, unit, moment, (sent[0].time * 1e-9, sent[-1].time * 1e-9)
