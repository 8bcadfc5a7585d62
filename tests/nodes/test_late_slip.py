"""Friction, texture and spikes under late messages: the finger moves as its samples say, not at a held velocity."""

import numpy as np
import pytest
from msgspec.structs import replace
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, Proximity
from palpate.nodes.friction import Coulomb, ElastoPlastic, LuGre
from palpate.nodes.spread import ROUGHEST, Kernel
from palpate.nodes.tactile import Afferents
from palpate.nodes.tactile.stress import Stress
from palpate.nodes.texture import Spectral

MS, UP = 1_000_000, (0.0, 0.0, 1.0)
LAWS = [LuGre(), LuGre(play=30e-6), ElastoPlastic(), Coulomb()]


def pressed(tick, force=1.0):
    return Contact(
        foot=(0.0, 0.0, 0.0), normal=UP, force=force, compression=1e-3, indentation=1e-3, compression_rate=0.0,
        indentation_rate=0.0, tick=tick, time=tick * MS,
    )  # fmt: skip


def near(tick, sample, path):
    """The sample of the tick `sample` of a finger that moves along x by `path` (t) [m], as it is known at a tick."""
    more = {"delayed": (tick - sample) * MS} if tick > sample else {}
    speed = (path[sample] - path[sample - 1]) / 1e-3 if sample else 0.0
    return Proximity(
        foot=(path[sample], 0.0, 0.0), normal=UP, coordinates=(0.0, 0.0), element=0, gap=3e-3, approach=1e-3,
        slip=(speed, 0.0, 0.0), tick=tick, time=tick * MS, **more,
    )  # fmt: skip


def rubbed(node, path, samples):
    """Friction (t) with the sample of the tick samples[t] at each tick."""
    bus, sent = FakeBus(node), []
    for tick, sample in enumerate(samples):
        bus.hold("proximity", near(tick, int(sample), path))
        sent += bus.publish(pressed(tick))
    return sent


def holding(count, begin, length):
    """Numbers of the samples (count) if the sample of `begin` is repeated for a while."""
    samples = np.arange(count)
    samples[begin : begin + length] = begin
    return samples


@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{type(law).__name__}-{getattr(law, 'play', 0):g}")
def test_a_finger_that_stops_while_the_network_is_silent_has_not_slid_on(law):
    """It slips by 20 um, within the presliding, and stops; the last sample says 10 mm/s, for 60 ms."""
    path = np.concatenate([np.linspace(0.0, 20e-6, 3), np.full(97, 20e-6)])
    late, now = (rubbed(law, path, s)[-1] for s in (holding(100, 2, 60), np.arange(100)))
    assert late.bristle[0] == approx(now.bristle[0], rel=1e-3, abs=1e-9) and now.bristle[0] > 15e-6
    assert late.force[0] == approx(now.force[0], rel=1e-3)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: f"{type(law).__name__}-{getattr(law, 'play', 0):g}")
def test_a_slide_keeps_its_friction_through_a_gap_and_then_turns_back(law):
    turn = np.concatenate([np.arange(60) * 50e-6, (59 - np.arange(1, 41)) * 50e-6])
    late, now = (rubbed(law, turn, s) for s in (holding(100, 40, 12), np.arange(100)))
    held = np.array([each.force[0] for each in late[40:52]])
    assert held == approx(late[40].force[0], rel=0.02), "the force stays while the sample is repeated"
    for a, b in zip(late[55:], now[55:], strict=True):
        assert a.force == approx(b.force, rel=0.02, abs=5e-3) and np.linalg.norm(a.force) <= 1.0


def test_friction_follows_the_normal_force_while_the_sample_is_repeated():
    bus, path = FakeBus(LuGre()), np.arange(60) * 50e-6
    bus.hold("proximity", near(0, 0, path))
    for tick in range(40):
        bus.hold("proximity", near(tick, tick, path))
        (full,) = bus.publish(pressed(tick))
    bus.hold("proximity", near(40, 39, path))
    (half,) = bus.publish(pressed(40, 0.5))
    assert half.force[0] == approx(0.5 * full.force[0], rel=1e-3)


@pytest.mark.parametrize(("late", "share"), [(0, 50.0), (20, ROUGHEST)])
def test_friction_of_another_time_than_the_contact_force_loads_a_body_by_at_most_twice_that_force(late, share):
    """The beams answered to friction of 1 N with 0.02 N of a late normal force with up to 900 N."""
    bus = FakeBus(Kernel(surface="plane", vertices=600))
    rub = Friction(force=(1.0, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=False, tick=100, time=100 * MS)
    bus.hold("friction", rub)
    (load,) = bus.publish(replace(pressed(100, 0.02), **({"delayed": late * MS} if late else {})))
    assert load.forces.sum(axis=0) == approx((share * 0.02, 0.0, -0.02))


def heard(samples, path, **settings):
    node = Spectral(wavelength=2e-3, roughness=0.1, **settings)
    bus, sent = FakeBus(node), []
    for tick, sample in enumerate(samples):
        proximity = near(tick, int(sample), path)
        bus.hold("contact", pressed(tick))
        bus.hold("proximity", proximity)
        sent.append(bus.publish(Friction(force=(0.5, 0.0, 0.0), bristle=(0.0, 0.0, 0.0), stick=False, tick=tick,
                                         time=tick * MS))[0][1].lateral)  # fmt: skip
    return np.concatenate(sent)


def test_a_texture_is_at_the_place_of_the_finger_after_a_gap():
    """The finger slows down from 100 to 20 mm/s while its sample is repeated for 30 ms."""
    path = np.cumsum(np.where(np.arange(120) < 40, 100e-6, 20e-6))
    late, now = (heard(s, path) for s in (holding(120, 38, 30), np.arange(120)))
    assert np.abs(late[690:] - now[690:]).max() < 1e-3 * np.abs(now[690:]).max()
    assert np.ptp(late[400:680]) > 1.5 * 0.1, "the vibration continues in the gap"


def test_spikes_of_a_late_stress_are_those_of_the_time_between_its_samples():
    """The pressure rises over 40 ms; of these samples only the first and the last arrive."""
    rising = np.interp(np.arange(200), [50, 90], [0.0, 1.0])

    def spikes(samples):
        stress, node = FakeBus(Stress(reach=9e-3, depths=(0.1e-3 * 8, 1.2e-3, 2.0e-3))), Afferents(reach=6e-3)
        node.depths = (0.8e-3, 0.9e-3, 2.0e-3)
        bus, units, moments = FakeBus(node), [], []
        for tick, sample in enumerate(samples):
            load = Load(nodes=np.array([0]), forces=np.array([[0.0, 0.0, -rising[sample]]]), foot=(0.0,) * 3,
                        normal=UP, tick=tick, time=tick * MS)  # fmt: skip
            if sample < tick:
                load = replace(load, delayed=int(tick - sample) * MS)
            (tensor,) = stress.publish(load)
            (sent,) = bus.publish(tensor)
            units.append(sent.unit)
            moments.append(sent.moment)
        return np.concatenate(units), np.concatenate(moments), [len(each) for each in units]

    unit, moment, _ = spikes(np.arange(200))
    late_unit, late_moment, sent = spikes(holding(200, 50, 40))
    assert sum(sent[51:90]) == 0 and sent[90] > 0
    assert len(unit) > 100 and np.array_equal(np.sort(unit), np.sort(late_unit))
    order, late_order = np.lexsort((moment, unit)), np.lexsort((late_moment, late_unit))
    assert late_moment[late_order] == approx(moment[order], abs=1e-6)
