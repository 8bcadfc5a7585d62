"""Message of the energy account of a trial."""

from typing import Annotated

from palpate.messages.base import Message
from palpate.messages.fields import OneOf

PARTS = (
    "fingertip", "tissue", "friction", "display",
    *(f"{part} {finger}" for finger in range(2, 17) for part in ("fingertip", "friction")),
)  # fmt: skip
"""What an energy account is kept of; the first finger's parts have no number."""


class Ledger(Message):
    """Energy account of the display: what the hand put in, where it is, and what was generated. All sums run from the
    run's start.

    hand                  [J] () work of the hand on the display
    controller            [J] () of it: taken by limits and damping of the controller, negative where it gave
    sampling              [J] () of it: lost by holding the force over a step; negative where a sampled spring
                                 generates energy
    fingertip_stored      [J] () stored in the fingertip
    fingertip_dissipated  [J] () its work less the stored energy
    tissue_stored         [J] () stored in the body; 0 where the model does not report it
    tissue_dissipated     [J] () its work less the stored energy
    friction_stored       [J] () stored in the bristles
    friction_dissipated   [J] () its work less the stored energy
    work                  [J] () of the hand in this tick
    balance               [J] () energy of this tick that no part accounts for: the surface's curvature over a step
    unexplained           [J] () sum of the balances
    generated             [J] () largest energy that a part, or the display as a whole, gave out beyond what it received
    generated_by          [1] () that part
    tripped               [1] () true from the moment that this exceeded the bound
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
    generated_by: Annotated[str, "1", OneOf("", *PARTS)] = ""
    tripped: Annotated[bool, "1"] = False
