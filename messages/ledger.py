"""Message of the energy of a touch."""

from __future__ import annotations

from typing import Annotated

from palpate.messages.base import Message


class Ledger(Message):
    """What the hand put in, where it is, and what nobody can have given. All sums are since the run's start.

    hand                  [J] () work of the hand on the display
    controller            [J] () of it: taken by limits and damping of the controller, negative where it gave
    sampling              [J] () of it: lost by holding the force over a step; negative, a sampled spring makes energy
    fingertip_stored      [J] () held by the fingertip
    fingertip_dissipated  [J] () its work less what it holds
    tissue_stored         [J] () held by the body; 0 where the model does not tell
    tissue_dissipated     [J] () its work less what it holds
    friction_stored       [J] () held by the bristles
    friction_dissipated   [J] () its work less what it holds
    work                  [J] () of the hand in this tick
    balance               [J] () of this tick that nobody has: the surface's curvature over a step
    unexplained           [J] () sum of the balances
    made                  [J] () most energy that a part, or the display as a whole, gave out and cannot have had
    culprit               [1] () which one
    tripped               [1] () true from the moment on when that was beyond the bound
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
    made: Annotated[float, "J"]
    culprit: Annotated[str, "1"] = ""
    tripped: Annotated[bool, "1"] = False
