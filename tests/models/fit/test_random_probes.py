"""Random sets of sparse probes: a pooled fit gives finite numbers or says why not, and a law at a limit no interval."""

import numpy as np
import pytest

from palpate.models.fit.probes import pooled
from palpate.models.fit.probes.fit import EMPIRICAL, best_law, fit_probes
from palpate.models.fit.probes.pooled import Rows
from palpate.models.fit.probes.read import Probes
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.rigs import Rig, closed_form

BALL = Rig("ball", 4e-3)
DIVERGED = 32  # a set on which the search of the exponential law left the range of numbers


def draw(seed):
    """Probes with 4 to 11 rows each, noise of 0.3 to 10 mN, a rise of 3 to 60 times the noise, shapes of four kinds."""
    rng = np.random.default_rng([79, seed])
    count, noise = rng.integers(10, 80), 10 ** rng.uniform(-3.5, -2)
    kind = rng.choice(["power", "exp", "line", "steep"])
    exponent, hardening = rng.uniform(1, 4), 10 ** rng.uniform(2, 3.7)
    rng.uniform(0.1, 1.2)
    contact = rng.uniform() < 0.5
    depths, forces = [], []
    for _ in range(count):
        depth = np.linspace(0, rng.uniform(1e-3, 5e-3), rng.integers(4, 12)) + rng.uniform(0, 3e-4)
        s = np.maximum(depth + (rng.uniform(0, 1e-3) if contact else -rng.uniform(0, 1e-3)), 0)
        shape = {"power": s**exponent, "exp": np.expm1(np.minimum(hardening * s, 50)), "line": s,
                 "steep": np.maximum(s - 0.8 * s.max(), 0)}[str(kind)]  # fmt: skip
        shape = shape / max(shape.max(), 1e-30)
        rise = noise * np.exp(rng.uniform(np.log(3), np.log(60)))
        forces.append(rise * shape + noise * rng.standard_normal(len(depth)) + rng.normal() * noise * 3)
        depths.append(depth)
    rows = Rows.of(depths, forces)
    return Probes([str(k) for k in range(count)], rows, None, None, [], [])


def draw_like_a_liver(seed):
    """65 probes of an exponential law with noise of 6.5 mN and a rise of 3 to 60 times the noise."""
    rng = np.random.default_rng([5, seed])
    noise, hardening, depths, forces = 6.5e-3, 10 ** rng.uniform(2, 3.7), [], []
    contact = rng.uniform() < 0.5
    for _ in range(65):
        depth = np.linspace(0, rng.uniform(1e-3, 5e-3), rng.integers(4, 12)) + rng.uniform(0, 3e-4)
        s = np.maximum(depth + (rng.uniform(0, 1e-3) if contact else -rng.uniform(0, 1e-3)), 0)
        shape = np.expm1(np.minimum(hardening * s, 50))
        rise = noise * np.exp(rng.uniform(np.log(3), np.log(60))) / max(shape.max(), 1e-30)
        forces.append(rise * shape + noise * rng.standard_normal(len(depth)) + rng.normal() * noise * 3)
        depths.append(depth)
    return Probes([str(k) for k in range(65)], Rows.of(depths, forces), None, None, [], [])


def check(seed, draw=draw):
    probes, failed = draw(seed), 0
    for law in EMPIRICAL:
        try:
            fit = fit_probes(probes, closed_form(BALL, law))
        except SessionError as error:
            assert "range of numbers" in str(error) or "rows per probe" in str(error)
            failed += 1
            continue
        numbers = [*fit.values.values(), *fit.shrunk, *fit.touches, fit.noise, *fit.zero]
        assert np.isfinite(numbers).all() and fit.noise > 0.0
        assert not fit.limited or fit.withheld
    return failed


@pytest.mark.parametrize("seed", [3, 11, 20, 33])
def test_random_probes_give_finite_numbers(seed):
    check(seed)


@pytest.mark.long
def test_many_random_probes_give_finite_numbers():
    assert sum(check(seed) for seed in range(100)) < 20


@pytest.mark.long
@pytest.mark.parametrize("seed", range(10))
def test_random_probes_like_those_of_a_liver_give_finite_numbers(seed):
    assert check(seed, draw_like_a_liver) < 2


def test_places_that_do_not_determine_the_stiffness_have_no_interval():
    """The interval was beyond the range of numbers: `OverflowError: math range error`."""
    fit = fit_probes(draw_like_a_liver(1), closed_form(BALL, "exponential"))
    low, high = fit.intervals["stiffness"]
    assert 0.0 < low < fit.values["stiffness"] < high < np.inf
    assert fit.withheld in (  # which comes first depends on the last digits of touch points, on half of the probes
        "the probes do not determine stiffness: its interval has no end",
        "half of the probes or more have no row before contact, so that touch points, zeros and the constants of the "
        "law exponential are extrapolated; begin probes above the surface",
    )


def test_a_steep_exponential_is_found_from_a_distant_start():
    """The alternation of linearisation and linear fit jumped away: `LinAlgError: Eigenvalues did not converge`."""
    fit = fit_probes(draw(DIVERGED), closed_form(BALL, "exponential"))
    assert np.isfinite([*fit.values.values()]).all()
    fit = fit_probes(steep(), closed_form(BALL, "exponential"))
    assert fit.values["hardening"] == pytest.approx(1500.0, rel=0.05) and not fit.limited


def test_a_law_that_fails_is_left_out_with_a_note(monkeypatch):
    found = pooled._fit

    def fails(rows, law):
        if law.name == "exponential":
            raise np.linalg.LinAlgError("Eigenvalues did not converge")
        return found(rows, law)

    monkeypatch.setattr(pooled, "_fit", fails)
    with pytest.raises(
        SessionError, match="law exponential: its search leaves the range of numbers on these 20 probes"
    ):
        best_law(steep(), BALL, "exponential")
    fit = best_law(steep(), BALL, None)
    assert fit.law.name == "power" and any(note.startswith("left out: law exponential") for note in fit.notes)


def steep():
    """Probes of an exponential that is steeper than the power law can be, 30 times the noise."""
    rng = np.random.default_rng(5)
    depths = [np.linspace(0.0, 4e-3, 12) for _ in range(20)]
    forces = [1e-4 * np.exp(rng.normal(0.0, 0.2)) * np.expm1(1500.0 * np.maximum(d - 2e-4, 0.0))
              + 1e-3 * rng.standard_normal(12) for d in depths]  # fmt: skip
    return Probes([str(k) for k in range(20)], Rows.of(depths, forces), None, None, [], [])


def test_a_law_at_a_limit_has_no_interval_and_another_one_is_taken():
    power = best_law(steep(), BALL, "power")
    assert power.limited and "exponent lies at the limit of its range, 3" in power.withheld
    best = best_law(steep(), BALL, None)
    assert best.law.name == "exponential" and any("law power is not used" in note for note in best.notes)
