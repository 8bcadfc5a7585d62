"""What holds for a touch with faults, by the rules of the real clock.

contact   each contact presses at most `OVER` times as hard as without faults, or as in the same motion without faults:
          a hand that loses its force falls into the tissue, and what is pressed deeper presses back harder
change    the force on the hand changes by at most `TURNED` times the slew rate of the controller, because the legs of
          the device turn while it holds its torques
energy    from an outage until its force has fully returned the display gives out at most `ENERGY`, plus `POWER` after
          `PATIENCE` (docs/equations/controller.md); to several hands, which exchange energy through the tissue,
          together at most that for each
silence   the device is without torque `SILENCE` after a node that its force needs has stopped or died
return    at rest, `draw.REST` after the last fault, the contact has at least `LEFT` of the force of the same motion
finite    all forces are numbers
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.engine.slot import Slot
from palpate.messages import Contact, Contacts, DeviceState, Force, Load, Pose, Proximity, Surface, Torque
from palpate.nodes.controller import PATIENCE, POWER, Haptic
from palpate.studies.faults.chain import Chain
from palpate.studies.faults.draw import Touch
from palpate.studies.faults.fault import Fault, suffer
from palpate.studies.faults.touch import Felt, same_motions
from palpate.studies.organs.score import Score

OVER, LEFT = 1.2, 0.8  # [1]
LIGHT = 0.02  # [N]
TURNED = 1.02  # [1]
ENERGY = 1e-3  # [J]
SILENCE = 20e-3  # [s]
FORCE_PATH = (Pose, Proximity, Contact, Contacts, Load, Surface, Force, Torque)

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
    judged = [_judge_hand(run, touch, one, of) for one, of in zip(felt.hands, base.hands, strict=True)]
    unlike = [k for k, (_, moved) in enumerate(judged) if moved]
    if unlike:
        same = same_motions(run, *(one.places for one in felt.hands))
        for k in unlike:
            judged[k] = _judge_hand(run, touch, felt.hands[k], base.hands[k], same[k])
    scores = [scores for scores, _ in judged]
    together = {"energy": energy.score, "silence": silence.score}
    worst = {
        name: max((one[name] for one in scores if name in one), key=lambda score: score.score)
        for name in dict.fromkeys(name for one in scores for name in one)
    }
    return worst if "finite" in worst else worst | together


def _judge_hand(
    run: Chain, touch: Touch, felt: Felt, base: Felt, same: tuple[float, float] | None = None
) -> tuple[Scores, bool]:
    """The scores of a hand, and whether it may be elsewhere than without faults, so that the contact forces of the
    `same` motion are needed: the largest one and the last [N]."""
    worst = felt.worst / touch.rate
    if not all(map(math.isfinite, (felt.contact, felt.change, felt.energy))):
        return {"finite": Score(math.inf, worst, math.nan, 0.0)}, False
    most, last = same or (base.contact, base.force)
    force = felt.force if run.tick - felt.sent < SILENCE * run.rate else 0.0
    scores = {
        "contact": _over(felt.contact, OVER * max(most, base.contact), worst),
        "change": _over(felt.change, TURNED * Haptic.slew / touch.rate, worst),
    }
    moved = same is None and (scores["contact"].broken or force < LEFT * last - LIGHT)
    least = LEFT * last - LIGHT
    score = least / max(force, 1e-12) if least > 0.0 else 0.0
    scores["return"] = Score(score, touch.duration, force, last, least)
    return scores, moved


def _over(value: float, bound: float, time: float) -> Score:
    return Score(value / max(bound, 1e-12), time, value, bound)


class _Silence:
    """The torque after a node has stopped for longer than `SILENCE`; `look` is called before each tick."""

    def __init__(self, run: Chain, faults: Sequence[Fault]) -> None:
        self.run, self.faults = run, faults
        self.needed = [(hand.device, needed_nodes(run, hand.device)) for hand in run.hands]
        self.limit = math.ceil(SILENCE * run.rate)
        self.since: dict[str, int] = {}  # by node
        self.score = Score(0.0, 0.0, 0.0, 0.0)

    def look(self, tick: int, felt: Felt) -> None:
        if not felt.places:
            self.since.clear()
        gone = {f.where for f in self.faults if f.lasts and f.kind in ("stops", "restarts")}
        self.since = {name: self.since.get(name, tick) for name in gone}
        for device, needed in self.needed:
            if any(tick - since > self.limit for name, since in self.since.items() if name in needed):
                torque = self.run.torque(device)
                if torque > 0.0:
                    self.score = Score(math.inf, tick / self.run.rate, torque, 0.0)


class _Energy:
    """The energy that the display has given out since the last outage began, until the force has returned."""

    def __init__(self, run: Chain) -> None:
        self.controllers = [slot.node for slot in run.slots if isinstance(slot.node, Haptic)]
        self.rate = run.rate
        self.begin = 0.0  # [J] absorbed when the outage began, if negative
        self.score = Score(0.0, 0.0, 0.0, ENERGY)

    def look(self, tick: int, felt: Felt) -> None:
        outage, taken = max(float(node.own["outage"]) for node in self.controllers), sum(h.taken for h in felt.hands)
        if outage == 0.0:
            self.begin = min(taken, 0.0)
            return
        bound = len(felt.hands) * (ENERGY + POWER * max(outage - PATIENCE, 0.0))
        score = _over(self.begin - taken, bound, tick / self.rate)
        self.score = max(self.score, score, key=lambda one: one.score)


def needed_nodes(run: Chain, device: Slot | None = None) -> set[str]:
    """The nodes without whose messages a device, by default the first one, has no torque. Without friction, a texture
    or the place of another finger on the same body the force continues."""
    device = device or run.device
    senders = {output.stream: (slot, output.kind) for slot in run.slots for output in slot.outputs}
    own = next((hand.contact for hand in run.hands if hand.device is device), "")
    found: set[str] = set()
    waiting = [device]
    while waiting:
        slot = waiting.pop()
        mine = any(output.stream == own for output in slot.outputs)
        for port in slot.inputs:
            sender, kind = senders.get(port.stream, (device, DeviceState))
            if kind is Proximity and port.port.optional and not mine:
                continue  # `contact.Joint` and the `contact.Share` of another finger do without
            if kind in FORCE_PATH and sender.name not in found:
                found.add(sender.name)
                waiting.append(sender)
    return found
