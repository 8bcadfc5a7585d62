"""What holds for a touch with faults, by the rules of the real clock.

contact   the contact presses at most `OVER` times as hard as without faults, or as in the same motion without faults: a
          hand that loses its force falls into the tissue, and what is pressed deeper presses back harder
change    the force on the hand changes by at most `TURNED` times the slew rate of the controller, because the legs of
          the device turn while it holds its torques
energy    from an outage until its force has fully returned the display gives out at most `ENERGY`, plus `POWER` after
          `PATIENCE` (docs/equations/controller.md)
silence   the device is without torque `SILENCE` after a node that its force needs has stopped or died
return    at rest, `draw.REST` after the last fault, the contact has at least `LEFT` of the force of the same motion
finite    all forces are numbers
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.messages import Contact, DeviceState, Force, Load, Pose, Proximity, Surface, Torque
from palpate.nodes.controller import PATIENCE, POWER, Haptic
from palpate.studies.faults.chain import Chain
from palpate.studies.faults.draw import Touch
from palpate.studies.faults.fault import Fault, suffer
from palpate.studies.faults.touch import Felt, same_motion
from palpate.studies.organs.score import Score

OVER, LEFT = 1.2, 0.8  # [1]
LIGHT = 0.02  # [N]
TURNED = 1.02  # [1]
ENERGY = 1e-3  # [J]
SILENCE = 20e-3  # [s]
FORCE_PATH = (Pose, Proximity, Contact, Load, Surface, Force, Torque)

Scores = dict[str, Score]


def judge(run: Chain, touch: Touch, faults: Sequence[Fault], base: Felt) -> Scores:
    """The scores of one touch with faults.

    base  the same touch without faults
    """
    ticks = round(touch.duration * touch.rate)
    silence, energy = _Silence(run, faults), _Energy(run)

    def watch(tick: int, felt: Felt) -> None:
        silence.look(tick, felt)
        energy.look(tick, felt)

    felt = suffer(run, faults, ticks, watch)
    worst = felt.worst / touch.rate
    if not all(map(math.isfinite, (felt.contact, felt.change, felt.energy))):
        return {"finite": Score(math.inf, worst, math.nan, 0.0)}
    scores = {
        "contact": _over(felt.contact, OVER * base.contact, worst),
        "change": _over(felt.change, TURNED * Haptic.slew / touch.rate, worst),
        "energy": energy.score,
        "silence": silence.score,
    }
    most, last = base.contact, base.force
    force = felt.force if run.tick - felt.sent < SILENCE * run.rate else 0.0
    if scores["contact"].broken or force < LEFT * last - LIGHT:  # the hand may be elsewhere than without faults
        most, last = same_motion(run, felt.places)
        scores["contact"] = _over(felt.contact, OVER * max(most, base.contact), worst)
    least = LEFT * last - LIGHT
    score = least / max(force, 1e-12) if least > 0.0 else 0.0
    scores["return"] = Score(score, touch.duration, force, last, least)
    return scores


def _over(value: float, bound: float, time: float) -> Score:
    return Score(value / max(bound, 1e-12), time, value, bound)


class _Silence:
    """The torque after a node has stopped for longer than `SILENCE`; `look` is called before each tick."""

    def __init__(self, run: Chain, faults: Sequence[Fault]) -> None:
        self.run, self.faults = run, faults
        self.needed = needed_nodes(run)
        self.limit = math.ceil(SILENCE * run.rate)
        self.since: dict[str, int] = {}
        self.score = Score(0.0, 0.0, 0.0, 0.0)

    def look(self, tick: int, felt: Felt) -> None:
        if not felt.places:
            self.since.clear()
        gone = {f.where for f in self.faults if f.lasts and f.kind in ("stops", "restarts")} & self.needed
        self.since = {name: self.since.get(name, tick) for name in gone}
        if any(tick - since > self.limit for since in self.since.values()):
            torque = self.run.torque()
            if torque > 0.0:
                self.score = Score(math.inf, tick / self.run.rate, torque, 0.0)


class _Energy:
    """The energy that the display has given out since the last outage began, until the force has returned."""

    def __init__(self, run: Chain) -> None:
        self.controller = next(slot.node for slot in run.slots if isinstance(slot.node, Haptic))
        self.rate = run.rate
        self.begin = 0.0  # [J] absorbed when the outage began, if negative
        self.score = Score(0.0, 0.0, 0.0, ENERGY)

    def look(self, tick: int, felt: Felt) -> None:
        outage = float(self.controller.own["outage"])
        if outage == 0.0:
            self.begin = min(felt.taken, 0.0)
            return
        bound = ENERGY + POWER * max(outage - PATIENCE, 0.0)
        score = _over(self.begin - felt.taken, bound, tick / self.rate)
        self.score = max(self.score, score, key=lambda one: one.score)


def needed_nodes(run: Chain) -> set[str]:
    """The nodes without whose messages the device has no torque. Without friction or a texture the force continues."""
    senders = {output.stream: (slot, output.kind) for slot in run.slots for output in slot.outputs}
    found: set[str] = set()
    waiting = [run.device]
    while waiting:
        for stream in (port.stream for port in waiting.pop().inputs):
            sender, kind = senders.get(stream, (run.device, DeviceState))
            if kind in FORCE_PATH and sender.name not in found:
                found.add(sender.name)
                waiting.append(sender)
    return found
