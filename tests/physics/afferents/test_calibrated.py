"""The calibrated constants compared with medians of recorded units, docs/equations/afferents.md."""

import numpy as np
import pytest
from pytest import approx
from test_fibre import reference, spikes_of

from palpate.launch.testing import FakeBus
from palpate.messages import Subsurface
from palpate.nodes.tactile import Afferents
from palpate.physics.afferents.calibrated import CONSTANTS, adjust
from palpate.physics.afferents.probe import median_threshold
from palpate.physics.afferents.published import DEPTHS, FITS, RATE

SA1, RA1, PC = range(3)
RECORDED = {
    RA1: {5: 37.4, 10: 39.0, 20: 33.7, 30: 32.2, 40: 31.7, 60: 34.7, 100: 37.0, 130: 38.5, 150: 37.6, 200: 40.3},
    PC: {20: 39.3, 40: 26.2, 60: 22.9, 80: 19.7, 100: 17.1, 150: 15.6, 200: 15.4, 250: 16.5},
}
"""[dB re 1 um] Medians of 11 units of each type over frequency [Hz]."""


@pytest.mark.parametrize(("kind", "worst", "published"), [(RA1, 3.5, 15.0), (PC, 7.0, 12.0)])
def test_thresholds_are_those_of_the_recorded_units(kind, worst, published):
    """Within 3.5 dB for RA1 and 7 dB for PC at every frequency; the published constants are up to 20 and 13 dB off."""
    off = {
        name: np.array([median_threshold(kind, f, fits=fits) - level for f, level in RECORDED[kind].items()])
        for name, fits in CONSTANTS.items()
    }
    assert np.abs(off["calibrated"]).max() < worst < published < np.abs(off["published"]).max()
    assert np.median(off["calibrated"]) == approx(0.0, abs=1.5)


@pytest.mark.parametrize("kind", [RA1, PC])
def test_the_adjusted_constants_are_those_of_the_equations(kind):
    """A gain is a factor of the input; the cut-off is that of scipy's filter."""
    t = np.arange(2500) / RATE
    s = 0.04 * (0.5 * np.clip(t / 0.05, 0, 1) + 0.1 * np.sin(2 * np.pi * 150 * t))
    made = adjust((1.0, 2.0, 0.8), (1.0, 1.35, 0.5))[kind][0]
    right = reference(kind, made, s)
    assert right and spikes_of(kind, made, s) == right
    stronger = adjust((1.0, 1.0, 1.0), (2.0, 2.0, 2.0))[kind][0]
    assert spikes_of(kind, stronger, s) == spikes_of(kind, FITS[kind][0], 2.0 * s)


def counts(**settings):
    """Spikes of each type in 0.4 s of a pressure that vibrates at 160 Hz."""
    line = np.linspace(-4e-3, 4e-3, 5)
    points = np.array([(x, y, z) for z in DEPTHS for x in line for y in line])
    node = Afferents(reach=4e-3, **settings)
    bus = FakeBus(node, rate=RATE)
    total = np.zeros(3, int)
    for t in np.arange(2000) / RATE:
        stress = np.zeros((len(points), 6))
        stress[:, 2] = -1e4 - 250.0 * np.sin(2.0 * np.pi * 160.0 * t)
        spikes = bus.publish(Subsurface(points=points, stress=stress))[0]
        total += np.bincount(node.population.kind[spikes.unit], minlength=3)
    return total, node.population


def test_calibrated_ra1_follow_a_vibration_that_published_ones_filter_out():
    published, before = counts()
    calibrated, after = counts(constants="calibrated")
    assert np.array_equal(before.at, after.at) and np.array_equal(before.kind, after.kind)
    assert calibrated[RA1] > 3 * published[RA1] and calibrated[PC] <= published[PC]
    assert calibrated[SA1] == published[SA1]  # no thresholds of SA1 were recorded
    first = before.fits[before.kind == RA1], after.fits[after.kind == RA1]
    assert first[1][:, 0] == approx(2.0 * first[0][:, 0])  # the same fibre at each place
