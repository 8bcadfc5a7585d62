"""Spikes of the tactile afferents under the patch (docs/equations/afferents.md)."""

import math
from typing import Annotated, Literal

import msgspec
import numpy as np

from palpate.compiler.fields import element_type
from palpate.compiler.records import array_of, floats, integers, lend, lend_first, longs
from palpate.messages import Spikes, Subsurface
from palpate.nodes.base import ARRAY, TABLE, Out, Part, Wants
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.samples import GAP, sample_of
from palpate.nodes.base.samples import since as elapsed
from palpate.nodes.tactile.receptors import WithReceptors, find_receptors
from palpate.physics.afferents import fibre, population
from palpate.physics.afferents.published import RATE

LONGEST = 0.1  # [s] Limit of the computed time between messages
BLOCK = 60  # Samples per call, one bit each
SLOW = 2.5e-3  # [s] Longest time between messages whose corners the filter of the fibres removes
_STATE = element_type(fibre.STATE)
_fibres_of, _states_of = array_of(element_type(fibre.CONSTANTS)), array_of(_STATE)


class Afferents(WithReceptors):
    """Spike trains of SA1, RA1 and PC afferents under the patch, from the stress at their receptors, shear included.

    Each is one of the 17 macaque fibres of a published model, drawn with `seed`; `constants: calibrated` adjusts them
    to recorded thresholds. Their positions are random on a disc of radius `reach` with the densities of a human
    fingertip, or those of the file `units`. Vibration acts through the stress, at the rate of the messages. The same
    seed, inputs and rate result in the same spikes. While a network repeats the stress, no spike is sent; the next
    message has those of the whole time since the last one, in which the stress changes linearly.
    """

    effect = "tactile"

    stimulus: Annotated[Literal["traction", "energy"], "1"] = "traction"
    """traction: vertical and shear stress at the receptor, and the speed of the surface above it, the published inputs
    summed over the contact; energy: the strain energy density at the receptor and its rate."""
    gains: Annotated[tuple[float, float, float], "1"] = (1.0, 1.0, 1.0)
    """Factor of the input of SA1, RA1 and PC; 1: that of `constants`."""
    constants: Annotated[Literal["published", "calibrated"], "1"] = "published"
    """published: of the published fits; calibrated: RA1 with twice the cut-off frequency and 1.35 times the input, PC
    with half of it, so that their thresholds are those of recorded units (docs/equations/afferents.md)."""
    seed: Annotated[int, "1", msgspec.Meta(ge=0, lt=1 << 62)] = 1
    trial: Annotated[int, "1", msgspec.Meta(ge=0, lt=1 << 62)] = 0  # Another trial: the same finger with other noise
    smoothing: Annotated[float, "s", msgspec.Meta(gt=0)] = 0.1  # Time constant of the rates

    rates = Part("tactile", "rate", about="The smoothed rate of each afferent.")
    State = {
        "fibres": ARRAY, "state": ARRAY, "since": ARRAY, "at": TABLE, "kind": ARRAY, "keys": ARRAY, "gain": ARRAY,
        "dynamic": ARRAY, "slow": (),
        "corners": TABLE, "weights": TABLE, "basis": TABLE, "unit": ARRAY, "moment": ARRAY, "rate": ARRAY,
        "points": int, "sample": int, "rest": (), "bad": int, "counts": (3,), "average": (3,),
        "sampled": int,  # [ns] time of the last stress; -1: unknown
    }  # fmt: skip

    def start(self) -> None:
        super().start()
        self.three("gains", 0.0)
        made = self.make_population()
        n = len(made.kind)
        constants, gain = fibre.constants_of(made.fits, made.at[:, 2], self.poisson, made.kind)
        share = np.array(self.gains)[made.kind]
        gain = share * (gain if self.stimulus == "energy" else 1e-6)  # Pa to MPa
        dynamic = share * 1e-3 / (1e3 * made.at[:, 2]) ** 2  # N/m to MPa/mm
        since = np.full(n, 1000, np.int64)
        room = n * (math.ceil(LONGEST * RATE) // fibre.REFRACTORY + 2)
        held = {
            "fibres": constants, "state": np.zeros(n, _STATE), "since": since, "at": made.at, "kind": made.kind,
            "keys": made.keys, "gain": gain, "dynamic": dynamic,
            "corners": np.zeros((n, 8), np.int32), "weights": np.zeros((n, 8)),
            "basis": np.ascontiguousarray(fibre.post_spike()), "unit": np.zeros(room, np.int32),
            "moment": np.zeros(room), "rate": np.zeros(n),
        }  # fmt: skip
        for name, array in held.items():
            self.hold(name, array)
        self.own["sampled"] = -1
        self.own["counts"] = np.maximum(np.bincount(made.kind, minlength=3), 1)

    def make_population(self) -> population.Population:
        """The receptors. SettingError: the file or the densities are invalid."""
        return self.receptors(self.seed, self.trial, self.constants)

    @ieee_kernel
    def compute(own, stress: Annotated[Subsurface, Wants("points", "stress", "deflection")], out: Out[Spikes], dt):
        # place the receptors in the grid of the stress at the first message
        tensor, corners, weights = floats(stress.stress), integers(own.corners), floats(own.weights)
        state, since, begins = _states_of(own.state), longs(own.since), own.points == 0
        if not find_receptors(own, stress):
            return
        # samples of this step, at RATE
        moved = elapsed(own, sample_of(stress), dt)
        if moved == 0.0:  # repeated by a network
            lend_first(out.unit, own.unit, 0)
            lend_first(out.moment, own.moment, 0)
            return
        span = min(moved if moved > GAP * dt else dt, LONGEST)
        if not begins:
            own.slow = max(own.slow, min(dt, LONGEST))
        count = int((own.rest + span) * RATE + 1e-6)
        unit, moment, now = integers(own.unit), floats(own.moment), (stress.time - stress.delayed) * 1e-9
        first, stride = (1.0 / RATE - own.rest) / span, 1.0 / RATE / span
        left = own.rest + span - count / RATE
        fibres, keys, gain, basis = _fibres_of(own.fibres), longs(own.keys), floats(own.gain), floats(own.basis)
        kind, rate = integers(own.kind), floats(own.rate)
        dynamic, surface, energy = floats(own.dynamic), floats(stress.deflection), own.stimulus == 1
        fade, spikes = own.smoothing / (own.smoothing + span), 0
        for which in range(3):
            own.average[which] *= fade
        # each afferent: stimulus at its receptor, membrane model, spikes
        for n in range(len(corners)):
            if energy:
                target = gain[n] * population.equivalent(tensor, corners[n], weights[n], own.poisson)
            else:
                target = gain[n] * population.traction(tensor, corners[n], weights[n])
            if energy or len(surface) == 0:
                above = fibres[n].dynamic * target
            else:
                above = dynamic[n] * population.deflection_stimulus(surface, corners[n], weights[n])
            if begins:
                state[n].target, state[n].path_target = target, above
            fired_before = spikes
            for start in range(0, count, BLOCK):
                part = min(BLOCK, count - start)
                fired, since[n] = fibre.advance(
                    fibres[n], state[n], since[n], basis, keys[n], own.sample + start, part,
                    first + start * stride, stride, target, above,
                )  # fmt: skip
                k = start
                while fired:
                    if fired & 1:
                        unit[spikes] = n
                        moment[spikes] = now - left - (count - 1 - k) / RATE
                        spikes += 1
                    fired >>= 1
                    k += 1
            state[n].target, state[n].path_target = target, above
            more = (spikes - fired_before) / (own.smoothing + span)
            own.average[kind[n]] += more / own.counts[kind[n]]
            if own.rates:
                rate[n] = rate[n] * fade + more
        own.sample += count
        own.rest = max(left, 0.0)
        lend_first(out.unit, own.unit, spikes)
        lend_first(out.moment, own.moment, spikes)
        for which in range(3):
            out.mean[which] = own.average[which]
        if own.rates:
            lend(out.rate, own.rate)

    def notes(self) -> list[str]:
        if self.known["slow"] > SLOW:
            self._note_once(
                f"Afferents: the stress arrived every {1e3 * self.own['slow']:.3g} ms. Between messages it is linear, "
                "and its corners are vibrations to PC; give tactile.Stress no divisor, and the graph 500 Hz or more"
            )
        return super().notes()
