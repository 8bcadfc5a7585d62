"""Spreading of the contact force over the surface (docs/equations/spread.md)."""

import math
from typing import Annotated, Literal

import numpy as np

from palpate.compiler.fields import form
from palpate.compiler.records import floats, lend, lend_first, put, unpacking, vector
from palpate.messages import Contact, Friction, Load
from palpate.nodes.base import ARRAY, Agrees, CompiledNode, Out, SettingError, Wants
from palpate.nodes.base.absence import FADE, FADED, begin, fade_value
from palpate.nodes.base.area import WithArea
from palpate.nodes.base.felt import WithWidth, bearing
from palpate.nodes.base.kernels import ieee_kernel
from palpate.nodes.base.kernels import kernel as compiled
from palpate.nodes.base.samples import sample_of
from palpate.physics.contact.area import radius_at
from palpate.physics.contact.spread import TABLES, Spreader, spread, spreader

RIGID = 5e4
"""[N/m] Force over compression above which a finger counts as rigid; that of a fingertip at 10 N is about 3e3."""

COARSEST = 0.25
"""[1] Spacing of a thinned surface over the patch radius above which the force error reaches 1 %."""

ROUGHEST = 2.0  # [1] friction over normal force, above which friction belongs to another contact force
COARSE_TRIANGLES = 0.5  # [1] Spacing of the vertices over the patch radius above which a note is printed

_spreader_of = unpacking(Spreader)


@compiled
def within(force, limit):
    """A force [N] (3) of at most this length [N]."""
    length = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    scale = limit / length if length > limit else 1.0
    return scale * force[0], scale * force[1], scale * force[2]


class Kernel(CompiledNode, WithArea, WithWidth):
    """Distributes the contact force over the vertices around the foot point with a smooth kernel.

    The force on the body is -f_n n + f_t, the sum of the nodal forces. Without force the load has no nodes. When the
    sender of friction disappears, friction fades out within 20 ms. Friction of another time than the contact force, as
    behind a network, is limited to twice that force: a body has no law for a tangential force without a normal one.
    The width of the patch is independent of the depth, which is wrong for a rigid tip and is then reported. With an
    `area` law the radius follows the force, and the pressure is that of Hertz.
    """

    kernel: Annotated[Literal["biweight", "wendland", "cosine", "hertz"], "1", Agrees(Load)] = "biweight"

    State = {
        "spreader": form(Spreader), "friction": FADED,
        "idles": bool, "foot": (3,), "normal": (3,),  # whether the last step had no force, and its foot and normal
        "law_forces": ARRAY, "law_radii": ARRAY,  # of the area law; empty: fixed
        "whole": ARRAY,  # of the message that is sent
        "rigid": bool, "gives": (2,), "cautioned": bool,  # compression and indentation [m] at the first rigid contact
    }  # fmt: skip
    conditions = {"rigid": "outside its range"}

    shared = tuple(f"spreader.{name}" for name in TABLES)

    def start(self) -> None:
        super().start()
        mesh = self.mesh()
        law = self.area_law()
        grows = len(law.forces) > 0
        self.hold("law_forces", law.forces)
        self.hold("law_radii", law.radii)
        spacing, extent = float(np.sqrt(np.median(mesh.areas))), 0.5 * float(np.sort(np.ptp(mesh.vertices, axis=0))[1])
        if grows and not spacing < law.radii[-1] < extent:
            raise SettingError(
                f"setting 'area': its law reaches a radius of {1e3 * law.radii[-1]:.2g} mm, expected one between "
                f"{1e3 * spacing:.2g} mm, the spacing of the vertices, and {1e3 * extent:.2g} mm, half of the surface"
            )
        kernel = "hertz" if grows else self.kernel
        self.hold("spreader", spreader(mesh, self.radius, kernel, bearing(self, self.width)))
        if not grows and self.spacing > COARSEST * self.radius and mesh is not self.whole():
            self._notes.append(
                f"Kernel: the surface is thinned to {1e3 * self.spacing:.2g} mm, which is coarse for a patch of "
                f"{1e3 * self.radius:.2g} mm; set scene.surface.spacing to {125 * self.radius:.2g} mm"
            )
        wide = float(law.radii[-1]) if grows else self.radius
        if spacing > COARSE_TRIANGLES * wide:
            self._notes.append(
                f"Kernel: the vertices are {1e3 * spacing:.2g} mm apart, the patch is {1e3 * wide:.2g} mm, "
                "so force and shape follow the triangles; a quarter of the patch is fine enough: refine the mesh"
            )
        if extent < wide and self.whole().closed:
            self._notes.append(
                f"Kernel: the patch of {1e3 * wide:.2g} mm is wider than the organ, {2e3 * extent:.2g} mm across. The "
                "laws of finger and tissue are those of a patch within the surface: the force is meaningless"
            )
        self.hold("whole", np.zeros(1))
        begin(self.own["friction"]["gain"], FADE, FADE)

    @compiled
    def idle(own, contact, friction, out, dt):
        if contact.force > 0.0 or contact.whole.shape[0] > 0 or not own.idles or out.delayed != contact.delayed:
            return False
        return vector(own.foot) == vector(contact.foot) and vector(own.normal) == vector(contact.normal)

    @ieee_kernel
    def compute(
        own,
        contact: Annotated[Contact, Wants("foot", "normal", "force", "compression", "indentation", "whole")],
        friction: Annotated[Friction | None, Wants("force")],
        out: Out[Load],
        dt,
    ):
        count, f, n = 0, contact.force, vector(contact.normal)
        t = fade_value(own.friction, friction.there, friction.force, dt)
        if not friction.there or sample_of(friction) != sample_of(contact):
            t = within(t, ROUGHEST * f)
        grows = own.law_forces.shape[0] > 0
        own.idles, own.rigid = not f > 0.0, not grows and f > 0.0 and f > RIGID * contact.compression
        if f > 0.0:
            force = (t[0] - f * n[0], t[1] - f * n[1], t[2] - f * n[2])
            wide = radius_at(floats(own.law_forces), floats(own.law_radii), f) if grows else 0.0
            share = f / floats(contact.whole)[0] if contact.whole.shape[0] > 0 else 1.0
            count = spread(_spreader_of(own.spreader), vector(contact.foot), n, force, wide, share)
        if own.rigid and not own.cautioned:
            own.cautioned = True
            own.gives[0], own.gives[1] = contact.compression, contact.indentation
        if contact.whole.shape[0] > 0:
            floats(own.whole)[0] = floats(contact.whole)[0]
            lend(out.whole, own.whole)
        out.delayed = contact.delayed
        lend_first(out.nodes, own.spreader.nodes, count)
        lend_first(out.forces, own.spreader.forces, count)
        for place, normal in ((own.foot, own.normal), (out.foot, out.normal)):
            put(place, vector(contact.foot))
            put(normal, n)

    def notes(self) -> list[str]:
        if self.known["cautioned"]:
            (give, deep), width = 1e3 * self.own["gives"], 1e3 * self.radius
            self._note_once(
                f"Kernel: the finger gives {give:.2g} mm where the body gives {deep:.2g} mm, as a rigid tip does. The "
                f"contact of a rigid ball of radius r widens with the depth s, to sqrt(r s); this patch keeps "
                f"{width:.2g} mm. A body that answers to its load (ReducedFE) takes {width:.2g} mm/sqrt(r s) times the "
                f"force: {0.5 * width:.2g} times for r = 8 mm at s = 0.5 mm. Set scene.surface.area: ball, or "
                "MassSpring with Hertz's constant"
            )
        return super().notes()
