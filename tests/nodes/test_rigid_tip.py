"""A patch of fixed width under a rigid tip: reported once, with an error that Hertz's law confirms."""

import math

import msgspec
import numpy as np
import pytest
from pytest import approx

from palpate.messages import Contact, Proximity, Surface
from palpate.nodes.contact import Series
from palpate.nodes.deformation import ReducedFE
from palpate.nodes.spread import Kernel
from palpate.studies.accuracy import chain
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.outcome import Fidelity
from palpate.studies.accuracy.reference import HERTZ
from palpate.studies.peers.continuum import POISSON, RADIUS, YOUNG

PLANE = {"surface": "plane", "vertices": 900, "position": (0.0, 0.0, 0.0)}


def pressed(compression, indentation=5e-4):
    contact = Contact.example(loaded=True)
    return msgspec.structs.replace(
        contact,
        foot=(0.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        force=0.1,
        compression=compression,
        indentation=indentation,
    )


def test_a_rigid_finger_is_noted_once_and_marked_while_it_presses():
    spread = Kernel(**PLANE)
    spread.start()
    spread.step(pressed(1e-3), None, dt=1e-3)
    assert spread.condition() == "" and spread.notes() == []
    spread.step(pressed(1e-6), None, dt=1e-3)
    assert spread.condition() == "outside its range"
    (note,) = spread.notes()
    assert (
        "0.001 mm where the body gives 0.5 mm" in note
        and "keeps 8 mm" in note
        and "4 times" in note
        and "MassSpring" in note
    )
    spread.step(pressed(2e-6), None, dt=1e-3)
    assert spread.condition() and spread.notes() == []
    spread.step(msgspec.structs.replace(pressed(1e-6), force=0.0), None, dt=1e-3)
    assert spread.condition() == ""
    spread.start()
    spread.step(pressed(1e-6), None, dt=1e-3)
    assert len(spread.notes()) == 1


def test_a_light_touch_on_recovering_tissue_is_not_reported_as_a_rigid_tip():
    spread = Kernel(**PLANE)
    spread.start()
    spread.step(msgspec.structs.replace(pressed(2e-5, indentation=5e-3), force=1e-3), None, dt=1e-3)
    assert spread.condition() == "" and spread.notes() == []


def test_the_force_error_under_a_rigid_ball_is_that_of_the_note():
    """The ball of `bench accuracy`, compared with Hertz's closed form at its largest depth."""
    touch = TOUCHES["ball"]
    body = {"model": "linear", "young": YOUNG, "poisson": POISSON, "retardation": 0.0}
    outcome = chain.run(touch, ReducedFE, Fidelity("as it is", settings={"body": body}), chain.BALL, 1)
    approach, *_ = touch.at(outcome.times)
    deepest = float(approach.max())
    ratio = float(outcome.values["force"].max()) / (HERTZ * deepest**1.5)
    assert ratio == approx(RADIUS / math.sqrt(RADIUS * deepest), rel=0.1)


@pytest.mark.parametrize("stiffness", [100.0, 3000.0])
def test_the_fingertip_of_the_scenes_does_not_count_as_rigid(stiffness):
    contact, spread = Series(), Kernel(**PLANE)
    contact.start(), spread.start()
    for approach in np.linspace(1e-6, 6e-3, 200):
        near = msgspec.structs.replace(
            Proximity.example(loaded=True), foot=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), approach=float(approach)
        )
        law = msgspec.structs.replace(
            Surface.example(loaded=True), stiffness=stiffness, exponent=1.0, damping=0.0, rest_indentation=0.0,
            previous_indentation=0.0,
        )  # fmt: skip
        spread.step(contact.step(near, law, dt=1e-3), None, dt=1e-3)
        assert spread.condition() == ""
