"""Messages of tactile quantities other than force: contact area, strain volumes, subsurface stress, spikes; taxels."""

from typing import Annotated

import numpy as np

from palpate.messages.base import NO_FLOATS, Floats, Ints, Message, Vector3
from palpate.messages.tissue import NO_INTS

NO_VECTORS, NO_STRESS = np.zeros((0, 3)), np.zeros((0, 6))
for _empty in (NO_VECTORS, NO_STRESS):
    _empty.setflags(write=False)


class Tactile(Message):
    """Contact area, isostrain volumes and their growth with force.

    area          [m^2]   ()   contact area of the fingertip
    area_rate     [m^2/N] ()   its growth with the normal force
    levels        [1]    (l)  equivalent strains of the isostrain surfaces
    volumes       [m^3]   (l)  volume of the fingerpad strained at least that much
    volume_rates  [m^3/N] (l)  their growth with the normal force
    stick_radius  [m]    ()   radius inside which the contact sticks; the contact radius if nothing slides
    """

    area: Annotated[float, "m^2"] = 0.0
    area_rate: Annotated[float, "m^2/N"] = 0.0
    levels: Annotated[Floats, "1", ("l",)] = NO_FLOATS
    volumes: Annotated[Floats, "m^3", ("l",)] = NO_FLOATS
    volume_rates: Annotated[Floats, "m^3/N", ("l",)] = NO_FLOATS
    stick_radius: Annotated[float, "m"] = 0.0


class Subsurface(Message):
    """Stress below the patch, at points that move with it.

    points         [m]     (k,3)  x and y from the foot point, and depth; z points into the tissue, x starts along the
                                  world's x axis (y axis if the first normal is within 37 degrees of x) and turns
                                  with the normal by the smallest rotation
    stress         [Pa]    (k,6)  xx, yy, zz, yz, xz, xy along these axes; tension is positive
    von_mises      [Pa]    (v)    equivalent stress; v = k, 0 if no node reads it
    energy_density [J/m^3] (w)    strain energy density; w = k, 0 if no node reads it
    deflection     [N/m]   (s,3)  displacement of the surface along these axes times E/(1 - nu^2), above the points of
                                  one depth, in their order; s = number of points of a depth, 0 if no node reads it
    """

    points: Annotated[Floats, "m", ("k", 3)] = NO_VECTORS
    stress: Annotated[Floats, "Pa", ("k", 6)] = NO_STRESS
    von_mises: Annotated[Floats, "Pa", ("v",)] = NO_FLOATS
    energy_density: Annotated[Floats, "J/m^3", ("w",)] = NO_FLOATS
    deflection: Annotated[Floats, "N/m", ("s", 3)] = NO_VECTORS


class Spikes(Message):
    """Spikes of tactile afferents since the message before.

    unit    [1]   (s)  index of the afferent that fired, among those of the sender, which are sorted by type
    moment  [s]   (s)  time of the spike at the receptor, on the graph's clock; conduction along the nerve is left out
    mean    [1/s] (3)  mean rates of all SA1, RA1 and PC afferents, smoothed over the sender's `smoothing`
    rate    [1/s] (n)  smoothed rate of each afferent; empty if no node reads it
    """

    unit: Annotated[Ints, "1", ("s",)] = NO_INTS
    moment: Annotated[Floats, "s", ("s",)] = NO_FLOATS
    mean: Annotated[Vector3, "1/s"] = (0.0, 0.0, 0.0)
    rate: Annotated[Floats, "1/s", ("n",)] = NO_FLOATS


class TaxelForces(Message):
    """What the taxels of a fingertip report.

    positions  [m] (n,2)  of the taxels in the plane of the fingerpad, from its centre
    forces     [N] (n,3)  of each: two shear forces along the axes of the plane, and the normal force
    """

    positions: Annotated[Floats, "m", ("n", 2)] = NO_VECTORS[:, :2]
    forces: Annotated[Floats, "N", ("n", 3)] = NO_VECTORS
