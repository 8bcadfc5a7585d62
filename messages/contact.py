"""Messages of the contact between fingertip and tissue, and between organs, in the world frame; of a wrench sensor."""

from typing import Annotated, Self

import msgspec
import numpy as np

from palpate.messages.base import NO_FLOATS, Floats, Ints, Message, Sparse, Vector, Vector2, Vector3, always_sent
from palpate.messages.fields import Bound

UNIT_VECTOR = Bound(1.001, "a unit vector")
COMPLIANCE = Bound(1e3, "a body of 1 mN/m")
SIDES = "first", "second"  # the bodies of an `OrganContact`
MOST_CONTACTS = 16  # of organs that are solved together
NO_TORQUES = np.zeros((0, 3))
NO_TORQUES.setflags(write=False)


class Proximity(Sparse):
    """The nearest point of the undeformed surface, and the finger's distance from it.

    foot         [m]   (3)  nearest point of the surface
    normal       [1]   (3)  outward unit normal there
    coordinates  [1]   (2)  surface coordinates of the foot point: (u, v) of a patch, barycentric of a triangle
    element      [1]   ()   index of the patch or triangle that contains it
    gap          [m]   ()   signed distance of the bone edge, positive outside
    approach     [m]   ()   tissue thickness minus gap, 0 when apart
    separation   [m]   ()   gap minus tissue thickness: distance from first touch, 0 in contact
    slip         [m/s] (3)  velocity of the finger along the surface
    share        [1]   (h)  where several organs are under the finger, h = 1: the part of the patch that is on this one;
                            else h = 0, and it is omitted on the wire
    """

    foot: Annotated[Vector3, "m"]
    normal: Annotated[Vector3, "1", UNIT_VECTOR]
    coordinates: Annotated[Vector2, "1"]
    element: Annotated[int, "1"]
    gap: Annotated[float, "m"]
    approach: Annotated[float, "m"]
    slip: Annotated[Vector3, "m/s"]
    separation: Annotated[float, "m"] = always_sent(0.0)
    share: Annotated[Floats, "1", ("h",)] = NO_FLOATS


class Contact(Sparse):
    """The contact force in equilibrium, and the shares of fingertip and tissue in the approach.

    foot              [m]   (3)  point of the undeformed surface
    normal            [1]   (3)  outward unit normal there
    force             [N]   ()   magnitude of the normal force, never negative
    compression       [m]   ()   of the fingertip, s1
    indentation       [m]   ()   of the tissue, s2
    compression_rate  [m/s] ()   change of s1 over the step
    indentation_rate  [m/s] ()   change of s2 over the step
    lateral_force     [N]   (3)  on the finger along the surface, towards where the body is softer; not friction
    stored            [J]   (e)  energy stored in the fingertip; e = 1, 0 if no node reads it
    whole             [N]   (h)  where several organs are under the finger, h = 1: the force that all of the patch would
                                 have if it were on this organ; the other fields are those of its share. Else h = 0, and
                                 it is omitted on the wire
    generated         [J]   (g)  energy that the body has generated since the start, as far as this finger got it, where
                                 several fingers are solved for and no other body touches it: g = 1. Else g = 0, and
                                 omitted
    """

    foot: Annotated[Vector3, "m"]
    normal: Annotated[Vector3, "1", UNIT_VECTOR]
    force: Annotated[float, "N"]
    compression: Annotated[float, "m"]
    indentation: Annotated[float, "m"]
    compression_rate: Annotated[float, "m/s"]
    indentation_rate: Annotated[float, "m/s"]
    lateral_force: Annotated[Vector3, "N"] = always_sent((0.0, 0.0, 0.0))
    stored: Annotated[Vector, "J", ("e",)] = always_sent(())
    whole: Annotated[Floats, "N", ("h",)] = NO_FLOATS
    generated: Annotated[Floats, "J", ("g",)] = NO_FLOATS


class Contacts(Message):
    """Contacts of several fingertips with one body, solved together; `contact.Share` extracts the Contact of each.

    force             [N]   (c)   magnitude of each normal force, never negative
    compression       [m]   (c)   of each fingertip, s1
    indentation       [m]   (c)   of the tissue under each, s2
    compression_rate  [m/s] (c)   change of s1 over the step
    indentation_rate  [m/s] (c)   change of s2 over the step
    lateral_force     [N]   (c,3) on each finger along the surface, towards where the body is softer; not friction
    stored            [J]   (e)   energy stored in each fingertip; e = c, 0 if no node reads it
    generated         [J]   (g)   energy that the body has generated since the start, as far as each finger got it; g =
                                  c, 0 where other bodies touch it
    """

    force: Annotated[Vector, "N", ("c",)]
    compression: Annotated[Vector, "m", ("c",)]
    indentation: Annotated[Vector, "m", ("c",)]
    compression_rate: Annotated[Vector, "m/s", ("c",)]
    indentation_rate: Annotated[Vector, "m/s", ("c",)]
    lateral_force: Annotated[Floats, "N", ("c", 3)]
    stored: Annotated[Vector, "J", ("e",)] = ()
    generated: Annotated[Vector, "J", ("g",)] = ()


class Friction(Message):
    """Tangential force of the finger on the tissue, along the sliding velocity of the finger.

    force    [N] (3)  tangential to the surface
    bristle  [m] (3)  mean bristle deflection
    stick    [1] ()   true while the contact does not slide
    stored   [J] (e)  energy stored in the bristles; e = 1, 0 if the law does not report it or no node reads it
    """

    force: Annotated[Vector3, "N"]
    bristle: Annotated[Vector3, "m"]
    stick: Annotated[bool, "1"]
    stored: Annotated[Vector, "J", ("e",)] = ()


class Load(Sparse):
    """Nodal forces on a deformable body; their sum is the contact force.

    nodes   [1] (k)    indices of the loaded surface vertices
    forces  [N] (k,3)  force on each; the normal part points into the body
    foot    [m] (3)    centre of the loaded zone on the undeformed surface
    normal  [1] (3)    outward unit normal there
    whole   [N] (h)    as in the `Contact` that is spread
    """

    nodes: Annotated[Ints, "1", ("k",)]
    forces: Annotated[Floats, "N", ("k", 3)]
    foot: Annotated[Vector3, "m"]
    normal: Annotated[Vector3, "1", UNIT_VECTOR]
    whole: Annotated[Floats, "N", ("h",)] = NO_FLOATS

    @classmethod
    def example(cls, loaded: bool) -> Self:
        """All forces press into the body."""
        made = super().example(loaded)
        return msgspec.structs.replace(made, forces=-np.abs(made.forces))


class OrganContact(Sparse):
    """The contact of two bodies: its force, patch and gap, and the nodal forces on both.

    force          [N]   ()    sum of the normal forces of all candidates, never negative
    resultant      [N]   (3)   vector sum of the forces on the first body; the second gets the opposite
    foot           [m]   (3)   centre of the forces on the first body's undeformed surface; the last one without force
    across         [m]   (3)   the same on the second body
    normal         [1]   (3)   mean normal out of the second body there, in the frame of the first
    area           [m^2] ()    of contact
    gap            [m]   ()    smallest gap of the candidates, at most their reach; negative where an overlap is left
                               for the next step
    friction       [N]   (3)   sum of the friction forces on the first body, in its frame; the second gets the opposite
    slip           [m/s] (3)   velocity of the first body's surface against the second's in the patch, in the same frame
    left           [1]   ()    number of candidates that are left for the next step
    stored         [J]   ()    energy stored in the bristles of the friction
    dissipated     [J]   ()    energy dissipated by contact and friction since the start
    generated      [J]   ()    energy generated since the start, by overlaps that were left
    first_yields   [m/N] (f,f) by how much the contact lifts the patch of each finger on the first body per newton of
                               each finger
    second_yields  [m/N] (g,g) the same on the second body
    first_pressing [N]   (f)   normal force of each finger for which this is valid
    second_pressing [N]  (g)   the same on the second body
    first_nodes    [1]   (k)   indices of the loaded vertices of the first body's surface
    first_forces   [N]   (k,3) force on each
    second_nodes   [1]   (l)   the same of the second body
    second_forces  [N]   (l,3) force on each
    carried        [J]   (c)   work of moving foundations on the bodies through this contact since the start; c = 1,
                               0 if none moves, and then omitted on the wire
    torques        [N m] (t,3) moments on both bodies about their centres, where one rotates with its foundation: t = 2;
                               else t = 0, and omitted. `resultant` is then in the world, the other vectors in the
                               frames of the bodies
    across_normal  [1]   (n)   `normal` in the frame of the second body, where one rotates with its foundation: n = 3;
                               else n = 0, it is the same, and omitted
    steps          [1]   ()    number of steps since the start, which a restart of the contact sets back with the
                               energies; 0 in older recordings
    """

    force: Annotated[float, "N"]
    resultant: Annotated[Vector3, "N"]
    foot: Annotated[Vector3, "m"]
    across: Annotated[Vector3, "m"]
    normal: Annotated[Vector3, "1", UNIT_VECTOR]
    area: Annotated[float, "m^2"]
    gap: Annotated[float, "m"]
    friction: Annotated[Vector3, "N"]
    slip: Annotated[Vector3, "m/s"]
    left: Annotated[int, "1"]
    stored: Annotated[float, "J"]
    dissipated: Annotated[float, "J"]
    generated: Annotated[float, "J"]
    first_yields: Annotated[Floats, "m/N", ("f", "f"), COMPLIANCE]
    second_yields: Annotated[Floats, "m/N", ("g", "g"), COMPLIANCE]
    first_pressing: Annotated[Vector, "N", ("f",)]
    second_pressing: Annotated[Vector, "N", ("g",)]
    first_nodes: Annotated[Ints, "1", ("k",)]
    first_forces: Annotated[Floats, "N", ("k", 3)]
    second_nodes: Annotated[Ints, "1", ("l",)]
    second_forces: Annotated[Floats, "N", ("l", 3)]
    carried: Annotated[Floats, "J", ("c",)] = NO_FLOATS
    torques: Annotated[Floats, "N m", ("t", 3)] = NO_TORQUES
    across_normal: Annotated[Floats, "1", ("n",), UNIT_VECTOR] = NO_FLOATS
    steps: Annotated[int, "1"] = always_sent(0)


class Neighbour(Message):
    """What the fingers on a body feel of a second body that touches it.

    force     [N]   ()    sum of the normal forces of the second body on the first
    yields    [m/N] (f,f) by how much the second body lifts the patch of each finger per newton that the force of each
                          finger increases
    pressing  [N]   (f)   normal forces of the fingers for which this is valid
    """

    force: Annotated[float, "N"]
    yields: Annotated[Floats, "m/N", ("f", "f"), COMPLIANCE]
    pressing: Annotated[Vector, "N", ("f",)]


class Wrench(Message):
    """What a six-axis force-torque sensor reports of the load on its tool side, in the frame of the sensor.

    force      [N]   (3)  force
    torque     [N m] (3)  torque about the sensor's origin
    saturated  [1]   ()   true if an axis is at the end of its range
    """

    force: Annotated[Vector3, "N"]
    torque: Annotated[Vector3, "N m"]
    saturated: Annotated[bool, "1"] = False
