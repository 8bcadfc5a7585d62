"""Contact of an organ with itself, where walls of its surface face each other (docs/equations/between.md)."""

from functools import partial

import numpy as np

from palpate.nodes.base import SettingError
from palpate.nodes.contact.between import Between
from palpate.nodes.contact.organs.given_bodies import GivenBody
from palpate.nodes.contact.organs.organ_notes import spacing_notes
from palpate.nodes.contact.side import Side
from palpate.physics.bodies.between_bodies import BetweenBody, folded_between
from palpate.physics.contact.organs.candidates import Candidates
from palpate.physics.contact.organs.folded import folded_candidates


class Folds(Between):
    """A `contact.Between` of an organ with itself: of the walls of a cut, a fissure or a fold that close under a load
    (docs/equations/between.md).

    `first` are the loads of fingers on the body, `second` those of other organs, without its two `contact.Wall`, in the
    order of the body's loads. Walls that the body's basis couples (`walls` of ReducedFE) are left out. The scene's key
    `folds` adds this node to a graph.

    reach   largest gap of walls that have candidates
    """

    effect = "folds"
    of_one_body = True

    def _candidates(self, sides: list[GivenBody]) -> Candidates:
        """SettingError: there are several bodies."""
        if len(sides) != 1:
            raise SettingError(f"setting 'bodies': found {len(sides)} bodies, expected 1: use contact.Between for two")
        return folded_candidates(sides[0].mesh, _least(sides[0]), self.reach, self.cells)

    def _answers(
        self, sides: list[GivenBody], found: Candidates, normal: np.ndarray, area: np.ndarray, tangents: np.ndarray
    ) -> tuple[BetweenBody, BetweenBody]:
        """Compliance of the body for the opening of the candidates; as the second body it only has other loads."""
        ((body, mesh),) = sides
        between = partial(body.between, len(mesh.vertices))
        one = folded_between(between, found.first, found.second, normal, area, tangents)
        return one, one._replace(matrix=np.zeros_like(one.matrix), drags=np.zeros_like(one.drags))

    def _remark(self, sides: list[GivenBody], found: Candidates, rubs: bool) -> None:
        ((body, _),) = sides
        if not len(found.gap):
            least = f"{1e3 * _least(sides[0]):.3g} (`walls` of the body)" if _least(sides[0]) else "0"
            self._notes.append(
                f"Folds: no walls of the surface face each other with a gap of {least} to {1e3 * self.reach:.3g} mm "
                "(`reach`), so the organ does not touch itself"
            )
        self._notes += spacing_notes("Folds", found)
        how = "" if rubs else "slide on each other without friction, and "
        self._notes.append(
            f"Folds: the walls {how}are linear where they touch: large displacement acts under fingers only"
        )
        if not hasattr(body, "basis"):
            self._notes.append(
                f"Folds: {type(body).__name__}: a finger moves only the surface under its patch, so that it does not "
                "close the walls next to it, as with deformation.ReducedFE"
            )


class Wall(Side):
    """The load of a `contact.Folds` on one of the walls of its body: a `contact.Side`."""

    effect = "folds"


def _least(side: GivenBody) -> float:
    """Gap [m] below which walls are coupled by the basis of the body."""
    return float(side.body.near_walls()) if hasattr(side.body, "near_walls") else 0.0
