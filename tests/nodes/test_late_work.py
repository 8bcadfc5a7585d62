"""Energy of contacts of organs on foundations: what a contact did after its step is its force times the motion then."""

import numpy as np
import pytest

from palpate.physics.bodies.floating.turning import spin
from palpate.studies.organ_stacks import FREE, Row, ball, body


class Books:
    """A row of organs that is stepped: work [J] of each contact on the organs, from its messages and their motions, and
    on the surfaces of the bodies, from its state."""

    def __init__(self, row):
        self.row, self.organs, self.surfaces = row, np.zeros(len(row.pairs)), np.zeros(len(row.pairs))

    def step(self, dt):
        row = self.row
        places = [(each.own["motion"]["at"].copy(), each.own["motion"]["turn"].copy()) for each in row.moving()]
        before = [self._displaced(k) for k in range(len(row.pairs))]
        self.answers = row.run(1, dt)
        for k, (answer, pair) in enumerate(zip(self.answers, row.pairs, strict=True)):
            force, held = row.contacts[k]._held[f"members.{k}.pair.active.force"], self._displaced(k)
            self.surfaces[k] += force @ (held[0] - before[k][0]) + np.sum(self._rubs(k) * (held[1] - before[k][1]))
            for side, organ in enumerate(pair):
                (at, turn), motion = places[organ], row.moving()[organ].own["motion"]
                push = np.array(answer.resultant) * (1.0 - 2.0 * side)
                self.organs[k] += push @ (motion["at"] - at)
                self.organs[k] += answer.torques[side] @ spin(tuple(turn), tuple(motion["turn"] - turn))

    def _displaced(self, k):
        """Opening of the candidates [m] (m), and their displacement along the surface [m] (2,2m)."""
        held = self.row.contacts[k]._held
        return held[f"members.{k}.pair.moved"].sum(axis=0), held[f"members.{k}.rub.moved"].copy()

    def _rubs(self, k):
        """Friction of the candidates along their tangents [N] (2,2m)."""
        held = self.row.contacts[k]._held
        force, tangents = held[f"members.{k}.rub.force"], held[f"members.{k}.rub.tangents"]
        return np.einsum("bix,baix->bai", force, tangents).reshape(2, -1)


def hit(friction, bears):
    """Three balls at 250 Hz: the first hits a light one off its centre, which turns by up to 0.2 rad per step."""
    bodies = [body(ball(46e-3, 6e-3), 3e3, 5e-3), body(ball(0.0), 3e3, 5e-3), body(ball(-43e-3), 3e3)]
    books = Books(Row(bodies, [bears | {"mass": mass} for mass in (0.3, 0.006, 0.2)], friction))
    books.row.moving()[0].own["motion"]["speed"] = (0.2, 0.1, -0.8)
    energy = books.row.total_energy()
    for _ in range(30):
        books.step(4e-3)
    return books, energy


@pytest.mark.parametrize("friction, error", [(0.0, 1e-6), (0.5, 1e-5)])
@pytest.mark.parametrize("bears", [FREE, {"stiffness": 500.0, "damping": 2.0}])
def test_a_contact_counts_all_of_its_work_on_organs_and_their_bodies(bears, friction, error):
    """It counted the forces times the change of the gaps, which also change by their curvature, without work: up to
    3.6 mJ of 104 mJ were in no part. A candidate that moves to another cell begins at rest there, which is a change of
    its displacement without work: less than 1 uJ."""
    books, energy = hit(friction, bears)
    for k, answer in enumerate(books.answers):
        work = books.organs[k] + books.surfaces[k]
        assert answer.carried[0] == pytest.approx(-books.organs[k], abs=1e-15)
        assert answer.dissipated - answer.generated + answer.stored == pytest.approx(-work, abs=error)
        assert answer.dissipated > 5e-3 * energy
