"""Events of an experiment on the Lab Streaming Layer: begin and end of intervals, answers, as texts."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable

from palpate.nodes.logger.lsl import library


def markers(task: str, participant: str) -> Callable[[str, float | None], object]:
    """What sends an event of a moment [s, time.monotonic], None: of now, in the stream `palpate.TASK`.

    SettingError: pylsl or its library is missing.
    """
    pylsl = library()
    name = f"palpate.{task}"
    info = pylsl.StreamInfo(name, "Markers", 1, pylsl.IRREGULAR_RATE, pylsl.cf_string,
                            f"{name} sub-{participant} on {socket.gethostname()}")  # fmt: skip
    info.desc().append_child_value("participant", participant)
    outlet = pylsl.StreamOutlet(info)
    ahead = pylsl.local_clock() - time.monotonic()
    return lambda text, moment: outlet.push_sample([text], 0.0 if moment is None else moment + ahead)
