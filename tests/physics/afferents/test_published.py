"""The afferents of the model against published curves and values (docs/equations/afferents.md)."""

import numpy as np
import pytest
from pytest import approx
from test_fibre import spikes_of

from palpate.launch.testing import FakeBus
from palpate.messages import Subsurface
from palpate.nodes.tactile import Afferents
from palpate.physics.afferents.published import DEPTHS, FITS, PROBE, RATE
from palpate.physics.contact.subsurface import PAIRS, point_stress, under_patch

SA1, RA1, PC = range(3)
MODULUS = 0.05 / (1 - 0.4**2)  # [MPa] of the skin of the published fits, E/(1 - nu²)


def under_probe(kind, u):
    """The input s [MPa] below a probe that indents the skin by u [mm]."""
    zeta, radius = DEPTHS[kind] / PROBE, 1e3 * PROBE
    return MODULUS * (1 + 3 * zeta**2) / (np.pi * radius * (1 + zeta**2) ** 2) * u


def train(kind, fit, u, noise=True):
    """Spike times [s] of a fibre for an indentation u [mm] at 5 kHz."""
    return np.array(spikes_of(fit, DEPTHS[kind], under_probe(kind, u), noise=noise)) / RATE


def threshold(kind, fit, frequency):
    """Amplitude [dB re 1 um] of the sinusoid that makes a spike in every second cycle, or 10 in 0.5 s."""
    t = np.arange(round(0.5 * RATE)) / RATE
    low, high = -5.0, 1.3  # log10 of mm
    for _ in range(10):
        middle = 0.5 * (low + high)
        count = len(train(kind, fit, 10**middle * np.sin(2 * np.pi * frequency * t)))
        low, high = (low, middle) if count >= 0.5 * min(0.5 * frequency, 20.0) else (middle, high)
    return 20.0 * (high + 3.0)


@pytest.mark.long
def test_pc_are_tuned_as_the_pacinian_channel():
    """Bolanowski et al. 1988: 12 dB per octave below the best frequency, which is 200 to 300 Hz."""
    frequencies = [50.0, 100.0, 200.0, 250.0, 300.0, 400.0, 800.0]
    median = np.median([[threshold(PC, fit, f) for f in frequencies] for fit in FITS[PC]], axis=0)
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
    median = np.median([[threshold(RA1, fit, f) for f in frequencies] for fit in FITS[RA1]], axis=0)
    best = median.min()
    assert median[3] - best < 3.0 and median[2] - best < 6.0
    assert median[0] - best > 10.0 and median[6] - best > 10.0
    pc = np.median([threshold(PC, fit, 250.0) for fit in FITS[PC]])
    assert pc < best - 20.0


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


@pytest.mark.parametrize(
    ("kind", "frequency", "above", "least"), [(RA1, 40.0, 2.0, 0.6), (PC, 250.0, 2.0, 0.8), (SA1, 10.0, 3.0, 0.8)]
)
def test_spikes_lock_to_the_phase_of_a_sinusoid(kind, frequency, above, least):
    """Above its threshold a fibre fires in a narrow part of the cycle, or of each half of it, as some RA1 do; measured
    by the vector strength R at the frequency or at its double (1: one phase)."""
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
    """A flat bar, 8 mm wide: its pressure P/(pi sqrt(a² - x²)) is that of a rigid one on a half-space."""
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
