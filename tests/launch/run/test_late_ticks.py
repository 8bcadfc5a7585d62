"""Ticks beyond 2^31 and 2^32, reached after 25 and 50 days at 1 kHz, change only tick and time of the messages."""

import numpy as np
import pytest

from palpate.launch.load.launchfile import find
from palpate.messages import pack, unpack
from palpate.stepping import Stepper

TICKS = 200
HEADER = ("tick", "time", "used")


def messages(graph: str, first: int) -> list[dict]:
    """For each tick: the fields of each stream, tick and used ticks counted from `first`."""
    stepper = Stepper(find(graph))
    stepper._worker.start()
    stepper._worker.begin(0)
    stepper._worker.tick = first - 1
    found = []
    try:
        for _ in range(TICKS):
            tick = stepper.tick()
            sent = {name: tick[name] for name in tick.streams if tick[name] is not None}
            for name, message in sent.items():
                assert unpack(pack(message), type(message)).tick == message.tick
                assert message.time == round(message.tick * 1e9 / stepper.rate)
                fields = {field: getattr(message, field) for field in message.__struct_fields__ if field not in HEADER}
                used = tuple(each - first if each >= 0 else each for each in message.used)
                sent[name] = fields | {"tick": message.tick - first, "used": used}
            found.append(sent)
    finally:
        stepper.stop()
    return found


@pytest.mark.parametrize("first", [2**31 - TICKS // 2, 2**32 - TICKS // 2])
@pytest.mark.parametrize("graph", ["kidney", "pinch"])
def test_a_run_beyond_32_bits_has_the_same_messages(graph, first):
    for expected, got in zip(messages(graph, 0), messages(graph, first), strict=True):
        assert got.keys() == expected.keys()
        for name, fields in expected.items():
            for field, value in fields.items():
                np.testing.assert_array_equal(got[name][field], value, f"{name}.{field}")
