"""Spikes of afferents as Neurodata Without Borders (NWB 2, HDF5)."""

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from palpate.messages import Spikes
from palpate.physics.afferents.population import Population
from palpate.physics.afferents.published import TYPES
from palpate.physics.archive import replacing
from palpate.physics.extras import required
from palpate.records.export import source
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError, damaged

COLUMNS = {
    "afferent_type": "type of the afferent: SA1, RA1 or PC",
    "x": "position of the receptor in the patch, from its centre [m]",
    "y": "position of the receptor in the patch, from its centre [m]",
    "depth": "depth of the receptor below the surface of the skin [m]",
}
"""Columns of the table of units, with their descriptions."""


def write_nwb(recording: Recording, target: Path, streams: tuple[str, ...], every: int | None) -> list[Path]:
    """Write the units of the first stream of spikes: spike times [s] on the graph's clock, the observed interval, type,
    position and depth of each; no electrodes. Units without a spike have an empty list.

    RecordingError: pynwb is missing, no stream of spikes, or an unknown sender.
    """
    with required("NWB", "feel", RecordingError):
        from pynwb import NWBHDF5IO, NWBFile
    stream = source(recording, Spikes, streams, "`palpate run nodule --scene afferents` records one")
    made, unit, moment, span = _units(recording, stream)
    with damaged(recording.path, "the date or the versions"):
        file = NWBFile(
            session_description=f"Simulated tactile afferents, stream {stream!r} of {recording.path.name}",
            identifier=f"{recording.path.stem}/{stream}",
            session_start_time=datetime.fromisoformat(recording.about["date"]),
            source_script=f"palpate {recording.about['versions']['palpate']}",
            source_script_file_name="palpate export",
        )
    for name, text in COLUMNS.items():
        file.add_unit_column(name, text)
    order = np.argsort(unit, kind="stable")
    times = np.split(moment[order], np.searchsorted(unit[order], np.arange(1, len(made.kind))))
    for spikes, kind, at in zip(times, made.kind, made.at, strict=True):
        place = dict(zip(("x", "y", "depth"), map(float, at), strict=True))
        file.add_unit(spike_times=spikes, obs_intervals=[span], afferent_type=TYPES[kind], **place)
    with replacing(target) as part, NWBHDF5IO(str(part), "w") as out:
        out.write(file)
    return [target]


def _units(recording: Recording, stream: str) -> tuple[Population, np.ndarray, np.ndarray, tuple[float, float]]:
    """The receptors, unit and time [s] of each spike, and begin and end [s] of the recorded messages."""
    sender = recording.streams[stream].producer
    try:
        node: Any = plan_of(recording).make(sender)
        made = node.made()
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
