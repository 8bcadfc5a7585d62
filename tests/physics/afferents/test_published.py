"""The afferents of the model compared with published curves and values (docs/equations/afferents.md)."""

import numpy as np
import pytest
from pytest import approx
from test_fibre import spikes_of

from palpate.launch.testing import FakeBus
from palpate.messages import Subsurface
from palpate.nodes.tactile import Afferents
from palpate.physics.afferents.probe import input_of, tuning_threshold
from palpate.physics.afferents.published import DEPTHS, FITS, PROBE, RATE
from palpate.physics.contact.subsurface import PAIRS, point_stress, under_patch

SA1, RA1, PC = range(3)


def train(kind, fit, u, noise=True):
    """Spike times [s] of a fibre for an indentation u [mm] at 5 kHz."""
    return np.array(spikes_of(kind, fit, input_of(kind, u), noise=noise)) / RATE


def least_amplitude(kind, fit, frequency, seconds, begin, spikes):
    """Amplitude [dB re 1 um] of the sinusoid that makes this number of spikes from `begin` to `seconds` [s]."""
    t = np.arange(round(seconds * RATE)) / RATE
    low, high = -5.0, 1.3  # log10 of mm
    for _ in range(10):
        middle = 0.5 * (low + high)
        count = np.sum(train(kind, fit, 10**middle * np.sin(2 * np.pi * frequency * t)) >= begin)
        low, high = (low, middle) if count >= spikes else (middle, high)
    return 20.0 * (high + 3.0)


def threshold(kind, fit, frequency):
    """Amplitude for a spike in every second cycle, or 10 in 0.5 s: near the threshold of the first spikes."""
    return least_amplitude(kind, fit, frequency, 0.5, 0.0, 0.5 * min(0.5 * frequency, 20.0))


def tuning(kind, fit, frequency):
    """Amplitude for one spike per cycle after 4 cycles: the tuning threshold of Talbot et al. 1968, I_1 of Johnson
    1974."""
    return tuning_threshold(kind, int(np.flatnonzero((FITS[kind] == fit).all(axis=1))[0]), frequency)


def medians(of, kind, frequencies):
    return np.median([[of(kind, fit, f) for f in frequencies] for fit in FITS[kind]], axis=0)


def test_at_its_threshold_a_fibre_fires_once_per_cycle():
    for gain in (1.0, 2.0):
        level = tuning_threshold(RA1, 2, 40.0, gain)
        assert level + 20.0 * np.log10(gain) == approx(tuning_threshold(RA1, 2, 40.0), abs=0.2)
    t = np.arange(round(0.6 * RATE)) / RATE
    more, less = (
        np.sum(
            train(RA1, FITS[RA1][2], 10 ** ((level + 6.02 + change) / 20.0 - 3.0) * np.sin(2 * np.pi * 40 * t)) > 0.1
        )
        for change in (0.3, -3.0)
    )
    assert more >= 20 > less


@pytest.mark.long
def test_pc_have_the_tuning_of_the_pacinian_channel():
    """Bolanowski et al. 1988: 12 dB per octave below the best frequency, which is 200 to 300 Hz."""
    frequencies = [50.0, 100.0, 200.0, 250.0, 300.0, 400.0, 800.0]
    median = medians(threshold, PC, frequencies)
    assert (median[0] - median[1], median[1] - median[2]) == approx((12.0, 12.0), abs=2.0)
    best = median.min()
    assert median[3] - best < 3.0 and median[4] - best < 2.0
    assert median[2] - best > 3.0 and median[6] - best > 4.0  # U-shaped
    assert -20.0 < best < -5.0  # [dB re 1 um]


@pytest.mark.long
def test_ra1_are_tuned_to_lower_frequencies_than_pc():
    """40 to 60 Hz is the published best range of RA afferents (J. Neurophysiol. 101 (2009) 1033, table 1). The fits are
    best at 60 to 100 Hz: 60 Hz is within 3 dB of the least threshold, and 40 Hz within 6 dB."""
    frequencies = [10.0, 20.0, 40.0, 60.0, 80.0, 150.0, 300.0]
    median = medians(threshold, RA1, frequencies)
    best = median.min()
    assert median[3] - best < 3.0 and median[2] - best < 6.0
    assert median[0] - best > 10.0 and median[6] - best > 10.0
    assert medians(threshold, PC, [250.0])[0] < best - 20.0


@pytest.mark.long
def test_ra1_follow_each_cycle_best_at_25_to_45_hz():
    """W. H. Talbot et al., J. Neurophysiol. 31 (1968) 301: the amplitude for one spike per cycle of quickly adapting
    fibres of monkeys is least at 30 to 40 Hz; human RA1 are most easily excited at 8 to 64 Hz (R. S. Johansson et al.,
    Brain Res. 244 (1982) 17)."""
    frequencies = np.array([5.0, 10.0, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 60.0, 100.0, 200.0])
    median = medians(tuning, RA1, frequencies)
    best, flat = median.min(), (frequencies >= 25.0) & (frequencies <= 45.0)
    assert median[flat].min() - best < 0.5 and median[flat].max() - best < 1.5
    assert median[0] - best > 5.0 and median[1] - best > 2.5  # U-shaped
    assert median[-3] - best > 2.0 and median[-2] - best > 5.0 and median[-1] - best > 20.0


@pytest.mark.long
def test_pc_follow_each_cycle_best_at_200_to_300_hz():
    """Talbot et al. 1968: 200 to 300 Hz. In absolute terms the human P channel detects 0.1 um, -20 dB re 1 um, at 250
    Hz with 2.9 cm² (Bolanowski et al. 1988), by spatial summation 3 dB per doubling of the area (J. C. Craig,
    C. E. Sherrick, Percept. Psychophys. 6 (1969) 97): 26 dB more for the probe of the fits."""
    frequencies = np.array([50.0, 100.0, 200.0, 250.0, 300.0, 400.0, 600.0])
    median = medians(tuning, PC, frequencies)
    assert frequencies[median.argmin()] in (200.0, 250.0, 300.0)
    assert (median[[0, 1, 5, 6]] - median.min() > 5.0).all()
    alike = -20.0 + 10.0 * np.log10(290.0 / (np.pi * (1e3 * PROBE) ** 2))
    assert median[3] == approx(alike, abs=5.0)


def test_sa1_rates_are_linear_in_the_depth():
    """F. Vega-Bermudez, K. O. Johnson, J. Neurophysiol. 81 (1999) 2701: SA1 impulse rates are linear functions of the
    depth of a probe, RA1 saturate."""
    t = np.arange(round(0.9 * RATE)) / RATE
    depths = np.array([0.4, 0.8, 1.2, 1.6])  # [mm]
    for fit in FITS[SA1]:
        rates = [np.sum(train(SA1, fit, depth * np.clip(t / 0.05, 0, 1)) > 0.3) / 0.6 for depth in depths]
        assert np.corrcoef(depths, rates)[0, 1] > 0.99 and rates[-1] > 2.5 * rates[0] > 0.0


def test_sa1_adapt_from_a_burst_at_the_onset():
    t = np.arange(round(1.0 * RATE)) / RATE
    for fit in FITS[SA1]:
        times = train(SA1, fit, 2.0 * np.clip(t / 0.05, 0, 1))
        onset, late = np.sum(times < 0.1) / 0.1, np.sum(times > 0.6) / 0.4
        assert onset > 1.2 * late > 20.0


def test_sa1_adapt_slowly_as_in_nerves():
    """J. Mei et al., J. Neurosci. 3 (1983) 2652: after a ramp of 0.4 mm/s, the mean rate of 21 fibres of macaques falls
    by 38 % (0.65 mm) and 36 % (1.3 mm) in the first 12 s of a steady indentation; without slow adaptation by less
    than 10 %."""
    for depth, decline in ((0.65, 0.38), (1.3, 0.36)):
        ramp = depth / 0.4
        t = np.arange(round((ramp + 12.0) * RATE)) / RATE
        after = np.concatenate([train(SA1, fit, depth * np.clip(t / ramp, 0, 1)) for fit in FITS[SA1]]) - ramp
        rates = np.histogram(after, [0, 1, 2, 4, 8, 11, 12])[0] / [1, 1, 2, 4, 3, 1]
        assert 1.0 - rates[-1] / rates[0] == approx(decline, abs=0.05)
        assert rates[0] > rates[1] > rates[2] > rates[3]  # most of the adaptation is in the first seconds


def test_sa1_recover_from_adaptation():
    t = np.arange(round(20.0 * RATE)) / RATE
    for fit in FITS[SA1]:
        times = train(SA1, fit, np.where((t < 6.0) | (t > 6.0 + 6.0), 1.3, 0.0) * np.clip(t / 0.05, 0, 1))
        first, adapted, again = (np.sum((times > at) & (times < at + 1.0)) for at in (0.2, 5.0, 12.2))
        assert again > 0.9 * first > 1.1 * adapted
        assert not np.any((times > 6.3) & (times < 12.0))  # an adapted fibre is silent when released


@pytest.mark.parametrize(
    ("kind", "frequency", "above", "least"), [(RA1, 40.0, 2.0, 0.6), (PC, 250.0, 2.0, 0.8), (SA1, 10.0, 3.0, 0.8)]
)
def test_spikes_lock_to_the_phase_of_a_sinusoid(kind, frequency, above, least):
    """Above its threshold a fibre fires in a narrow part of the cycle or, as some RA1, of each half cycle. The measure
    is the vector strength R at the frequency or at its double (1: one phase)."""
    t = np.arange(round(1.0 * RATE)) / RATE
    amplitude = above * {RA1: 0.026, PC: 0.0003, SA1: 0.08}[kind]  # [mm] times the median threshold
    strengths = []
    for fit in FITS[kind]:
        times = train(kind, fit, amplitude * np.sin(2 * np.pi * frequency * t))
        if len(times) > 5:
            phase = 2j * np.pi * frequency * times
            strengths.append(max(abs(np.mean(np.exp(phase))), abs(np.mean(np.exp(2.0 * phase)))))
    assert len(strengths) >= 0.5 * len(FITS[kind]) and np.median(strengths) > least


def messages(points, stress, course):
    return [Subsurface(points=points, stress=scale * stress) for scale in course]


def square(reach, points, depths):
    line = np.linspace(-reach, reach, points)
    return np.array([(x, y, z) for z in depths for x in line for y in line])


def test_sa1_fire_most_below_the_edges_of_a_bar():
    """A flat bar, 8 mm wide, with the pressure of a rigid bar on a half-space, P/(pi sqrt(a² - x²))."""
    depth = DEPTHS[SA1]
    points = square(6e-3, 49, (depth,))
    across = 4e-3 * np.cos(np.pi * (np.arange(96) + 0.5) / 96)
    along = np.arange(-30e-3, 30e-3, 0.25e-3)
    column = np.unique(points[:, 0])
    apart = np.stack(np.meshgrid(column, across, along, indexing="ij"), -1)
    apart = np.stack([apart[..., 0] - apart[..., 1], -apart[..., 2], np.full(apart.shape[:3], depth)], -1)
    tensor = point_stress(apart, 0.45)[..., 2].sum(axis=2).mean(axis=1)
    rows = np.stack([tensor[:, i, j] for i, j in PAIRS], axis=1)
    stress = rows[np.searchsorted(column, points[:, 0])]
    stress *= -1.0e4 / stress[len(stress) // 2, 2]  # 10 kPa at the middle
    node = Afferents(reach=6e-3, densities=(8e6, 0, 0), depths=(depth, depth, depth))
    bus = FakeBus(node)
    sent = bus.publish(*messages(points, stress, np.clip(np.arange(600) / 50, 0, 1)))
    count = np.bincount(np.concatenate([each.unit for each in sent[200:]]), minlength=len(node.population.kind))
    x = abs(node.population.at[:, 0])
    middle, edge, outside = count[x < 1.5e-3], count[abs(x - 4e-3) < 0.3e-3], count[x > 5.2e-3]
    assert min(map(len, (middle, edge, outside))) > 20
    assert edge.mean() > 2.0 * middle.mean() > 0.0 and outside.mean() < 0.5 * middle.mean()


@pytest.mark.long
def test_sliding_over_dots_raises_ra1_and_pc_with_speed():
    """Dots 2 mm in radius, 6 mm apart, slide past the receptors with 0.3 N each."""
    points = square(4e-3, 9, (DEPTHS[RA1], DEPTHS[PC]))
    shifts = np.arange(24) * 0.25e-3
    tensors = []
    for shift in shifts:
        dots = [np.array([at + shift, 0.0, 0.0]) for at in np.arange(-18e-3, 19e-3, 6e-3)]
        tensors.append(sum(0.3 * under_patch(points - dot, 2e-3, "biweight", 0.45)[..., 2] for dot in dots))
    course = np.array([[each[:, i, j] for i, j in PAIRS] for each in tensors]).transpose(0, 2, 1)
    rates = []
    for speed in (0.01, 0.04, 0.16):  # [m/s]
        node = Afferents(reach=4e-3, densities=(0, 3e6, 2e6), depths=(DEPTHS[RA1], DEPTHS[RA1], DEPTHS[PC]))
        bus, spikes = FakeBus(node), np.zeros(3)
        for k in range(700):
            at = (k * 1e-3 * speed / 0.25e-3) % 24
            low, part = int(at), at % 1.0
            stress = (1 - part) * course[low] + part * course[(low + 1) % 24]
            unit = bus.publish(Subsurface(points=points, stress=stress))[0].unit
            if k >= 100:
                spikes += np.bincount(node.population.kind[unit], minlength=3)
        rates.append(spikes / np.maximum(np.bincount(node.population.kind, minlength=3), 1) / 0.6)
    rates = np.array(rates)
    assert (np.diff(rates[:, RA1]) > 0.0).all() and rates[-1, RA1] > 2.0 * rates[0, RA1]
    assert (np.diff(rates[:, PC]) > 0.0).all()
