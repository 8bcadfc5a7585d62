"""The axes of a study and the quantities that it keeps, as the user writes them."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest
import scipy.stats

import palpate
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.studies.sweeps.axes import Space, axis


def points(*axes, **options):
    space = Space(tuple(axes), **options)
    return [space.point(number)[0] for number in range(len(space))]


def test_axes_are_crossed_and_the_last_changes_first():
    found = points(axis("a.x", [1, 2]), axis("b.y", {"linspace": [0, 1, 3]}))
    assert found == [{"a.x": x, "b.y": y} for x in (1, 2) for y in (0.0, 0.5, 1.0)]


def test_paths_with_a_comma_vary_together():
    found = points(axis("a.x, a.y", [[1, "2 mm"], [3, "4 mm"]]))
    assert found == [{"a.x": 1, "a.y": "2 mm"}, {"a.x": 3, "a.y": "4 mm"}]


def test_points_have_few_digits_independent_of_the_processor():
    space = Space((axis("a.x", {"geomspace": [1, 10, 4]}), axis("a.y", {"norm": [0, 1]})), samples=8)
    for value in [*(v for (v,) in space.crossed[0].values), *space.drawn[:, 0]]:
        assert value == float(f"{value:.10g}")


def test_named_values_are_listed_by_name_in_tables():
    space = Space((axis("scene.hand", {"named": {"press": {"begin": [0, 0, 1]}, "stroke": {"begin": [1, 0, 0]}}}),))
    assert space.point(1) == ({"scene.hand": {"begin": [1, 0, 0]}}, {"scene.hand": "stroke"})


def test_quantities_of_a_grid_are_in_si():
    assert points(axis("a.x", {"geomspace": ["1 kPa", "100 kPa", 3]})) == [
        {"a.x": pytest.approx(value)} for value in (1e3, 1e4, 1e5)
    ]


@pytest.mark.parametrize("design", ["sobol", "lhs", "random"])
def test_samples_have_the_requested_distribution(design):
    given = {"uniform": ["2 mm", "6 mm"]}, {"norm": [5.0, 0.5]}, {"loguniform": [1.0, 100.0]}
    space = Space(tuple(axis(f"a.{k}", one) for k, one in enumerate(given)), samples=1024, design=design, seed=3)
    laws = scipy.stats.uniform(2e-3, 4e-3), scipy.stats.norm(5.0, 0.5), scipy.stats.loguniform(1.0, 100.0)
    for column, law in zip(space.drawn.T, laws, strict=True):
        assert scipy.stats.kstest(column, law.cdf).pvalue > 1e-3
    again = Space(space.axes, samples=1024, design=design, seed=3)
    assert (again.drawn == space.drawn).all()
    assert (Space(space.axes, samples=1024, design=design, seed=4).drawn != space.drawn).any()


def test_a_distribution_of_scipy_is_crossed_with_the_values():
    space = Space((axis("a.x", scipy.stats.norm(0, 1)), axis("b.use", ["p", "q"])), samples=4)
    assert space.shape == (2, 4) and len(space) == 8
    first, second = ([space.point(k + at)[0]["a.x"] for k in range(4)] for at in (0, 4))
    assert first == second and space.point(7)[0]["b.use"] == "q"


def test_the_ends_of_an_unbounded_distribution_are_finite():
    space = Space(tuple(axis(n, scipy.stats.norm(0, 1)) for n in "xy"), samples=4, design="sensitivity morris")
    assert np.isfinite(space.drawn).all() and np.abs(space.drawn).max() == pytest.approx(2.326, abs=1e-3)


@pytest.mark.parametrize(
    ("given", "printed"),
    [
        (3.0, "found 3.0"),
        ([], r"found \[\]"),
        ("1 mm", "found '1 mm'"),
        ([1, 2, 1], "1 stands twice"),
        ({"linspace": [1, 2]}, "expected 3 numbers"),
        ({"linspace": [1, 2, 0]}, "number of values"),
        ({"linspace": [1, 2, 5e6]}, "found 5,000,000 values, expected up to 1,000,000"),
        ({"geomspace": [-1, 2, 3]}, "number of values"),
        ({"linspace": ["1 furlong", 2, 3]}, "expected 3 numbers"),
        ({"linspace": [0, math.inf, 3]}, "expected 3 numbers"),
        ({"normal": [1, 2]}, "scipy.stats"),
        ({"norm": [1, -2]}, "norm cannot be"),
        ({"uniform": [1, 2], "norm": [1, 2]}, "expected a list"),
    ],
)
def test_invalid_values_are_errors(given, printed):
    with pytest.raises(ArgumentError, match=printed) as caught:
        axis("a.x", given)
    assert str(caught.value).startswith("over a.x: ")


GRID = {"ball.young": [1e4, 2e4]}


@pytest.mark.parametrize(
    ("arguments", "printed"),
    [
        ({"over": {}}, "expected what varies"),
        ({"over": {"tissue.yuong": [1, 2]}}, "over tissue.yuong: node 'tissue', setting 'yuong': unknown"),
        ({"over": {"tisue.stiffness": [1, 2]}}, "over tisue.stiffness.*Did you mean 'tissue'"),
        ({"over": {"scene.hand.pathh": [1, 2]}}, "Did you mean 'scene.hand.path'"),
        ({"over": {"hand": [1, 2], "scene.hand": [1, 2]}}, "stands twice"),
        ({"over": {"tissue": [1, 2]}}, "over tissue: expected a setting"),
        ({"over": {"tissue.use": ["deformation.MassSprin"]}}, "deformation.MassSpring"),
        ({"over": {"tissue.use": ["deformation.Rigid"], "tissue.exponent": [1.5]}}, "over tissue.exponent"),
        ({"over": {"tissue.stiffness": {"uniform": ["1 mm", "2 mm"]}}, "samples": 2}, "mm'; expected a plain number"),
        ({"over": {"tissue.stiffness": {"uniform": [1, 2]}}}, "samples: found 0"),
        ({"over": {"tissue.stiffness": [1, 2]}, "samples": 4}, "samples: found 4"),
        ({"over": {"tissue.stiffness": [1, 2]}, "sensitivity": "sobol"}, "no distribution"),
        ({"over": {"tissue.stiffness": {"uniform": [1, 2]}}, "samples": 4, "sensitivity": "sobl"}, "sobol or morris"),
        ({"keep": []}, "keep: found"),
        ({"keep": "peak contact.force"}, "keep: found"),
        ({"keep": ["contact.force"]}, "keep: found 'contact.force'"),
        ({"keep": ["peak contakt.force"]}, "Did you mean 'contact'"),
        ({"keep": ["peak contact.forze"]}, "Did you mean 'force'"),
        ({"keep": ["peak controller.state"]}, "no number"),
        ({"keep": ["at 9 mm contact.force"]}, "a length; expected a time"),
        ({"limit": "5 mm"}, "limit: found '5 mm'"),
        ({"duration": -1.0}, "duration: found -1.0"),
        ({"graph": "falcon", "duration": 1.0}, "drives a device"),
    ],
    ids=lambda given: str(given)[:40],
)
def test_an_invalid_study_is_an_error_before_anything_runs(arguments, printed):
    with pytest.raises(PalpateError) as caught:
        palpate.Study(**{"graph": "kidney", "over": {"tissue.stiffness": [2e3, 3e3]}} | arguments)
    assert re.search(printed, str(caught.value).replace("\n", " ")), caught.value


def test_ten_million_points_are_counted_without_being_built(tmp_path):
    over = {f"tissue.{name}": {"linspace": [1, 2, 216]} for name in ("stiffness", "damping", "exponent")}
    study = palpate.Study("kidney", over)
    with pytest.raises(ArgumentError, match=r"10,077,696 points, 216 x 216 x 216; .* 116\.6 days .* --yes"):
        study.run(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_describing_a_study_imports_no_slow_package():
    code = "import sys, palpate; palpate.Study('kidney', {'tissue.stiffness': [1e3, 2e3]}).points; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pandas", "pyarrow", "zarr", "xarray", "SALib", "matplotlib"}.intersection(loaded)


def test_a_part_of_the_scene_can_be_varied_without_a_scene_in_the_graph():
    assert palpate.Study("kidney", {"hand": {"named": {"slow": {"path": [{"hold": 1}]}}}}).space.paths == ["scene.hand"]
