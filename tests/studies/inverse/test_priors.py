"""Priors of `palpate fit run`: they are the interval without data, and have no effect next to strong data."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import palpate
from palpate.cli.__main__ import app
from palpate.gradients.parameters import find_parameter
from palpate.physics.errors import ArgumentError
from palpate.studies.inverse.fit import fit_run
from palpate.studies.inverse.measured import read_recording
from palpate.studies.inverse.priors import read_priors

PRESS = [{"hold": 0.05}, {"to": [0, 0, 0.0975], "time": 0.3}, {"hold": 1}]
KNOWN = ["tissue.stiffness=180", "tissue.retardation=0.035"]


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """A press of 0.4 s."""
    path = tmp_path_factory.mktemp("prior") / "press.mcap"
    sets = [*KNOWN, "scene.hand.begin=[0, 0, 0.112]", f"scene.hand.path={json.dumps(PRESS)}"]
    palpate.run("kidney", record=path, duration=0.4, sets=sets)
    return path


@pytest.fixture
def measured(file):
    """Its contact force, which does not depend on friction, with noise of 5 mN."""
    found = read_recording(file, ["contact.force"], "kidney", None, KNOWN, None)
    rng = np.random.default_rng(0)
    found.values = [values + 5e-3 * rng.standard_normal(values.shape) for values in found.values]
    return found


def ends(fit, name):
    at = fit.estimate.intervals[name]
    return at.low, at.high


@pytest.mark.parametrize(
    ("form", "expected"),
    [
        ("normal:0.5,0.05", (0.5 - 1.96 * 0.05, 0.5 + 1.96 * 0.05)),
        ("lognormal:0.5,1.2", (0.5 / 1.2**1.96, 0.5 * 1.2**1.96)),
    ],
)
def test_without_data_the_interval_is_that_of_the_prior(measured, form, expected):
    free = ["tissue.stiffness", "friction.mu_slide"]
    fit = fit_run([measured], free, starts=1, priors=[f"friction.mu_slide={form}"])
    assert not fit.open_
    assert ends(fit, "friction.mu_slide") == pytest.approx(expected, rel=0.01)
    assert fit.estimate.values["friction.mu_slide"] == pytest.approx(0.5, rel=1e-4)
    assert any("friction.mu_slide: the interval is that of its prior" in note for note in fit.notes)
    plain = fit_run([measured], free, starts=1)
    low, high = ends(plain, "tissue.stiffness")
    assert ends(fit, "tissue.stiffness") == pytest.approx((low, high), abs=0.01 * (high - low))


def test_strong_data_leave_a_prior_without_effect(measured):
    plain = fit_run([measured], ["tissue.stiffness"], starts=1)
    for form in ("normal:250,100", "lognormal:250,2"):
        fit = fit_run([measured], ["tissue.stiffness"], starts=1, priors=[f"tissue.stiffness={form}"])
        width = np.subtract(*ends(plain, "tissue.stiffness"))
        assert ends(fit, "tissue.stiffness") == pytest.approx(ends(plain, "tissue.stiffness"), abs=0.01 * abs(width))


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_a_prior_and_data_of_equal_weight_average(measured, rho):
    """Two normal distributions of the same width: the mean of both, and the width over the root of 2; with correlated
    noise the data count less."""
    rng = np.random.default_rng(5)
    white = rng.standard_normal(measured.values[0].shape)
    for i in range(1, len(white)):
        white[i] = rho * white[i - 1] + np.sqrt(1.0 - rho**2) * white[i]
    measured.values = [measured.values[0] + 0.02 * white]
    plain = fit_run([measured], ["tissue.stiffness"], starts=1)
    value, size = plain.estimate.values["tissue.stiffness"], float(plain.estimate.errors[0])
    prior = f"tissue.stiffness=lognormal:{float(value * np.exp(size))!r},{float(np.exp(size))!r}"
    fit = fit_run([measured], ["tissue.stiffness"], starts=1, priors=[prior])
    assert fit.estimate.values["tissue.stiffness"] == pytest.approx(value * np.exp(size / 2.0), rel=0.1 * size)
    assert float(fit.estimate.errors[0]) == pytest.approx(size / np.sqrt(2.0), rel=0.05)


def test_a_tissue_is_a_prior_with_its_published_spread(measured):
    """prostate-human-cancer: 24.1 kPa, standard deviation 14.5 kPa."""
    graph = measured.launch.load()
    parameter = find_parameter(graph, "tissue.stiffness", graph.nodes)
    prior = read_priors(["tissue.stiffness=prostate-human-cancer"], [parameter], graph)["tissue.stiffness"]
    mean = prior.middle * np.exp(prior.spread**2 / 2.0)
    assert mean == pytest.approx(345.937, rel=1e-6)  # `palpate list tissues prostate-human-cancer`
    assert mean * np.sqrt(np.exp(prior.spread**2) - 1.0) == pytest.approx(345.937 * 14.5 / 24.1, rel=1e-6)


@pytest.mark.parametrize(
    ("prior", "text"),
    [
        ("friction.mu_slide=normal:1,1", "expected one of the free parameters: tissue.stiffness"),
        ("tissue.stiffness", "expected normal:MEAN,DEVIATION"),
        ("tissue.stiffness=normal:200", "expected normal:MEAN,DEVIATION"),
        ("tissue.stiffness=uniform:1,2", "expected normal:MEAN,DEVIATION"),
        ("tissue.stiffness=normal:200,0", "expected a positive deviation"),
        ("tissue.stiffness=normal:nan,1", "expected finite numbers"),
        ("tissue.stiffness=lognormal:200,0.9", "a factor above 1"),
        ("tissue.stiffness=lognormal:200,a", "could not convert"),
        ("tissue.stiffness=normal:1e9,1", "within the range of the search"),
        ("tissue.stiffness=liver", "Did you mean 'liver-human'"),
        ("tissue.stiffness=normal:200,9 --prior tissue.stiffness=normal:200,9", "has a prior already"),
        ("tissue.stiffness=silicone-EF10-0", "no published standard deviation"),
    ],
)
def test_a_wrong_prior_is_refused_in_one_line(measured, prior, text):
    with pytest.raises(ArgumentError) as error:
        fit_run([measured], ["tissue.stiffness"], starts=1, priors=prior.split(" --prior "))
    assert text in str(error.value)
    assert "\n" not in str(error.value)


def test_the_command_takes_priors(file, tmp_path):
    free = ["--free", "tissue.stiffness", "--free", "friction.mu_slide"]
    command = ["fit", "run", str(file), "--graph", "kidney", *free, "--starts", "1", "-o", str(tmp_path), "--json"]
    done = CliRunner().invoke(app, [*command, "--prior", "friction.mu_slide=normal:0.5,0.05"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)["parameters"]["friction.mu_slide"]
    assert found["determined"] is True
    assert (found["low"], found["high"]) == pytest.approx((0.402, 0.598), rel=0.01)
    done = CliRunner().invoke(app, [*command, "--force", "--prior", "friction.mu_slide=flat"])
    assert done.exit_code == 2
    assert "no tissue 'flat'" in done.output
    assert "Traceback" not in done.output
