"""Contact mechanics compared with closed forms and published series that no other test uses."""

import math

import numpy as np
import pytest
from pytest import approx
from scipy.special import dawsn

from palpate.physics.contact import layer, subsurface
from palpate.physics.contact.series import elastic, series_energy
from palpate.physics.friction.lugre import LuGre, lugre
from palpate.physics.materials.prony import relax_response

NU = 0.3


def over_plane(depth, weight):
    """Integral of a component of `point_stress` over the plane at this depth [m]: (components, force) -> number."""
    turns = 2 * np.pi * np.arange(24) / 24
    q, w = np.polynomial.legendre.leggauss(200)
    angle = 0.25 * np.pi * (q + 1.0)  # r = z tan(angle) maps the plane to [0, pi/2)
    r, dr = depth * np.tan(angle), 0.25 * np.pi * w * depth / np.cos(angle) ** 2
    at = np.stack(np.broadcast_arrays(r[:, None] * np.cos(turns), r[:, None] * np.sin(turns), depth), axis=-1)
    stress = subsurface.point_stress(at, NU) * weight(at)[..., None, None, None]
    return np.einsum("r,rtijk->ijk", r * dr, stress) * 2 * np.pi / len(turns)


def test_every_plane_below_a_point_load_carries_the_whole_force():
    """Equilibrium of the half-space above a plane (Boussinesq 1885, Cerruti 1882): the traction sums to the load,
    normal and tangential, for any Poisson's ratio."""
    for depth in (1e-3, 7e-3):
        carried = over_plane(depth, lambda at: np.ones(at.shape[:-1]))[2]
        assert carried == approx(-np.eye(3), abs=1e-6)


def test_a_plane_below_a_tangential_load_carries_its_moment():
    """A force along x at the surface causes a moment below: that of sigma_zz about y is the force times z."""
    depth = 4e-3
    q, w = np.polynomial.legendre.leggauss(800)
    turns = 2 * np.pi * np.arange(24) / 24
    angle = 0.25 * np.pi * (q + 1.0)
    r, dr = depth * np.tan(angle), 0.25 * np.pi * w * depth / np.cos(angle) ** 2
    x = r[:, None] * np.cos(turns)
    at = np.stack(np.broadcast_arrays(x, r[:, None] * np.sin(turns), depth), axis=-1)
    moment = np.einsum("r,rt->", r * dr, x * subsurface.point_stress(at, NU)[..., 2, 2, 0]) * 2 * np.pi / len(turns)
    assert moment == approx(-depth, rel=2e-3)


def test_a_row_of_point_loads_equals_flamants_line_load():
    """sigma_zz = -2 z³/(pi r⁴), sigma_xz = -2 x z²/(pi r⁴), sigma_xx = -2 x² z/(pi r⁴) and, in plane strain, sigma_yy =
    nu (sigma_xx + sigma_zz), for a force of 1 N/m (A. Flamant 1892; Johnson, Contact Mechanics, eq. 2.23)."""
    x, z = 2e-3, 3e-3
    q, w = np.polynomial.legendre.leggauss(400)
    angle, r2 = 0.5 * np.pi * q, x * x + z * z
    y, dy = math.sqrt(r2) * np.tan(angle), 0.5 * np.pi * w * math.sqrt(r2) / np.cos(angle) ** 2
    found = np.einsum("n,nij->ij", dy, subsurface.point_stress(np.stack(np.broadcast_arrays(x, y, z), -1), NU)[..., 2])
    scale = -2.0 / (math.pi * r2 * r2)
    assert found[2, 2] == approx(scale * z**3, rel=1e-6)
    assert found[0, 2] == approx(scale * x * z * z, rel=1e-6)
    assert found[0, 0] == approx(scale * x * x * z, rel=1e-5)
    assert found[1, 1] == approx(NU * (found[0, 0] + found[2, 2]), rel=1e-5)


@pytest.mark.parametrize("depth", [0.3, 1.0, 2.5])
def test_stress_below_a_uniform_pressure_on_a_disc_has_its_closed_form(depth):
    """sigma_zz = -p (1 - z³/s³), sigma_rr = -p ((1 + 2 nu)/2 - (1 + nu) z/s + z³/(2 s³)), s² = a² + z² (A. E. H. Love
    1929; Johnson, eq. 3.33)."""
    q, w = np.polynomial.legendre.leggauss(60)
    turns = 2 * np.pi * np.arange(24) / 24
    r, dr = 0.5 * (q + 1.0), 0.5 * w
    at = np.stack(np.broadcast_arrays(-r[:, None] * np.cos(turns), -r[:, None] * np.sin(turns), depth), axis=-1)
    found = np.einsum("r,rtij->ij", r * dr, subsurface.point_stress(at, NU)[..., 2]) * 2 * np.pi / len(turns)
    z, s = depth, math.hypot(1.0, depth)
    assert found[2, 2] == approx(-(1.0 - (z / s) ** 3), rel=1e-8)
    assert found[0, 0] == approx(-(0.5 + NU - (1 + NU) * z / s + 0.5 * (z / s) ** 3), rel=1e-6)


@pytest.mark.parametrize("depth", [0.1, 0.5, 1.0, 3.0])
def test_stress_on_the_axis_of_the_shipped_kernel_has_its_closed_form(depth):
    """Boussinesq's 3 P z³/(2 pi rho⁵) over the pressure 3/pi (1 - r²)², integrated in closed form."""
    found = subsurface.under_patch(np.array([[0.0, 0.0, depth]]), 1.0, "biweight", NU)[0, 2, 2, 2]
    c = 1.0 + depth**2

    def below(u):
        return -2.0 / 3.0 * c * c * u**-1.5 + 4.0 * c * u**-0.5 + 2.0 * u**0.5

    assert found == approx(-4.5 / math.pi * depth**3 * (below(c) - below(depth**2)), rel=1e-5)


def test_a_ball_on_a_thin_incompressible_layer_follows_a_published_series():
    """f = 1 + 1.133 chi + 1.497 chi² + 1.469 chi³ + 0.755 chi⁴, nu = 0.5, bonded (P. D. Garcia, R. Garcia, Biophys. J.
    114, 2018, 2923-2932, from a reciprocal theorem and not an integral equation)."""
    factor = layer.thickness_factor(0.5)
    for chi in (0.05, 0.1, 0.2, 0.3):
        series = 1.0 + 1.133 * chi + 1.497 * chi**2 + 1.469 * chi**3 + 0.755 * chi**4
        assert float(factor(chi)) == approx(series, rel=5e-3)


def test_a_ball_on_a_thin_sheet_approaches_the_elastic_foundation():
    """A compressible sheet much thinner than the contact: F = pi E_o R s²/h, E_o = E (1 - nu)/((1 + nu)(1 - 2 nu)), so
    f = (3 pi/4) sqrt(chi) (1 - nu)²/(1 - 2 nu) (Johnson, section 5.8); the border is wider by part of the thickness."""
    nu, ratios = 0.2, []
    for wide in (2.0, 4.0, 8.0):
        chi, f = layer.solve_layer(wide, nu)
        ratios.append(f / (0.75 * math.pi * chi * (1.0 - nu) ** 2 / (1.0 - 2.0 * nu)))
    away = np.abs(np.array(ratios) - 1.0)
    assert away[2] < 0.15 and (away[1:] < 0.65 * away[:-1]).all()


def test_a_ball_at_constant_speed_in_a_viscoelastic_half_space_has_its_closed_form():
    """E. H. Lee, J. R. M. Radok, J. Appl. Mech. 27 (1960) 438-444: while contact grows F(t) = K int E(t - t') d(s^1.5).
    For s = v t and one time T: int e^-(t-t')/T sqrt(t') dt' = T sqrt(t) - T^1.5 D(sqrt(t/T)), D of Dawson."""
    share, relaxation = 0.6, 0.2
    time = np.linspace(0.0, 1.0, 4001)
    found = relax_response([share], [relaxation], time, time**1.5)
    lasting = relaxation * np.sqrt(time) - relaxation**1.5 * dawsn(np.sqrt(time / relaxation))
    assert found == approx((1.0 - share) * time**1.5 + share * 1.5 * lasting, abs=2e-5)


@pytest.mark.parametrize("turns", [0.1, 1.0, 10.0])
def test_a_standard_linear_solid_has_its_storage_and_loss_moduli(turns):
    """E' = 1 - g + g w²T²/(1 + w²T²), E'' = g w T/(1 + w²T²) (J. D. Ferry, Viscoelastic Properties of Polymers)."""
    share, relaxation = 0.6, 0.1
    w = turns / relaxation
    period = 2 * np.pi / w
    cycles = 3 + int(8 * relaxation / period)
    time = np.linspace(0.0, cycles * period, 2000 * cycles + 1)
    late = slice(-2001, -1)
    found = relax_response([share], [relaxation], time, np.sin(w * time))[late]
    x2 = turns * turns
    assert 2.0 * np.mean(found * np.sin(w * time[late])) == approx(1 - share + share * x2 / (1 + x2), abs=1e-3)
    assert 2.0 * np.mean(found * np.cos(w * time[late])) == approx(share * turns / (1 + x2), abs=1e-3)


def test_a_ball_that_hits_a_half_space_has_hertzs_contact_time():
    """2.9432 times the deepest indentation over the speed (H. Hertz 1881; Johnson, eq. 11.24), with the deepest from
    m v²/2 = 2/5 K s^2.5."""
    mass, speed, k = 5e-3, 0.4, 3e3
    deepest = (1.25 * mass * speed**2 / k) ** 0.4
    assert series_energy(deepest, 0, k, 1.5, 0.0) == approx(0.5 * mass * speed**2, rel=1e-12)
    s, v, t, dt = 0.0, speed, 0.0, 2e-7
    while True:
        v -= 0.5 * dt * elastic(s, 0, k, 1.5, 0.0)[0] / mass
        ahead = s + dt * v
        if ahead < 0.0:
            break
        v -= 0.5 * dt * elastic(ahead, 0, k, 1.5, 0.0)[0] / mass
        s, t = ahead, t + dt
    assert t + s / speed == approx(2.9432 * deepest / speed, rel=1e-4)


def test_bristles_without_a_stribeck_dip_reverse_like_dahl_friction():
    """After full sliding and a distance d back: f = -mu + 2 mu e^(-sigma d/mu), at any speed (P. R. Dahl 1968)."""
    mu, sigma = 0.5, 3000.0
    law = LuGre(mu, mu, 0.02, sigma, 0.0, 0.0, update=0)  # as in a node's record: the exponential update
    z = (mu / sigma, 0.0, 0.0)
    for step, dt in ((1e-5, 1e-3), (3e-5, 1e-2), (1e-6, 1e-4)):
        z, way = (mu / sigma, 0.0, 0.0), 0.0
        for _ in range(20):
            z, force, _ = lugre(law, z, (-step / dt, 0.0, 0.0), 1.0, dt, step)
            way += step
            assert force[0] == approx(-mu + 2.0 * mu * math.exp(-sigma * way / mu), abs=1e-12)
