"""Imperfections of a sensor with several channels, which its node measures at each tick."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import numpy as np

from palpate.compiler.records import floats
from palpate.nodes.base.compiled import ARRAY, TABLE, CompiledNode
from palpate.nodes.base.effect import Switch
from palpate.nodes.base.kernels import ieee_kernel
from palpate.physics.device import random_numbers
from palpate.physics.device.random_numbers import seed_state
from palpate.physics.sensor.errors import convert, low_pass, normal, play

QUEUE = 1024  # Samples that a delay may hold
SOON = 1e-9  # [s] Rounding of the clock
MINUTE = 60.0  # [s]
Share = msgspec.Meta(ge=0, le=1)


class Sensing(CompiledNode):
    """Imperfections of a sensor. By default none is on; each is an effect. Shares are of the full scale
    of a channel, as data sheets list them. In the order of the signal:

    crosstalk     largest share of one channel that another one shows, both over their full scale (`mix`)
    hysteresis    width of the loop that a cycle encloses (play)
    cutoff        of a first-order low pass
    bias          constant offset; each channel has its sign by `seed`
    drift         standard deviation of a random walk of the zero after one minute
    noise         standard deviation of white noise of each sample
    saturation    largest reported magnitude; 1 is the full scale
    resolution    step of the converter
    rate          samples per second, at most one per tick
    delay         time from a sample to its message
    seed          of noise, drift, and the differences between channels
    """

    crosstalk: Annotated[float, "1", Share, Switch("crosstalk")] = 0.0
    hysteresis: Annotated[float, "1", Share, Switch("hysteresis")] = 0.0
    cutoff: Annotated[float, "Hz", msgspec.Meta(ge=0, le=1e6), Switch("low_pass")] = 0.0
    bias: Annotated[float, "1", Share, Switch("bias")] = 0.0
    drift: Annotated[float, "1", Share, Switch("drift")] = 0.0
    noise: Annotated[float, "1", Share, Switch("noise")] = 0.0
    saturation: Annotated[float, "1", Share, Switch("saturation")] = 0.0
    resolution: Annotated[float, "1", Share, Switch("quantisation")] = 0.0
    rate: Annotated[float, "Hz", msgspec.Meta(ge=0, le=1e6), Switch("sampling")] = 0.0
    delay: Annotated[float, "s", msgspec.Meta(ge=0, le=1), Switch("delay")] = 0.0
    seed: Annotated[int, "1", msgspec.Meta(ge=0, le=2**63 - 1)] = 0

    State = {
        "true": ARRAY, "full": ARRAY, "mixing": TABLE, "offset": ARRAY, "played": ARRAY, "smooth": ARRAY,
        "walk": ARRAY, "reported": ARRAY, "queue": TABLE, "stamps": ARRAY, "first": int, "held": int, "clock": (),
        "due": (), "elapsed": (), "begun": bool, "random": random_numbers.STATE, "clipped": bool, "dropped": bool,
    }  # fmt: skip
    """Channels: what acts on them, their full scale, what each shows of the others, bias, output of the play and of the
    low pass, drift, last report. Samples on their way with their times [s], the index of the first one and their
    number; time [s], that of the next sample, that since the last one; whether a sample was taken; whether the last
    sample was limited; whether the queue was full."""

    def scale(self) -> np.ndarray:
        """Full scale of each channel (n,)."""
        raise NotImplementedError

    def mixing(self, random: np.random.Generator) -> np.ndarray:
        """Share (n,n) of each channel that each other one shows at a crosstalk of 1, both over their full scale."""
        n = len(self.scale())
        return random.uniform(-1.0, 1.0, (n, n)) * (1.0 - np.eye(n))

    def start(self) -> None:
        super().start()
        full = self.scale()
        random, n = np.random.Generator(np.random.PCG64(self.seed)), len(full)
        signs = np.where(random.random(n) < 0.5, -1.0, 1.0)
        mixing = np.eye(n)
        if self.crosstalk:
            mixing += self.crosstalk * self.mixing(random) * full[:, None] / full[None, :]
        held = {"full": full, "mixing": mixing, "offset": self.bias * signs * full}
        for name in ("true", "played", "smooth", "walk", "reported"):
            held[name] = np.zeros(n)
        room = QUEUE if self.delay else 1
        held |= {"queue": np.zeros((room, n)), "stamps": np.zeros(room)}
        for name, array in held.items():
            self.hold(name, np.ascontiguousarray(array))
        self.own["random"] = seed_state(self.seed)

    def notes(self) -> list[str]:
        if self.known["dropped"]:
            self._note_once(
                f"{type(self).__name__}: the delay of {1e3 * self.delay:.4g} ms holds more than {QUEUE} samples; the "
                "oldest ones were sent early. Set a lower rate"
            )
        return super().notes()


@ieee_kernel
def measure(own, dt):
    """Pass what acts on the channels, `own.true`, through the imperfections into `own.reported`."""
    true, full, mixing = floats(own.true), floats(own.full), floats(own.mixing)
    played, smooth, reported = floats(own.played), floats(own.smooth), floats(own.reported)
    n = len(true)
    own.clock += dt
    own.elapsed += dt
    for i in range(n):
        value = true[i]
        if own.crosstalk > 0.0:
            value = 0.0
            for j in range(n):
                value += mixing[i, j] * true[j]
        played[i] = play(value, played[i], own.hysteresis * full[i])
        smooth[i] = low_pass(played[i], smooth[i], own.cutoff, dt) if own.cutoff > 0.0 and own.begun else played[i]
    if own.rate == 0.0 or own.clock >= own.due - SOON or not own.begun:
        if own.rate > 0.0:
            own.due = max((own.due if own.begun else own.clock) + 1.0 / own.rate, own.clock)
        take_sample(own, full, smooth)
        own.begun = True
    if own.delay > 0.0:
        queue, stamps = floats(own.queue), floats(own.stamps)
        while own.held > 0 and stamps[own.first] + own.delay <= own.clock + SOON:
            for i in range(n):
                reported[i] = queue[own.first, i]
            own.first = (own.first + 1) % len(stamps)
            own.held -= 1


@ieee_kernel
def take_sample(own, full, smooth):
    """Sample all channels: add bias, drift and noise, and convert; send it to the queue of a delay."""
    walk, offset, queue, stamps = floats(own.walk), floats(own.offset), floats(own.queue), floats(own.stamps)
    reported, room = floats(own.reported), len(stamps)
    place = 0
    if own.delay > 0.0:
        if own.held == room:
            own.dropped = True
            own.first, own.held = (own.first + 1) % room, own.held - 1
        place = (own.first + own.held) % room
        stamps[place] = own.clock
        own.held += 1
    own.clipped = False
    for i in range(len(full)):
        value = smooth[i] + offset[i]
        if own.drift > 0.0:
            walk[i] += own.drift * full[i] * math.sqrt(own.elapsed / MINUTE) * normal(own.random)
            value += walk[i]
        if own.noise > 0.0:
            value += own.noise * full[i] * normal(own.random)
        largest = own.saturation * full[i]
        own.clipped = own.clipped or (largest > 0.0 and abs(value) >= largest)
        value = convert(value, largest, own.resolution * full[i])
        if own.delay > 0.0:
            queue[place, i] = value
        else:
            reported[i] = value
    own.elapsed = 0.0
