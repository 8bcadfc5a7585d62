"""The guard and the reports of the page's raw-HID device (static/guard.js, raw_hid.js) against those of the driver."""

import json
import math
import struct

import in_node
import numpy as np
import pytest

from palpate.drivers.guard import DeviceSample, Guard
from palpate.drivers.hid import raw
from palpate.drivers.limits import LIMITS
from palpate.web.device import describe_guard, describe_protocol

RUN = """
import { readFileSync } from "fs";
import { Guard, crc16, pack, unpack } from "./rules.mjs";
const { about, cycles, protocol, reports, commands } = JSON.parse(readFileSync("given.json"));
const guard = new Guard(about), read = (x) => (x === null ? NaN : x);
const sent = cycles.map(({ answer, command, now, given }) => {
  guard.noteAnswer(answer && { ...answer, joints: answer.joints.map(read) });
  return { sent: guard.apply(command.map(read), now, given), why: guard.why(now, given) };
});
const bytes = (hex) => Uint8Array.from(hex.match(/../g) ?? [], (pair) => parseInt(pair, 16));
const hex = (all) => [...all].map((byte) => byte.toString(16).padStart(2, "0")).join("");
const taken = reports.map((text) => unpack(protocol, bytes(text)));
const made = commands.map((values) => hex(pack(protocol, "command", values)));
console.log(JSON.stringify({ sent, taken, made, published: crc16(new TextEncoder().encode("123456789")) }));
"""


def run(folder, **given):
    """What the scripts of the page make of cycles of the guard, reports and commands."""
    rules, reports = ((in_node.STATIC / name).read_text() for name in ("guard.js", "raw_hid.js"))
    (folder / "rules.mjs").write_text(rules + reports.replace('import { Guard } from "/guard.js";\n', ""))
    plain = {"about": None, "cycles": [], "reports": [], "commands": [], "protocol": describe_protocol()}
    (folder / "given.json").write_text(json.dumps(plain | given))
    return in_node.run_script(folder, RUN)


def cycles_of(rng, jointed):
    """Answers, commands and times of a device that moves at random, with outages, pauses and invalid numbers."""
    now, place = 10**9, np.zeros(3)
    for _ in range(4000):
        now += int(rng.choice([10**6, 10**6, 10**6, 3 * 10**6, 4 * 10**7], p=[0.5, 0.3, 0.17, 0.02, 0.01]))
        place = place + rng.normal(scale=(5e-3 if jointed else 5e-4) * (5 if rng.random() < 0.02 else 1), size=3)
        numbers = tuple(map(float, place))
        if jointed and rng.random() < 0.003:
            numbers = (math.nan, *numbers[1:])
        answer = None
        if rng.random() > 0.05:
            homed, at = bool(rng.random() > 0.003), now - int(rng.integers(0, 10**6))
            answer = DeviceSample(at, joints=numbers if jointed else (), position=() if jointed else numbers,
                                  buttons=int(rng.random() < 0.97), homed=homed)  # fmt: skip
        command = tuple(map(float, rng.normal(scale=10.0 ** rng.uniform(-2, 1.5), size=3)))
        if rng.random() < 0.005:
            command = (command[0], math.inf if rng.random() < 0.5 else math.nan, command[2])
        yield answer, command, now, now - int(rng.choice([10**5, 10**6, 2 * 10**7], p=[0.6, 0.38, 0.02]))


def plain(numbers):
    return [x if math.isfinite(x) else None for x in numbers]


@pytest.mark.parametrize("jointed", [False, True])
@pytest.mark.parametrize("deadman", [0, 1])
def test_the_guard_of_the_page_sends_what_that_of_the_driver_sends(tmp_path, jointed, deadman):
    rng, guard, expected, given, seen = np.random.default_rng(3), Guard(LIMITS["rawhid"], deadman), [], [], set()
    for answer, command, now, asked in cycles_of(rng, jointed):
        guard.note_answer(answer)
        expected.append(guard.apply(command, now, asked))
        why = guard.why(now, asked)
        seen.add(why)
        report = answer and {"time": answer.time, "joints": plain(answer.joints), "position": answer.position,
                           "buttons": answer.buttons, "homed": answer.homed}  # fmt: skip
        given.append({"answer": report, "command": plain(command), "now": now, "given": asked, "why": why})
    assert {"", "not homed", "the command is old", "too fast"} <= seen
    found = run(tmp_path, about=describe_guard(guard), cycles=given)["sent"]
    assert [one["why"] for one in found] == [one["why"] for one in given]
    assert np.abs(expected).max() > 0.05
    assert np.allclose([one["sent"] for one in found], expected, rtol=1e-12, atol=1e-15)


def test_reports_are_read_and_written_as_by_the_driver(tmp_path):
    rng = np.random.default_rng(4)
    whole = lambda bits, count: tuple(int(x) for x in rng.integers(-(2 ** (bits - 1)), 2 ** (bits - 1), count))  # noqa: E731
    states = [raw.RawState(7, 65535, flags, 3, 2**32 - 1 - flags, whole(32, 6), 513) for flags in range(8)]
    info = raw.Info(1, 2, tuple(np.float32(rng.normal(size=6)).tolist()), (1e-3, 0.0, 0.0, 0.0, 0.0, 0.0))
    commands = [raw.RawCommand(n, n, 20, whole(16, 6)) for n in range(4)]
    good = [raw.pack(one) for one in (*states, info)]
    damaged = [
        good[0][:-1],
        good[0] + b"\0",
        b"",
        good[0][:9] + bytes([good[0][9] ^ 1]) + good[0][10:],
        b"\x51" + good[0][1:],
    ]
    unknown = good[0][:1] + b"\x09" + good[0][2:-2]
    damaged.append(unknown + struct.pack("<H", raw.crc16_x25(unknown)))
    found = run(tmp_path, reports=[one.hex() for one in (*good, *damaged)],
                commands=[{**one._asdict(), "version": raw.VERSION} for one in commands])  # fmt: skip
    assert found["published"] == 0x906E and found["made"] == [raw.pack(one).hex() for one in commands]
    assert found["taken"][len(good) :] == [None] * len(damaged) and all(raw.unpack(one) is None for one in damaged)
    for report, one in zip(found["taken"], (*states, info), strict=False):
        report = {name: tuple(value) if isinstance(value, list) else value for name, value in report.items()}
        report.pop("version", None)
        assert report.pop("name") == ("info" if one is info else "state")
        assert type(one)(**report) == raw.unpack(raw.pack(one))
