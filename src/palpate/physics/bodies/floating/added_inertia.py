"""Inertia that a step adds to an organ while fingers press it, so that the contacts may answer one step later.

A contact of the stiffness G and the damping B on a mass m behaves over steps of T as one of G + B/T. Let x be the
displacement, and the force in a step that of the displacement before it: (m + a)(x+ - 2 x + x-)/T² = -G x - B (x -
x-)/T. By the criterion of Jury it is stable if T² G + 2 T B < 4 (m + a). With the levers l [m] of the contacts

    a = T² sum (G + B/T) [kg],    a_r = T² sum (G + B/T) l² [kg m²]

are in this range for every mass and inertia, since G |v + w x l|² <= 2 G (|v|² + l² |w|²). They are of first order in
T, change no force at constant velocity, and vanish without contact. While the organ is pressed they do not fall; where
they rise, `kept` lowers the velocity so that the kinetic energy with them does not rise.

E. I. Jury, Theory and Application of the z-Transform Method (Wiley 1964). P. Causin, J. F. Gerbeau, F. Nobile, Comput.
Methods Appl. Mech. Eng. 194 (2005) 4506-4527: added mass in staggered couplings.
"""

from palpate.compiler.kernel import kernel
from palpate.physics.arrays import Array
from palpate.physics.contact.series import elastic
from palpate.physics.contact.terminal import terminal_force


@kernel
def contact_stiffness(
    force: float, compression: float, indentation: float, tip: Array, stick: Array, law: Array, dt: float
):
    """G + B/T [N/m] of one contact, the larger of its values along and across the normal.

    force [N], compression, indentation [m]  of the contact
    tip (5)    law and damping of the fingertip, see `contact.series.kernel_form`
    stick (4)  spring [N/m] and damper [N s/m] of its friction without load, then their rise per newton
    law (5)    terminal law of the body: K, n, c, s_free, s_prev
    """
    if not force > 0.0:
        return 0.0
    g, slope = elastic(compression, int(tip[0]), tip[1], tip[2], tip[3])
    along = slope * max(force / g, 1.0) + g * tip[4] / dt if g > 0.0 else 0.0
    _, body = terminal_force(indentation, dt, law[0], law[1], law[2], law[3], law[4])
    if body > 0.0 and along > 0.0:
        along = along / (1.0 + along / body)
    else:
        along = max(along, body)
    return max(along, stick[0] + force * stick[2] + (stick[1] + force * stick[3]) / dt)


@kernel
def added_inertia(before: float, stiffness: float, dt: float):
    """a [kg] or a_r [kg m²] for contacts of G + B/T [N/m, or N m/rad] in all; 0 without contact. `before`: that of the
    last step."""
    return max(before, dt * dt * stiffness) if stiffness > 0.0 else 0.0


@kernel
def kept(inertia: float, before: float, added: float):
    """Share [1] of a velocity that is kept where the added inertia rises."""
    return (inertia + min(before, added)) / (inertia + added)
