"""Messages of the contact of two bodies, world frame."""

from typing import Annotated

from palpate.messages.base import Floats, Ints, Message, Vector2, Vector3
from palpate.messages.contact import UNIT_VECTOR


class OrganContact(Message):
    """The contact of two bodies: its force, patch and gap, and the nodal forces on both.

    force          [N]   ()    sum of the normal forces of all candidates, never negative
    resultant      [N]   (3)   vector sum of the forces on the first body; the second gets the opposite
    foot           [m]   (3)   centre of the forces on the first body's undeformed surface; the last one without force
    across         [m]   (3)   the same on the second body
    normal         [1]   (3)   mean normal out of the second body there
    area           [m^2] ()    of the candidates that touch
    gap            [m]   ()    smallest gap of the candidates, at most their reach; negative where an overlap is left for the next step
    left           [1]   ()    number of candidates that are left for the next step
    dissipated     [J]   ()    energy dissipated by the contact since the start
    generated      [J]   ()    energy generated since the start, by overlaps that were left
    yields         [m/N] (2)   by how much the contact lifts the patch of the first load on each body per newton of it
    pressing       [N]   (2)   normal force of these loads
    first_nodes    [1]   (k)   indices of the loaded vertices of the first body's surface
    first_forces   [N]   (k,3) force on each
    second_nodes   [1]   (l)   the same of the second body
    second_forces  [N]   (l,3)
    """

    force: Annotated[float, "N"]
    resultant: Annotated[Vector3, "N"]
    foot: Annotated[Vector3, "m"]
    across: Annotated[Vector3, "m"]
    normal: Annotated[Vector3, "1", UNIT_VECTOR]
    area: Annotated[float, "m^2"]
    gap: Annotated[float, "m"]
    left: Annotated[int, "1"]
    dissipated: Annotated[float, "J"]
    generated: Annotated[float, "J"]
    yields: Annotated[Vector2, "m/N"]
    pressing: Annotated[Vector2, "N"]
    first_nodes: Annotated[Ints, "1", ("k",)]
    first_forces: Annotated[Floats, "N", ("k", 3)]
    second_nodes: Annotated[Ints, "1", ("l",)]
    second_forces: Annotated[Floats, "N", ("l", 3)]


class Neighbour(Message):
    """What a finger on a body feels of a second body that touches it.

    force     [N]   ()  sum of the normal forces of the second body on the first
    yields    [m/N] ()  by how much the second body lifts the patch of the finger per newton that its force increases
    pressing  [N]   ()  normal force of the finger for which this is valid
    """

    force: Annotated[float, "N"]
    yields: Annotated[float, "m/N"]
    pressing: Annotated[float, "N"]
