"""Autoregressive models: line spectral frequencies, stable interpolation, and files of models."""

import msgspec
import numpy as np
import pytest
from pytest import approx
from scipy.signal import lfilter

from palpate.nodes.base.texture_file import Model, Texture, read_texture, tabulate_texture
from palpate.physics.texture.autoregressive import coefficients, innovation, line_spectrum, spectrum, yule_walker


def random_model(random, order):
    radius, angle = random.uniform(0.3, 0.97, order // 2), random.uniform(0.1, 3.0, order // 2)
    pairs = radius * np.exp(1j * angle)
    return np.real(np.poly([*pairs, *pairs.conj(), *random.uniform(-0.9, 0.9, order % 2)]))[1:]


def of(lsf):
    a, p, q = np.zeros(len(lsf)), np.zeros(len(lsf) + 2), np.zeros(len(lsf) + 2)
    coefficients(np.asarray(lsf, float), p, q, a)
    return a


@pytest.mark.parametrize("order", [1, 2, 3, 8, 9, 20])
def test_line_spectral_frequencies_survive_a_round_trip(order):
    a = random_model(np.random.default_rng(order), order)
    assert of(line_spectrum(a)) == approx(a, abs=1e-10)


@pytest.mark.parametrize("order", [2, 5, 12])
def test_the_gain_agrees_with_the_impulse_response_and_the_spectrum(order):
    a = random_model(np.random.default_rng(order), order)
    response = lfilter([1.0], np.concatenate([[1.0], a]), np.eye(1, 20_000)[0])
    assert innovation(a, np.zeros(order)) ** -2 == approx(np.sum(response**2), rel=1e-9)
    at = np.linspace(0.0, 500.0, 50_001)
    assert np.trapezoid(spectrum(line_spectrum(a), 0.3, 1000.0, at), at) == approx(0.09, rel=1e-3)


def test_interpolated_models_are_stable_unlike_interpolated_coefficients():
    random, unstable = np.random.default_rng(5), 0
    for _ in range(300):
        first, second = random_model(random, 8), random_model(random, 8)
        share = random.uniform()
        mean = of(share * line_spectrum(first) + (1.0 - share) * line_spectrum(second))
        assert np.abs(np.roots([1.0, *mean])).max() < 1.0
        unstable += np.abs(np.roots([1.0, *(share * first + (1.0 - share) * second)])).max() >= 1.0
    assert unstable > 0


def test_an_unstable_model_has_no_line_spectrum():
    with pytest.raises(ValueError, match="unstable"):
        line_spectrum(np.array([-2.5, 1.2]))


def test_levinson_solves_the_normal_equations():
    from scipy.linalg import solve_toeplitz

    covariance = 0.8 ** np.arange(7) * np.cos(np.arange(7))
    a, residual = yule_walker(covariance)
    assert a == approx(-solve_toeplitz(covariance[:-1], covariance[1:]))
    assert residual[-1] == approx(covariance[0] + a @ covariance[1:])


PENN = """<?xml version="1.0"?><modelSet><material>ours</material><SampleRate>1000</SampleRate><numMod>{n}</numMod>
<numARCoeff>2</numARCoeff><numMACoeff>{ma}</numMACoeff>{models}</modelSet>"""
ONE = """<model><speedMod>{v}</speedMod><forceMod>{f}</forceMod><var>{var}</var>
<ARlsf><value>{a}</value><value>{b}</value></ARlsf></model>"""


def penn(models, ma=0):
    return PENN.format(n=len(models), ma=ma, models="".join(ONE.format(**m) for m in models))


def test_a_model_set_in_the_format_of_the_penn_toolkit_is_read(tmp_path):
    models = [dict(v=v, f=f, var=0.01, a=0.5 + v / 1000, b=1.0 + f) for v in (0, 50, 100) for f in (0.5, 1.0)]
    (tmp_path / "ours.xml").write_text(penn(models))
    found = read_texture(tmp_path / "ours.xml")
    assert found.sampling == 1000 and found.quantity == "acceleration" and len(found.models) == 4
    model = found.models[0]
    assert (model.speed, model.force, model.lsf) == (0.05, 0.5, (0.55, 1.5))
    response = lfilter([1.0], np.concatenate([[1.0], of(model.lsf)]), np.eye(1, 20_000)[0])
    assert model.rms == approx(0.1 * np.sqrt(np.sum(response**2)))
    speeds, forces, table = tabulate_texture(found)
    assert (speeds[0], speeds[-1], forces[0], forces[-1]) == (0.05, 0.1, 0.5, 1.0)
    assert np.all(np.diff(table[..., :-1], axis=2) > 0.0)
    middle = np.argmin(np.abs(speeds - 0.075))
    assert table[middle, 0, 0] == approx(0.5 + speeds[middle]) and table[0, -1, 1] == approx(2.0)


def test_a_model_set_without_a_number_of_moving_averages_has_none(tmp_path):
    text = penn([dict(v=50, f=1, var=0.01, a=1.0, b=2.0)])
    (tmp_path / "ours.xml").write_text(text.replace("<numMACoeff>0</numMACoeff>", ""))
    assert read_texture(tmp_path / "ours.xml").models[0].lsf == (1.0, 2.0)


@pytest.mark.parametrize(
    ("text", "fault_text"),
    [
        (penn([dict(v=50, f=1, var=1, a=2.0, b=1.0)]), "rise between 0 and pi"),
        (penn([dict(v=50, f=1, var=1, a=1.0, b=2.0)], ma=3), "moving-average"),
        (penn([dict(v="x", f=1, var=1, a=1.0, b=2.0)]), "could not convert"),
        (penn([]), "no model"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><modelSet/>', "entities"),
        ("<modelSet>", "not a model set of the Penn Haptic Texture Toolkit"),
        ("{", "truncated"),
        ('{"sampling": -1, "quantity": "force", "models": []}', "sampling"),
        ('{"sampling": 1000, "quantity": "taste", "models": []}', "taste"),
    ],
)
def test_a_bad_file_is_an_error_with_the_reason(tmp_path, text, fault_text):
    (tmp_path / "bad").write_text(text)
    with pytest.raises(ValueError, match=fault_text):
        read_texture(tmp_path / "bad")


@pytest.mark.parametrize(
    "at", [[(0.1, 1.0)], [(0.1, 1.0), (0.2, 1.0)], [(0.1, 1.0), (0.2, 2.0)], [(0.1, 1.0), (0.1, 2.0)]]
)
def test_collinear_models_are_interpolated_along_their_line(at):
    models = tuple(Model(speed=v, force=f, rms=v * f, lsf=(v, 1.0 + f)) for v, f in at)
    texture = msgspec.json.decode(
        msgspec.json.encode(Texture(sampling=1e3, quantity="force", models=models)), type=Texture
    )
    table = tabulate_texture(texture)[2]
    assert np.isfinite(table).all() and table[0, 0, -1] == approx(0.1) and table[-1, -1, 0] == approx(at[-1][0])


@pytest.mark.parametrize("shares", [(0.0, 1.0), (0.3, 0.0, 1.0), (1.0, 0.0, 0.9, 0.1)])
@pytest.mark.parametrize("end", [(0.3, 1.0), (0.1, 3.0), (0.3, 3.0)])
def test_between_models_in_a_row_the_table_is_linear_along_it(end, shares):
    """Models from (0.1 m/s, 1 N) to `end`: places off the row have the values of the nearest place on it, where speed
    and force count as shares of their largest."""
    span = np.array(end) - (0.1, 1.0)
    models = tuple(
        Model(speed=0.1 + s * span[0], force=1.0 + s * span[1], rms=1.0 + s, lsf=(0.5 + s, 2.0 + s)) for s in shares
    )
    speeds, forces, table = tabulate_texture(Texture(sampling=1e3, quantity="force", models=models))
    scaled = span / end
    for i, v in enumerate(speeds):
        for j, f in enumerate(forces):
            s = np.dot((np.array([v, f]) - (0.1, 1.0)) / end, scaled) / np.dot(scaled, scaled)
            assert table[i, j] == approx([0.5 + s, 2.0 + s, 1.0 + s], rel=1e-9)
