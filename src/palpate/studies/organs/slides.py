"""A finger slides across a gap: the force on the hand changes in a step by at most 1.5 times what it changes by on the
whole body, in a press and slide of the same motion, + 0.01 N.

The device reports exact positions. A step of its encoders moves the bone by 10 to 20 um in a tick, on the whole body as
well but at other places: that changes the force by up to 0.06 N, and hides jumps of half of that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from palpate.studies.organs.gaps import HIGH, MM
from palpate.studies.organs.runs import Traces, run
from palpate.studies.organs.search import Found
from palpate.studies.organs.settings import varied
from palpate.studies.organs.touches import Finger, Setting, Touch
from palpate.studies.organs.widths import WITHIN, on, press_touch, within
from palpate.studies.organs.zoo import USUAL

FAR = 9 * MM  # [m] from the gap where a slide begins and ends
SLOWEST, FASTEST = 0.02, 0.2  # [m/s]
MORE, LIGHT = 1.5, 0.01  # [1], [N]


def slide_touch(setting: Setting, sense: float, speed: float, deep: float, x: float) -> Touch:
    """A press on the block's top, a slide across its middle at a speed [m/s], and a hold; all across the gap."""
    touch = press_touch(setting, np.array([x, -sense * FAR, 0.5 * HIGH]), np.array([0.0, 0.0, -1.0]), deep)
    finger = touch.fingers[0]
    last = finger.path[0]["to"]
    across = {"to": [last[0], -last[1], last[2]], "time": round(2.0 * FAR / speed, 4), "shape": "linear"}
    press, hold = finger.path
    path = (press, {"hold": 0.2}, across, hold)
    return replace(touch, fingers=(Finger(finger.begin, (0.0, 0.0, finger.origin[2]), path),))


def largest_change(traces: Traces) -> tuple[np.ndarray, np.ndarray]:
    """Largest change of the force on the hand in a step [N] (L), and when [s] (L)."""
    change = np.linalg.norm(np.diff(traces["controller.force"], axis=1), axis=2)
    for lane, ticks in enumerate(traces.ticks):
        change[lane, ticks - 1 :] = 0.0
    return change.max(axis=1), (change.argmax(axis=1) + 1) * traces.step


def slides(body: str, count: int, rng: np.random.Generator, folder: Path, extra: Sequence[str] = ()) -> list[Found]:
    """Slides across each cut and comb of the block, and the same ones on the whole block."""
    setting, found = varied(Setting("block", USUAL, body, friction="", exact=True), rng), list[Found]()
    whole = [
        slide_touch(setting, float(rng.choice([-1.0, 1.0])), float(np.exp(rng.uniform(*np.log([SLOWEST, FASTEST])))),
                    float(rng.uniform(4 * MM, 9 * MM)), float(rng.uniform(-5 * MM, 5 * MM)))
        for _ in range(count)
    ]  # fmt: skip
    usual, _ = largest_change(run(whole, folder)[0])
    for name in WITHIN:
        touches = [on(touch, name) for touch in whole]
        for touch, least, value, time in zip(
            touches, usual.tolist(), *(each.tolist() for each in largest_change(run(touches, folder, extra=extra)[0])),
            strict=True,
        ):  # fmt: skip
            found.append(Found(touch, "slide", within(value, 0.0, MORE * least + LIGHT, time, one_sided=True)))
    return found
