"""Sensitivity indices of Ishigami's function and of Hertz's law, compared with their closed forms."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from nodes_for_studies import Ball, Ishigami

import palpate
from palpate.physics.errors import ArgumentError
from palpate.studies.sweeps.axes import Space, axis
from palpate.studies.sweeps.sensitivity import cube, indices
from palpate.studies.sweeps.task import PointTask

BALL = """
nodes:
  ball: {use: nodes_for_studies.Ball}
wanted: [ball]
run: {duration: 5 ms}
"""
RANGES = {"young": (5e3, 20e3), "radius": (4e-3, 16e-3), "depth": (1e-3, 2e-3)}
KINDS = ("S1", "ST")
POWERS = {"young": 1.0, "radius": 0.5, "depth": 1.5}


def space(ranges, method, samples):
    axes = tuple(axis(f"ball.{name}", {"uniform": list(ends)}) for name, ends in ranges.items())
    return Space(axes, samples, f"sensitivity {method}", seed=5)


def last(node, **settings):
    """The last message of a node of one step or more."""
    made = node(**settings)
    made.start()
    return [made.step(dt=1e-3) for _ in range(getattr(made, "steps", 1))][-1]


def test_sobol_indices_of_ishigami():
    """S1 0.3139, 0.4424, 0; ST 0.5576, 0.4424, 0.2437 (A. Saltelli et al., Global Sensitivity Analysis (2008) 196)."""
    drawn = space({f"x{k}": (-math.pi, math.pi) for k in (1, 2, 3)}, "sobol", 2048)
    values = np.array([last(Ishigami, x1=a, x2=b, x3=c).indentation_rate for a, b, c in drawn.drawn])
    found = indices("sobol", ["x1", "x2", "x3"], drawn.cube, values, seed=1)
    for one, first, total in zip(found, (0.3139, 0.4424, 0.0), (0.5576, 0.4424, 0.2437), strict=True):
        assert abs(one["S1"] - first) <= 1.5 * one["S1_conf"] and one["S1_conf"] < 0.1
        assert abs(one["ST"] - total) <= 1.5 * one["ST_conf"] and one["ST_conf"] < 0.1


def moment(ends, power):
    """Mean of x^p over a uniform range."""
    low, high = ends
    return (high ** (power + 1.0) - low ** (power + 1.0)) / ((power + 1.0) * (high - low))


def test_sobol_indices_of_hertz():
    """F is a product of powers of independent parameters. With v = var(x^p)/mean(x^p)^2 of each, the total variance is
    prod(1 + v) - 1, that of one parameter v, and with all its interactions v times the (1 + v) of the others."""
    drawn = space(RANGES, "sobol", 1024)
    values = np.array([last(Ball, **dict(zip(RANGES, row, strict=True))).force for row in drawn.drawn])
    found = indices("sobol", list(RANGES), drawn.cube, values, seed=1)
    spread = {n: moment(RANGES[n], 2 * p) / moment(RANGES[n], p) ** 2 - 1.0 for n, p in POWERS.items()}
    whole = math.prod(1.0 + v for v in spread.values()) - 1.0
    for (name, v), one in zip(spread.items(), found, strict=True):
        others = math.prod(1.0 + w for n, w in spread.items() if n != name)
        assert abs(one["S1"] - v / whole) <= 1.5 * one["S1_conf"] < 0.15, name
        assert abs(one["ST"] - v * others / whole) <= 1.5 * one["ST_conf"] < 0.15, name


def test_morris_of_a_linear_law_has_the_slopes_and_no_spread():
    drawn = space({"a": (0.0, 1.0), "b": (0.0, 1.0)}, "morris", 8)
    found = indices("morris", ["a", "b"], drawn.cube, 3.0 * drawn.drawn[:, 0] - 2.0 * drawn.drawn[:, 1], seed=1)
    assert [one["mu"] for one in found] == pytest.approx([3.0, -2.0])
    assert [one["mu_star"] for one in found] == pytest.approx([3.0, 2.0])
    assert [one["sigma"] for one in found] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_the_intervals_narrow_with_the_samples():
    widths = []
    for samples in (64, 1024):
        drawn = space(RANGES, "sobol", samples)
        values = drawn.drawn[:, 0] * drawn.drawn[:, 2]
        widths.append(indices("sobol", list(RANGES), drawn.cube, values, seed=1)[0]["ST_conf"])
    assert widths[1] < 0.5 * widths[0]


@pytest.mark.parametrize("samples", [16, 64])
def test_the_intervals_have_their_nominal_coverage(samples):
    """For a linear law, whose indices are the fractions of the squares: 95 %, or less from resampling few samples."""
    weights = np.array([1.57, 0.07, 0.43, 0.23, 0.76, 1.0, 0.5, 0.3, 1.2, 0.9, 0.1, 0.6])
    names = [f"x{k}" for k in range(len(weights))]
    shares, inside = weights**2 / (weights**2).sum(), []
    for seed in range(20):
        points = cube("sobol", len(weights), samples, seed)
        found = indices("sobol", names, points, points @ weights, seed)
        inside.append([[abs(o[k] - s) <= o[f"{k}_conf"] for o, s in zip(found, shares, strict=True)] for k in KINDS])
    held = np.mean(inside, axis=0)
    assert 0.9 <= held.mean() <= 0.99 and held.min() >= 0.7, held


def test_equal_seeds_give_equal_indices_also_seed_zero():
    for method in ("sobol", "morris"):
        points = [cube(method, 3, 64, seed) for seed in (0, 0, 1)]
        assert (points[0] == points[1]).all() and (points[0] != points[2]).any()
        found = [indices(method, "abc", points[0], points[0][:, 0] ** 2, seed=0) for _ in range(2)]
        assert found[0] == found[1]


def test_a_constant_result_has_zero_indices():
    drawn = space(RANGES, "sobol", 64)
    found = indices("sobol", list(RANGES), drawn.cube, np.full(len(drawn), 2.0), seed=1)
    assert all(value == 0.0 for one in found for value in one.values())


@pytest.mark.long
def test_a_study_finds_the_exponents_of_hertz(write, tmp_path):
    """Over a range of 1 % the effects of Morris are force times exponent times 1 %, for any other axes."""
    ranges = {"young": (1e4, 1.01e4), "radius": (8e-3, 8.08e-3), "depth": (1e-3, 1.01e-3)}
    over = {f"ball.{name}": {"uniform": list(ends)} for name, ends in ranges.items()} | {"ball.poisson": [0.3, 0.5]}
    graph = write("ball.yaml", BALL)
    study = palpate.Study(graph, over, ["peak ball.force"], samples=2, sensitivity="morris")
    assert len(study) == 2 * 2 * 4
    from palpate.studies.sweeps.store import Store

    store = Store(tmp_path / "out")  # one after another, in this process
    done = dict(PointTask(study.launch, study.keep).compute(study.points))
    store.add(study.base, [(point, done[place]) for place, point in enumerate(study.points)])
    store.flush()
    store.close()
    study.folder = tmp_path / "out"
    table = study.indices()
    force = 4.0 / 3.0 * 1e4 * math.sqrt(8e-3) * 1e-3**1.5
    for _, row in table.iterrows():
        scale = force / (1.0 - row["ball.poisson"] ** 2) * 0.01
        name = row["parameter"].removeprefix("ball.")
        assert row["mu_star"] / scale == pytest.approx(POWERS[name], rel=0.02)
    (axes,) = study.plot("peak ball.force").axes
    assert axes.get_yticklabels()[0].get_text() == "0.3, ball.young"
    assert len(table) == 6


def test_failed_points_leave_no_indices(write, tmp_path):
    graph = write("ball.yaml", BALL)
    over = {"ball.young": {"uniform": [1e4, 2e4]}, "ball.depth": {"uniform": [1e-3, 2e-3]}}
    study = palpate.Study(graph, over, ["peak ball.force"], samples=2, sensitivity="morris")
    study.folder = tmp_path
    with pytest.raises(ArgumentError, match="indices: 6 of 6 points have no result, the first: not computed"):
        study.indices()
    plain = palpate.Study(graph, over, ["peak ball.force"], samples=2)
    with pytest.raises(ArgumentError, match="no `sensitivity`"):
        plain.indices()


@pytest.mark.parametrize(
    ("samples", "method", "names", "printed"),
    [
        (1, "sobol", 2, "two of each or more"),
        (1, "morris", 2, "two of each or more"),
        (64, "sobol", 1, "two of each or more"),
    ],
)
def test_invalid_numbers_of_samples_are_errors(samples, method, names, printed):
    with pytest.raises(ArgumentError, match=printed):
        len(space({f"x{k}": (0, 1) for k in range(names)}, method, samples))


def test_no_bar_is_longer_than_the_total_variance():
    """Sobol's estimates from few samples may lie outside of 0 to 1; their intervals are drawn where they are."""
    pandas, figures = pytest.importorskip("pandas"), pytest.importorskip("matplotlib.figure")
    from palpate.studies.sweeps.picture import _shares

    table = {"of": ["force"] * 2, "parameter": ["young", "depth"], "S1": [1.41, -0.2], "S1_conf": [0.6, 0.3],
             "ST": [1.2, 0.4], "ST_conf": [0.4, 0.2]}  # fmt: skip
    study = SimpleNamespace(
        sensitivity="sobol", indices=lambda: pandas.DataFrame(table), space=SimpleNamespace(paths=())
    )
    axes = figures.Figure().add_subplot()
    _shares(study, SimpleNamespace(text="force", unit="N"), axes)
    assert [bar.get_width() for bar in axes.patches] == [1.0, 0.0, 1.0, 0.4]
    assert axes.get_xlim() == (0.0, 1.05) and "share of the variance" in axes.get_xlabel()
    ends = axes.collections[0].get_segments()
    assert [segment[:, 0].tolist() for segment in ends] == [pytest.approx([0.81, 2.01]), pytest.approx([-0.5, 0.1])]
