"""Fits of force models: recovery of what the data were made of, and honest errors."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx
from scipy.optimize import curve_fit as scipy_curve_fit

from palpate.models.fit.curve_fit import FitError, fit_curve
from palpate.models.fit.fit import DEPTHS
from palpate.physics.contact.force_models import MODELS

KNOWN = {
    "linear": [512.3, -0.21],
    "quadratic": [4.1e4, 310.0, -0.03],
    "fourier": [1.694, -1.673, 0.1971, 422.8],
    "gaussian": [2.83, 6.17e-3, 3.41e-3],
    "exponential": [0.02272, 376.6],
}


@pytest.mark.parametrize("name", MODELS)
def test_noise_free_data_recover_every_coefficient(name):
    model = MODELS[name]
    fit = fit_curve(model, DEPTHS, model(DEPTHS, KNOWN[name]))
    assert fit.parameters == approx(KNOWN[name], rel=1e-6)
    assert fit.rmse < 1e-9 and not fit.at_limit


@given(
    st.floats(0.3, 4), st.floats(-3, -0.3), st.floats(-1, 1), st.floats(200, 1100),
)  # fmt: skip
def test_fourier_coefficients_are_recovered_for_any_period(a0, a1, b1, omega):
    model = MODELS["fourier"]
    fit = fit_curve(model, DEPTHS, model(DEPTHS, [a0, a1, b1, omega]))
    assert fit.parameters == approx([a0, a1, b1, omega], rel=1e-6, abs=1e-6)


@given(st.floats(1e-3, 1.0), st.floats(-900, 900))
def test_exponential_coefficients_are_recovered(a, b):
    model = MODELS["exponential"]
    y = model(DEPTHS, [a, b])
    if np.ptp(y) > 1e-6 * a:
        assert fit_curve(model, DEPTHS, y).parameters == approx([a, b], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("name", MODELS)
def test_the_slopes_are_those_of_the_curve(name):
    model, p = MODELS[name], np.array(KNOWN[name], float)
    x = DEPTHS + 1e-4
    jacobian = model.jacobian(x, p)
    for k in range(len(p)):
        step = np.zeros_like(p)
        step[k] = 1e-6 * abs(p[k])
        slope = (model.predict(x, p + step) - model.predict(x, p - step)) / (2 * step[k])
        assert jacobian[:, k] == approx(slope, rel=1e-6, abs=1e-9 * np.abs(slope).max())


@pytest.mark.parametrize("name", ["linear", "quadratic", "fourier", "exponential"])
def test_another_solver_finds_the_same_minimum_and_the_same_errors(name):
    model = MODELS[name]
    y = model(DEPTHS, KNOWN[name]) + 0.02 * np.random.default_rng(3).standard_normal(11)
    fit = fit_curve(model, DEPTHS, y)
    best, covariance = scipy_curve_fit(lambda d, *p: model(d, p), DEPTHS, y, fit.parameters * 1.001, maxfev=20000)
    assert fit.parameters == approx(best, rel=1e-4)
    assert fit.errors == approx(np.sqrt(np.diag(covariance)), rel=1e-2)
    p = len(model.parameters)
    assert fit.rmse == approx(np.sqrt(np.sum((y - fit(DEPTHS)) ** 2) / (11 - p)))


def test_intervals_have_about_their_nominal_coverage():
    """18 sessions whose forces err together and more so with depth."""
    random = np.random.default_rng(5)
    x, labels = np.tile(DEPTHS, 18), np.repeat(np.arange(18), 11)
    for name in ("quadratic", "linear"):
        model, truth, hits, plain = MODELS[name], KNOWN[name], 0, 0
        for _ in range(300):
            noise = (random.standard_normal((18, 1)) + random.standard_normal((18, 11))) * (0.01 + 15 * DEPTHS)
            y = model(x, truth) + noise.ravel()
            low, high = fit_curve(model, x, y, labels).interval()[0]
            hits += low < truth[0] < high
            low, high = fit_curve(model, x, y).interval()[0]
            plain += low < truth[0] < high
        assert 0.90 < hits / 300 < 0.985
    assert plain / 300 < 0.85  # rows taken as independent promise too much


def test_the_undetermined_period_of_a_straight_line_is_reported():
    fit = fit_curve(MODELS["fourier"], DEPTHS, 100 * DEPTHS)
    assert fit.at_limit == ("omega",)


def test_parameters_that_the_data_do_not_determine_have_no_finite_error():
    """Where the force is zero everywhere, a exp(b d) has a = 0 with any b."""
    fit = fit_curve(MODELS["exponential"], DEPTHS, np.zeros(11), constant=True)
    assert fit.parameters[0] == 0.0 and np.isinf(fit.errors).all()


@pytest.mark.parametrize(
    ("x", "y", "text"),
    [
        (DEPTHS[:4], DEPTHS[:4], "found 4 rows, expected at least 5 for 4 parameters"),
        (DEPTHS, np.full(11, 0.3), "one constant value of the force"),
        (np.zeros(11), DEPTHS, "one constant value of the depth"),
        (DEPTHS, np.where(DEPTHS > 4e-3, np.nan, DEPTHS), "not finite"),
    ],
)
def test_data_that_cannot_be_fitted_are_refused(x, y, text):
    with pytest.raises(FitError, match=text):
        fit_curve(MODELS["fourier"], x, y)


def test_one_session_gives_no_errors():
    with pytest.raises(FitError, match="found one session"):
        fit_curve(MODELS["linear"], DEPTHS, DEPTHS**2, np.zeros(11))


@pytest.mark.parametrize("model", [*MODELS.values()], ids=lambda m: m.formula)
@pytest.mark.parametrize(
    "y",
    [
        np.eye(11)[0], np.eye(11)[10], (DEPTHS > 2e-3) * 1.0, np.exp(-2000 * DEPTHS), 1e-12 * DEPTHS,
        1e4 * DEPTHS[::-1], 1 + 1e-15 * (DEPTHS > 2e-3),
    ],
)  # fmt: skip
def test_data_of_another_shape_give_finite_parameters(model, y):
    fit = fit_curve(model, DEPTHS, y)
    assert np.isfinite(fit.parameters).all() and np.isfinite(fit.rmse) and np.all(fit.errors >= 0)
