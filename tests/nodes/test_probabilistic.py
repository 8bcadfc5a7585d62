"""The probabilistic force: the published table, the law truncated at zero, reproducible draws, the node."""

import numpy as np
import pytest
from pytest import approx
from scipy.special import ndtr
from scipy.stats import kstest, truncnorm

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, pack
from palpate.nodes.base import SettingError
from palpate.nodes.contact.probabilistic import Probabilistic
from palpate.physics.contact.force_band import band_at, truncated_quantile, uniform

MEAN = [0.02100, 0.24919, 0.73183, 1.38392, 2.09062, 2.72747]
DEVIATION = [0.02272, 0.03311, 0.04825, 0.07032, 0.10248, 0.14934]


def touch(compression, indentation=0.0, tick=-1):
    return Contact(
        foot=(0, 0, 0), normal=(0, 0, 1), force=1.0, compression=compression, indentation=indentation,
        compression_rate=0.0, indentation_rate=0.0, tick=tick,
    )  # fmt: skip


def bands(node, *contacts):
    return FakeBus(node).publish(*contacts)


def test_the_law_equals_the_published_table():
    mean, deviation, inside = band_at(np.arange(6) * 1e-3)
    assert mean == approx(MEAN, abs=6e-6) and deviation == approx(DEVIATION, abs=6e-6) and inside.all()


def test_the_mean_grows_over_the_measured_range():
    mean, deviation, _ = band_at(np.linspace(0, 5e-3, 500))
    assert np.all(np.diff(mean) > 0) and np.all(np.diff(deviation) > 0)


def test_beyond_the_measured_range_the_law_is_constant_and_flagged():
    mean, deviation, inside = band_at([-1e-3, 5e-3, 5.001e-3, 1.0])
    assert mean[1] == mean[2] == mean[3] and deviation[1] == deviation[3]
    assert inside.tolist() == [False, True, False, False]


@pytest.mark.parametrize(("mean", "sigma"), [(0.021, 0.02272), (1.384, 0.0703), (-0.1, 0.05), (0.0, 1.0)])
def test_quantiles_are_those_of_the_law_truncated_at_zero(mean, sigma):
    levels = np.array([1e-6, 0.025, 0.18, 0.5, 0.975, 1 - 1e-9])
    other = truncnorm(-mean / sigma, np.inf, mean, sigma)
    assert truncated_quantile(levels, mean, sigma) == approx(other.ppf(levels), rel=1e-6, abs=1e-12)


def test_quantiles_are_finite_for_any_negative_mean():
    quantiles = truncated_quantile([0.025, 0.5, 0.975], -5.0, np.array([[1.0], [1e-3], [1e-9]]))
    assert np.isfinite(quantiles).all() and np.all(quantiles >= 0) and np.all(np.diff(quantiles, axis=1) >= 0)
    assert truncated_quantile(0.5, [-1.0, 0.3], 0.0).tolist() == [0.0, 0.3]


def test_at_zero_depth_18_percent_of_the_law_is_below_zero():
    (mean, deviation, _) = band_at([0.0, 0.5e-3])

    assert ndtr(-mean / deviation) == approx([0.18, 1.4e-4], rel=0.03)


def test_the_node_sends_mean_deviation_and_quantiles():
    answers = bands(Probabilistic(levels=(0.16, 0.5, 0.84)), *(touch(d * 1e-3) for d in range(1, 6)))
    assert [a.mean for a in answers] == approx(MEAN[1:], abs=6e-6)
    assert [a.deviation for a in answers] == approx(DEVIATION[1:], abs=6e-6)
    for a in answers:
        assert a.levels == (0.16, 0.5, 0.84) and a.valid and a.sample == 0
        assert a.quantiles == approx([a.mean - 0.99446 * a.deviation, a.mean, a.mean + 0.99446 * a.deviation], rel=1e-5)


def test_out_of_contact_all_is_zero_and_too_deep_is_flagged():
    apart, deep, deepest = bands(Probabilistic(draw="tick"), touch(0.0), touch(7e-3), touch(5e-3))
    assert (apart.mean, apart.deviation, apart.sample, apart.valid) == (0, 0, 0, True)
    assert apart.quantiles == (0, 0, 0)
    assert not deep.valid and deepest.valid and deep.mean == deepest.mean


def test_the_setting_depth_chooses_finger_or_tissue():
    (finger,) = bands(Probabilistic(), touch(1e-3, 3e-3))
    (tissue,) = bands(Probabilistic(depth="indentation"), touch(1e-3, 3e-3))
    assert finger.mean == approx(MEAN[1], abs=6e-6) and tissue.mean == approx(MEAN[3], abs=6e-6)


@pytest.mark.parametrize("depth", [0.05e-3, 2e-3])
def test_draws_follow_the_law_truncated_at_zero(depth):
    node = Probabilistic(draw="tick", seed=5)
    node.start()
    draws = np.array([node.step(touch(depth, tick=t), dt=1e-3).sample for t in range(4000)])
    mean, sigma, _ = band_at(depth)
    assert draws.min() >= 0
    assert kstest(draws, truncnorm(-mean / sigma, np.inf, mean, sigma).cdf).pvalue > 1e-3
    assert abs(np.corrcoef(draws[1:], draws[:-1])[0, 1]) < 0.05
    if depth > 1e-3:
        assert np.mean(np.abs(draws - mean) < 1.96 * sigma) == approx(0.95, abs=0.012)


def test_the_same_seed_gives_the_same_bytes_singly_and_in_sequence():
    contacts = [touch(2e-3, tick=t) for t in range(30)]
    first = bands(Probabilistic(draw="tick", seed=9), *contacts)
    again = bands(Probabilistic(draw="tick", seed=9), *contacts)
    assert [pack(a) for a in first] == [pack(a) for a in again]
    for contact, answer in zip(contacts, first, strict=True):  # singly, without the previous ones
        assert bands(Probabilistic(draw="tick", seed=9), contact)[0].sample == answer.sample
    other = bands(Probabilistic(draw="tick", seed=10), *contacts)
    assert all(a.sample != b.sample for a, b in zip(first, other, strict=True))


def test_a_session_keeps_its_rank():
    answers = bands(Probabilistic(draw="session", seed=4), *(touch(d * 1e-4) for d in range(10, 50)))
    z = [(a.sample - a.mean) / a.deviation for a in answers]
    assert z == approx([z[0]] * len(z), abs=1e-6) and abs(z[0]) > 1e-3


def test_uniform_numbers_fill_the_unit_interval():
    numbers = np.array([uniform(1, t) for t in range(3000)])
    assert numbers.min() >= 0 and numbers.max() < 1 and kstest(numbers, "uniform").pvalue > 1e-3


def test_a_fitted_law_below_zero_is_limited_to_zero():
    node = Probabilistic(
        mean="linear", mean_parameters=(500.0, -0.4), deviation="linear", deviation_parameters=(20.0, -0.01)
    )
    shallow, deep = bands(node, touch(0.2e-3), touch(2e-3))
    assert (shallow.mean, shallow.deviation, shallow.quantiles) == (0, 0, (0, 0, 0))
    assert deep.mean == approx(0.6) and deep.deviation == approx(0.03)


LAW = """subjects:
  "1":
    mean: quadratic
    mean_parameters: [4.0e+4, 300.0, 0.0]
    deviation: linear
    deviation_parameters: [20.0, 0.01]
    depth_limit: 0.004
"""


def test_a_file_of_laws_becomes_settings(tmp_path):
    path = tmp_path / "law.yaml"
    path.write_text(LAW)
    node = Probabilistic(model=str(path))
    path.unlink()  # the node's law is stored in its settings, not in the file
    assert (node.model, node.mean, node.depth_limit) == ("", "quadratic", 0.004)
    inside, outside = bands(node, touch(2e-3), touch(4.1e-3))
    assert inside.mean == approx(0.76) and inside.valid and not outside.valid


@pytest.mark.parametrize(
    ("text", "subject", "error"),
    [
        (LAW, "2", "'subject' .1.: found '2', expected one of those of .*: 1"),
        ("{", "", "not a YAML file"),
        ("a: 1", "", "has no 'subjects'"),
        ("subjects: {a: {mean: linear}}", "", "subject 'a' of .*: expected mean, mean_parameters"),
        (LAW.replace("quadratic", "cubic"), "", "'mean' .1.: found 'cubic', expected one of linear"),
        (LAW.replace("300.0, 0.0", "300.0"), "", "expected 3 finite numbers for 'quadratic': k1 .N/m.2., k2"),
        (LAW.replace("0.004", "-1.0"), "", "'depth_limit' .m.: found -1.0"),
    ],
)
def test_a_wrong_file_is_an_error_with_the_reason(tmp_path, text, subject, error):
    path = tmp_path / "law.yaml"
    path.write_text(text)
    with pytest.raises(SettingError, match=error):
        Probabilistic(model=str(path), subject=subject)


def test_a_missing_file_and_wrong_levels_are_errors():
    with pytest.raises(SettingError, match=r"cannot read 'nix\.yaml': No such file"):
        Probabilistic(model="nix.yaml")
    for levels in ((0.0, 0.5), (0.5, 1.0), tuple([0.5] * 17)):
        with pytest.raises(SettingError, match="'levels'"):
            Probabilistic(levels=levels)
