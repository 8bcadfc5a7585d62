"""Message of the energy account of a trial."""

from typing import Annotated

from palpate.messages.base import NO_FLOATS, Floats, Sparse, always_sent
from palpate.messages.fields import OneOf

PARTS = (
    "fingertip", "tissue", "friction", "display",
    *(f"{part} {finger}" for finger in range(2, 17) for part in ("fingertip", "friction")), "contact of organs",
)  # fmt: skip
"""Parts with an energy account; those of the first finger have no number."""


class Ledger(Sparse):
    """Energy balance of the display: the work of the hand, stored, dissipated and generated energy, summed from the
    start of the run.

    hand                  [J] () work of the hand on the display
    controller            [J] () of it: absorbed by limits and damping of the controller; negative if it added energy
    sampling              [J] () of it: lost by holding the force over a step; negative where a sampled spring
                                 generates energy
    fingertip_stored      [J] () stored in the fingertip
    fingertip_dissipated  [J] () work on it minus the stored energy
    tissue_stored         [J] () stored in the body and in the organs that touch it, 0 if a model does not report it;
                                 and in the bristles between them
    tissue_dissipated     [J] () work on them minus the stored energy; what their contacts dissipate is included
    friction_stored       [J] () stored in the bristles
    friction_dissipated   [J] () work on them minus the stored energy
    work                  [J] () of the hand in this tick
    balance               [J] () energy of this tick that no part accounts for, due to the surface's curvature
    unexplained           [J] () sum of the balances
    generated             [J] () largest energy that a part, or the whole display, has released beyond what it received
    generated_by          [1] () that part
    tripped               [1] () true once the generated energy has exceeded the bound
    carried               [J] (c) work of the moving foundations of organs on the display; c = 1, 0 if none moves, and
                                 then omitted on the wire
    """

    hand: Annotated[float, "J"]
    controller: Annotated[float, "J"]
    sampling: Annotated[float, "J"]
    fingertip_stored: Annotated[float, "J"]
    fingertip_dissipated: Annotated[float, "J"]
    tissue_stored: Annotated[float, "J"]
    tissue_dissipated: Annotated[float, "J"]
    friction_stored: Annotated[float, "J"]
    friction_dissipated: Annotated[float, "J"]
    work: Annotated[float, "J"]
    balance: Annotated[float, "J"]
    unexplained: Annotated[float, "J"]
    generated: Annotated[float, "J"]
    generated_by: Annotated[str, "1", OneOf("", *PARTS)] = always_sent("")
    tripped: Annotated[bool, "1"] = always_sent(False)
    carried: Annotated[Floats, "J", ("c",)] = NO_FLOATS
