"""Several fingers: the streams of each, and pictures of all of them."""

import importlib.util
from dataclasses import replace

import numpy as np
import pytest

from palpate.engine.imports import full_name
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Force, Friction, Pose, Surface
from palpate.messages.grip import Grip
from palpate.records.reader import Recording
from palpate.views.pictures import draw_pictures
from palpate.views.pictures.touch import TouchStreams
from palpate.views.shown import fingers, links_of, links_of_plan
from palpate.views.surface.moments import bodies_of, instants


def of(found, *kinds):
    return [tuple(finger.get(full_name(kind)) for kind in kinds) for finger in found]


@pytest.fixture(scope="module")
def pinched(tmp_path_factory):
    path = tmp_path_factory.mktemp("pinch") / "pinch.mcap"
    sets = ("scene.surface.vertices=1500", "device-thumb.speed_factor=3", "device-index.speed_factor=3")
    outcome = execute(find("pinch").but(record=path, place="fused", duration=1.3, overrides=sets))
    assert outcome.result.ok, outcome.result.deaths
    return path


def test_each_finger_has_separate_streams_and_all_share_the_body():
    kinds = Contact, Friction, Pose, Force, Surface, Grip
    assert of(fingers(*links_of_plan(find("pinch").plan())), *kinds) == [
        ("contact-thumb", "friction-thumb", "thumb", "controller-thumb", "tissue", "grip"),
        ("contact-index", "friction-index", "index", "controller-index", "tissue", "grip"),
    ]
    assert of(fingers(*links_of_plan(find("palpate-two").plan())), Contact, Force) == [
        ("contact-1", "controller-1"), ("contact-2", "controller-2"),
    ]  # fmt: skip


def test_a_finger_on_two_organs_counts_as_one_finger():
    (finger,) = fingers(*links_of_plan(find("organs").plan()))
    kinds = Contact, Friction, Pose, Force
    assert of([finger], *kinds) == [("both.Contact", "both.Friction", "finger", "controller")]  # sum of both organs
    assert finger.near == ["collision-kidney", "collision-liver"]
    assert of(fingers(*links_of_plan(find("kidney").plan())), Contact, Surface) == [("contact", "tissue")]


def test_two_fingers_with_separate_bodies_count_as_two():
    streams = {
        s: (s, full_name(kind)) for s, kind in (("c1", Contact), ("b1", Surface), ("c2", Contact), ("b2", Surface))
    }
    wires = [("c1", "body", "b1"), ("b1", "load", "c1"), ("c2", "body", "b2"), ("b2", "load", "c2")]
    assert of(fingers(wires, streams), Contact, Surface) == [("c1", "b1"), ("c2", "b2")]
    assert of(fingers([], streams), Contact, Surface) == [("c1", "b1")]


def test_the_fingers_are_found_in_a_recording(pinched):
    recording = Recording(pinched)
    assert of(fingers(*links_of(recording)), Contact, Force) == [
        ("contact-thumb", "controller-thumb"), ("contact-index", "controller-index"),
    ]  # fmt: skip


def test_an_instant_has_each_finger_on_its_side_of_the_organ(pinched):
    touch = TouchStreams(Recording(pinched))
    deep = max(instants(touch, bodies_of(touch)), key=lambda one: one.depth)
    thumb, index = deep.tips
    assert thumb[1] < -0.015 and index[1] > 0.015
    assert (deep.loads > 0.8).all() and (deep.depths > 3e-3).all()
    assert deep.forces[0][1] < -0.5 and deep.forces[1][1] > 0.5
    deep.loads[1] += 0.1
    loads = f"{deep.loads[0]:.2f}, {deep.loads[1]:.2f} N"
    assert deep.title().endswith(loads)  # the thumb is on the left of the picture, in any order of the nodes
    turned = replace(deep, tips=deep.tips[::-1], loads=deep.loads[::-1], depths=deep.depths[::-1])
    assert turned.title() == deep.title()
    moved = np.linalg.norm(deep.displacement, axis=1) > 1e-3
    sides = bodies_of(touch).mesh.vertices[moved][:, 1]
    assert sides.min() < -0.02 and sides.max() > 0.02


def test_the_pictures_show_each_finger_and_the_grip(pinched, tmp_path, monkeypatch):
    there = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda n, *more: None if n == "pyvista" else there(n, *more))
    made = [path.stem for path in draw_pictures(pinched, tmp_path)]
    each = [
        f"{name}-contact-{f}" for name in ("force", "compression", "friction", "device") for f in ("thumb", "index")
    ]
    assert made == ["path-contact-thumb", "path-contact-index", "grip", *each]
