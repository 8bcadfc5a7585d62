"""`tactile.Afferents` on the stress that `tactile.Stress` sends."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Load, MessageError, Subsurface
from palpate.nodes.base import SettingError
from palpate.nodes.tactile import Afferents
from palpate.nodes.tactile.stress import Stress
from palpate.physics.afferents.published import DEPTHS

SA1, RA1, PC = range(3)


def grid(reach=8e-3, points=9, depths=DEPTHS):
    line = np.linspace(-reach, reach, points)
    return np.array([(x, y, z) for z in depths for x in line for y in line])


def pressed(stress=(0, 0, -1e4, 0, 0, 0), scale=1.0, points=None):
    points = grid() if points is None else points
    return Subsurface(points=points, stress=np.tile(scale * np.array(stress, float), (len(points), 1)))


def run(course, node=None, rate=1000.0, **settings):
    """Unit and moment of all spikes of messages of this scale, the types of the units, and the last message."""
    node = node or Afferents(**settings)
    bus = FakeBus(node, rate=rate)
    sent = [bus.publish(pressed(scale=scale))[0] for scale in course]
    unit, moment = (np.concatenate([getattr(each, name) for each in sent]) for name in ("unit", "moment"))
    return unit, moment, node.population.kind, sent


def ramp_and_hold(rate=1000.0, depth=2.0, hold=0.6):
    t = np.arange(round((0.3 + hold) * rate)) / rate
    return depth * np.clip((t - 0.1) / 0.05, 0, 1) * np.clip((0.2 + hold - t) / 0.05, 0, 1)


def test_sa1_fire_in_a_hold_and_ra1_and_pc_at_its_onset_and_end():
    unit, moment, kind, sent = run(ramp_and_hold())
    count = np.bincount(kind)

    def rate(which, begin, end):
        return np.sum((kind[unit] == which) & (moment > begin) & (moment <= end)) / count[which] / (end - begin)

    assert rate(SA1, 0.1, 0.15) > rate(SA1, 0.4, 0.75) > 10.0
    for which in (RA1, PC):
        assert rate(which, 0.1, 0.17) > 5.0 and rate(which, 0.75, 0.82) > 1.0
        assert rate(which, 0.3, 0.75) < 0.05
    assert sent[-1].mean[SA1] > 0.0 and len(sent[-1].rate) == len(kind)


def test_the_rates_match_the_spikes():
    unit, moment, kind, sent = run(np.full(600, 2.0))
    late = moment > 0.1
    assert sent[-1].mean[SA1] == approx(np.sum(late & (kind[unit] == SA1)) / np.sum(kind == SA1) / 0.5, rel=0.2)
    assert np.mean(sent[-1].rate[kind == SA1]) == approx(sent[-1].mean[SA1])


def test_spikes_are_reproducible_and_differ_by_seed():
    course = ramp_and_hold(hold=0.2)
    first, again, other = run(course), run(course), run(course, seed=2)
    assert np.array_equal(first[0], again[0]) and np.array_equal(first[1], again[1])
    assert not np.array_equal(first[0], other[0])
    node = Afferents(trial=3)
    noisy = run(course, node=node)
    assert not np.array_equal(first[0], noisy[0]) and len(first[0]) == approx(len(noisy[0]), rel=0.05)
    assert np.array_equal(node.population.at, Afferents().make_population().at)


def test_spikes_at_5_khz_equal_those_at_1_khz_for_the_same_stress():
    """A ramp with corners on ticks of both rates is the same line."""
    settings = {"densities": (0.2e6, 0.2e6, 0.2e6)}
    coarse = run(np.interp(np.arange(300), [0, 100, 150, 300], [0, 0, 2, 2]), **settings)
    fine = run(np.interp(np.arange(1500), [4, 504, 754, 1504], [0, 0, 2, 2]), rate=5000.0, **settings)
    assert len(coarse[0]) > 100
    assert np.bincount(coarse[0], minlength=60) == approx(np.bincount(fine[0], minlength=60), abs=2)
    assert len(coarse[0]) == approx(len(fine[0]), rel=0.03)


def test_messages_at_another_rate_omit_no_sample():
    node = Afferents(densities=(0.3e6, 0, 0))
    run(np.full(1701, 2.0), node=node, rate=1700.0)
    assert int(node.own["sample"]) == approx(5000, abs=4)


def test_shear_alone_causes_spikes():
    node = Afferents(densities=(0.3e6, 0.3e6, 0))
    bus = FakeBus(node)
    sent = [bus.publish(pressed((0, 0, 0, 0, 1e4, 0), scale=min(k / 50, 1.0)))[0] for k in range(300)]
    kinds = node.population.kind[np.concatenate([each.unit for each in sent])]
    assert (np.bincount(kinds, minlength=2) > 50).all()


def test_rates_of_each_unit_are_computed_only_if_they_are_read():
    node = Afferents(densities=(0.3e6, 0, 0))
    node.wanted = {"unit", "moment"}
    assert not len(FakeBus(node).publish(pressed(scale=2.0))[0].rate)


def test_only_the_stress_may_be_read():
    node = Stress(depths=(1e-3,), spacing=4e-3, reach=8e-3)
    node.wanted = {"points", "stress"}
    load = Load(nodes=np.zeros(1, "<i4"), forces=np.array([[0, 0, -1.0]]), foot=(0, 0, 0), normal=(0, 0, 1.0))
    sent = FakeBus(node).publish(load)[0]
    assert len(sent.stress) == len(sent.points) and not len(sent.von_mises)
    assert len(FakeBus(Afferents(depths=(1e-3, 1e-3, 1e-3))).publish(sent)[0].mean) == 3


def test_a_gap_of_messages_gives_spikes_at_its_end_only():
    node = Afferents(densities=(0.3e6, 0, 0))
    bus = FakeBus(node)
    bus.publish(pressed(scale=3.0))
    bus.tick = 5000
    sent = bus.publish(pressed(scale=3.0))[0]
    assert len(sent.moment) and sent.moment.min() > 4.89 and sent.moment.max() <= 5.0


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"densities": (-1.0, 0.0, 0.0)}, "'densities': found .*SA1, RA1, PC, from 0 on"),
        ({"densities": (1e12, 0.0, 0.0)}, "SA1: found .* receptors, expected at most 20000"),
        ({"depths": (0.0, 1e-3, 1e-3)}, "'depths'"),
        ({"units": "/nowhere/units.csv"}, "'units': .*nowhere"),
    ],
)
def test_bad_settings_are_errors(given, says):
    with pytest.raises(SettingError, match=says):
        FakeBus(Afferents(**given))


def test_receptors_are_read_from_a_file(tmp_path):
    file = tmp_path / "units.csv"
    file.write_text("type,x,y,depth\nPC,0.001,0,\nSA1,0,0.002,0.0005\n")
    node = Afferents(units=str(file))
    FakeBus(node)
    assert node.population.kind.tolist() == [SA1, PC]
    assert node.population.at == approx(np.array([[0, 0.002, 0.0005], [0.001, 0, 0.002]]))
    file.write_text("type,x,y\nSA2,0,0\n")
    with pytest.raises(SettingError, match=r"line 2: found .*SA2.*expected a type of SA1, RA1, PC"):
        FakeBus(Afferents(units=str(file)))
    file.write_text("type,x,y\n")
    with pytest.raises(SettingError, match="no receptors"):
        FakeBus(Afferents(units=str(file)))


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (grid(depths=(0.3e-3, 1.6e-3)), r"PC receptor \d+ .* 2 mm deep: .* 0.3 to 1.6 mm deep"),
        (grid(reach=4e-3), "SA1 receptor .* x -4 to 4"),
        (np.random.default_rng(1).random((50, 3)), "50 points of stress: expected a square grid"),
        (np.zeros((0, 3)), "is empty"),
    ],
)
def test_stress_that_does_not_cover_the_receptors_is_an_error(points, says):
    with pytest.raises(MessageError, match=says):
        FakeBus(Afferents()).publish(pressed(points=points))


def test_without_receptors_no_spikes_are_sent():
    sent = FakeBus(Afferents(densities=(0.0, 0.0, 0.0))).publish(pressed())[0]
    assert not len(sent.unit) and sent.mean == (0.0, 0.0, 0.0)
