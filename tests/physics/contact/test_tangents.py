"""Derivatives of the laws, against differences of them."""

import numpy as np
import pytest

from palpate.physics.contact.series import ElasticLaw, elastic, exponential, hertz_exponential, power
from palpate.physics.contact.terminal import Terminal, free_recovery, indentation, terminal_force
from palpate.physics.sensitivity.series import finger_partials, pressed, recovered, terminal_partials

T = 1e-3


def by_differences(function, at, step=1e-6):
    """Central differences of a function of some numbers, by each of them; of a number that is 0 by the step itself."""
    out = []
    for i, value in enumerate(at):
        h = step * (abs(value) or 1.0)
        up, down = list(at), list(at)
        up[i], down[i] = value + h, value - h
        out.append((function(*up) - function(*down)) / (2.0 * h))
    return np.array(out)


@pytest.mark.parametrize(
    "law", [power(8e3, 1.5), power(8e3, 1.0), exponential(26.3, 1681.0), hertz_exponential(5.7e6, 467.0, 9.8e-3)]
)
def test_a_fingertips_law_is_differentiated_by_its_numbers(law):
    for s in (1e-6, 1e-3, 4e-3):
        expected = by_differences(lambda *numbers, s=s: elastic(s, law.kind, *numbers)[0], law[1:])
        assert finger_partials(law, s) == pytest.approx(expected, rel=1e-7, abs=1e-14)
    assert not finger_partials(law, 0.0).any()
    assert not finger_partials(ElasticLaw(*law), -1e-3).any()


@pytest.mark.parametrize("law", [Terminal(3e3, 1.5, 5.0, 0.0, 1e-3), Terminal(400.0, 1.0, 0.0, -2e-4, 0.0)])
def test_a_terminal_law_is_differentiated_by_its_numbers(law):
    for s in (1.01e-3, 1.4e-3, 3e-3):
        expected = by_differences(lambda *numbers, s=s: terminal_force(s, T, *numbers)[0], law, 1e-7)
        assert terminal_partials(s, T, law) == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert not terminal_partials(-1e-2, T, law).any()


def test_indentation_and_free_recovery_follow_force_and_law():
    law, force = Terminal(3e3, 1.5, 5.0, 1e-4, 1e-3), 0.4
    s = indentation(force, T, *law)
    dlaw, dforce = np.eye(5, 6), np.eye(6)[5]
    expected = by_differences(lambda *n: indentation(n[5], T, *n[:5]), [*law, force], 1e-7)
    assert pressed(s, T, law, dlaw, dforce) == pytest.approx(expected, rel=1e-5, abs=1e-12)
    for kept in (law, law._replace(damping=0.5), law._replace(damping=0.0)):
        expected = by_differences(lambda *n: free_recovery(n[4], n[3], n[2], T), kept, 1e-7)
        if kept.damping > 0.0:
            assert recovered(T, kept, np.eye(5)) == pytest.approx(expected, rel=1e-5, abs=1e-12)
        else:
            assert recovered(T, kept, np.eye(5)).tolist() == [0.0, 0.0, 0.0, 1.0, 0.0]
