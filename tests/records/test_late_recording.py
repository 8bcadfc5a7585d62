"""A recording has the low 32 bits of a tick, which is 50 days at 1 kHz; its readers give the whole tick."""

from pathlib import Path

import msgspec
import numpy as np
import pytest
from test_sources import TICKS, record, say

from palpate.messages import pack, unpack
from palpate.records.fill import begin_copy
from palpate.records.reader import Recording
from palpate.records.stored import RecordingError


def shifted(path: Path, by: int, late: float | None = None) -> Path:
    """A recording whose messages come `by` ticks later; `late` [ns]: by another time."""
    recording = Recording(path)
    target = path.with_name("late.mcap")
    with target.open("wb") as file:
        writer, channels = begin_copy(recording, file, recording.about)
        for name, tick, time, payload in recording.raw():
            message = unpack(payload, recording.find_stream(name).type)
            used = tuple(each + by if each >= 0 else each for each in message.used)
            at = round((tick + by) * 1e6) if late is None else round(time + late)
            moved = msgspec.structs.replace(message, tick=tick + by, time=at, used=used)
            writer.add_message(channels[name], tick + by, at, pack(moved))
        writer.finish()
    return target


@pytest.mark.parametrize("first", [2**31 - TICKS // 2, 2**32 - TICKS // 2, 3 * 2**32 - 7])
def test_ticks_beyond_32_bits_are_read_replayed_and_exported(tmp_path, first):
    path = record(tmp_path, only="all")
    late = shifted(path, first)
    before, after = Recording(path), Recording(late)
    for name, ticks in before.ticks().items():
        np.testing.assert_array_equal(after.ticks()[name], ticks + first)
    assert [tick for tick, _ in after.instants(after.ticks())] == [*range(first, first + TICKS)]
    assert [message.tick for message in after.messages("sum")] == [*range(first, first + TICKS)]
    assert after.columns("sum")["tick"].tolist() == [*range(first, first + TICKS)]
    code, out, error = say("replay", late, "--check")
    assert code == 0 and "bit-equal" in out, out + error
    assert say("info", late)[0] == 0


def test_a_tick_that_does_not_fit_its_time_is_refused(tmp_path):
    late = shifted(record(tmp_path, only="all"), 2**31 + 5, late=0.0)
    with pytest.raises(RecordingError, match=r"tick 2147483653 at 0 s, expected less than 2147483648"):
        Recording(late).ticks()
