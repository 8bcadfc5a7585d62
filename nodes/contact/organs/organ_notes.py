"""What a contact of organs says to the user: before a run, of its candidates, and of what happened in it."""

from collections.abc import Iterator
from typing import Any

from palpate.nodes.contact.organs.given_bodies import GivenBody
from palpate.physics.contact.organs import between as contact
from palpate.physics.contact.organs.candidates import Candidates

GIVEN = 1e-3  # [J] Energy that a contact may generate without a note
COARSE = 2e-3  # [m] Spacing of the candidates above which a note is printed


def start_notes(sides: list[GivenBody], found: Candidates, reach: float, rubs: bool) -> Iterator[str]:
    """Of two bodies, in the order of print; reach [m]."""
    if not len(found.gap):
        yield f"Between: the bodies are farther apart than {1e3 * reach:.3g} mm (`reach`), so they do not touch"
    yield from spacing_notes("Between", found)
    how = "" if rubs else "slide on each other without friction, and "
    yield f"Between: the organs {how}are linear where they touch: large displacement acts under fingers only"
    if local := sorted({type(side.body).__name__ for side in sides if not hasattr(side.body, "basis")}):
        yield (
            f"Between: {' and '.join(local)}: a finger moves only the surface under its patch, so that it does not "
            "press the organ into its neighbour from the other side, as with deformation.ReducedFE"
        )


def spacing_notes(name: str, found: Candidates) -> Iterator[str]:
    """Of candidates that are far apart; `name` of the node's class."""
    if found.spacing > COARSE:
        yield (
            f"{name}: the candidates are {1e3 * found.spacing:.2g} mm apart, so that patches "
            f"narrower than {4e3 * found.spacing:.2g} mm are too stiff: more `cells`, or a shorter `reach`"
        )


def growing_notes(known: Any) -> Iterator[tuple[str, float, str]]:
    """Of the state `known` of a `Between`: name, size and text of each note (`Node._note_growth`)."""
    deepest, least = known["penetrates"]
    if deepest > least > 0.0:
        yield (
            "overlap", deepest,
            f"Between: the bodies overlapped by up to {1e3 * deepest:.2g} mm for some steps, because they met "
            f"faster than {contact.MOST} candidates in a step",
        )  # fmt: skip
    lost = known["lost"]
    if lost > GIVEN:
        yield (
            "energy", lost,
            f"Between: the contact generated up to {1e3 * lost:.2g} mJ, because an organ left its "
            "foundation, landed on it, or moved far over the other, within a step: a higher rate generates less",
        )  # fmt: skip
    (aside, nearer), (cell, reach) = known["strays"], known["allowed"]
    follows = known["track"]["cell"]["shape"][0] > 0
    if aside > cell > 0.0 and not follows:
        yield (
            "slide", aside,
            f"Between: the foundations slid by up to {1e3 * aside:.3g} mm against each other, more than the "
            f"{1e3 * cell:.2g} mm between the candidates, which stay where they were at the start: places and "
            "directions of the forces, and the gaps of curved organs, are approximate",
        )  # fmt: skip
    if (ended := known["ended"]) > 0.0:
        yield (
            "ended", ended,
            "Between: the contact reached the end of the region with candidates, where it lacks force: set "
            "scene.between.reach to more",
        )  # fmt: skip
    if nearer > reach > 0.0 and not follows:  # else `ended` says where candidates are missing
        yield (
            "approach", nearer,
            f"Between: the foundations came nearer by up to {1e3 * nearer:.3g} mm, more than the candidates reach: "
            "set scene.between.reach to more than that",
        )  # fmt: skip
