"""Cattaneo-Mindlin presliding of a sphere on a plane: displacement against tangential force."""

import numpy as np


def presliding(force, normal_force, friction, radius, shear_modulus, poisson):
    """Tangential approach [m] of two bodies under constant normal force, before gross slip.

        s = 3 (2 - nu) mu F_n / (16 G a) [1 - (1 - Phi)^(2/3)],      Phi = F_t / (mu F_n)

    force          [N]   (...)  F_t, 0 <= F_t <= mu F_n (a larger force has no static answer)
    normal_force   [N]   ()     F_n > 0     friction [1] ()  mu > 0
    radius         [m]   ()     a of the contact (not of the fingertip)
    shear_modulus  [Pa]  ()     G           poisson  [1] ()  nu

    ValueError: a force outside 0 <= F_t <= mu F_n.

    K. L. Johnson, Contact Mechanics, 1985, section 7.2. It is eq. 6 of the beam bundle paper, where the radius is
    printed as that of the fingertip.
    """
    load = np.asarray(force, float) / (friction * normal_force)
    if np.any(load < 0) or np.any(load > 1 + 1e-12):
        raise ValueError(f"force: expected 0 ... mu F_n = {friction * normal_force} N, found {force!r}")
    scale = 3 * (2 - poisson) * friction * normal_force / (16 * shear_modulus * radius)
    return scale * (1 - np.maximum(1 - load, 0.0) ** (2 / 3))


def stick_radius(force, normal_force, friction, radius):
    """Radius of the circle that still sticks [m]: a (1 - Phi)^(1/3). Arguments as `presliding`."""
    load = np.asarray(force, float) / (friction * normal_force)
    return radius * np.cbrt(np.clip(1 - load, 0.0, 1.0))


def presliding_stiffness(radius, shear_modulus, poisson):
    """Initial tangential stiffness [N/m]: 8 G a / (2 - nu)."""
    return 8 * shear_modulus * radius / (2 - poisson)
