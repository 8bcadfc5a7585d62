"""Durations are counted in bins, and the quantiles of the histogram are near those of the durations."""

import numpy as np
import pytest

from palpate.engine.health import Histogram


@pytest.mark.parametrize("scale", [3e2, 5e4, 2e9])
def test_quantiles_of_a_smooth_distribution_are_accurate(scale):
    durations = (scale * np.random.default_rng(1).lognormal(0.0, 0.4, 20000)).astype(int)
    counted = Histogram()
    for duration in durations:
        counted.add(int(duration))
    report = counted.report()
    assert counted.count == len(durations) and report["longest"] == durations.max() * 1e-9
    assert report["mean"] == pytest.approx(durations.mean() * 1e-9)
    for name, q in (("p50", 0.5), ("p99", 0.99), ("p999", 0.999)):
        assert report[name] == pytest.approx(np.quantile(durations, q) * 1e-9, rel=0.02 if name == "p50" else 0.05)


@pytest.mark.parametrize("duration", [0, 1, 7, 8, 15, 16, 17, 1023, 1024, 10**9, 2**47])
def test_a_single_duration_is_in_its_bin(duration):
    counted = Histogram()
    counted.add(duration)
    assert counted.report()["p50"] * 1e9 == pytest.approx(duration, rel=0.13, abs=8.0)
    counted.add(duration, 9)
    assert counted.count == 10 and counted.total == 10 * duration


def test_an_empty_histogram_reports_zeros():
    assert set(Histogram().report().values()) == {0.0}
