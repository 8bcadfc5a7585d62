"""Effects inside the fingertip: a disabled effect changes the result, costs nothing, and is never ignored."""

import msgspec
import numpy as np
import pytest
from pytest import approx

from palpate.engine.faults import GraphError
from palpate.launch.load.effects import list_effects
from palpate.launch.load.graph import load
from palpate.launch.load.plan import plan
from palpate.launch.testing import FakeBus
from palpate.messages import Pose, Proximity, Surface
from palpate.nodes.base import effects
from palpate.nodes.contact import Series
from palpate.nodes.fingertip import BundleContact

GRAPHS = ("kidney", "nodule", "fingertip", "fingertip-slide", "softness", "pinch", "organs", "remote", "palpate-two")


def pressed_and_slid(*sets):
    """Messages (contact, friction, slip, surface) of the shipped finger with these overrides, pressed by 2 mm, held,
    slid by 1.5 mm."""
    run = plan(load("fingertip-slide", overrides=sets))
    finger = BundleContact(**run.graph.nodes["finger"].settings)
    finger.wanted = run.fields("finger")
    depth = np.concatenate([np.linspace(0.0, 2e-3, 250), np.full(350, 2e-3)])
    slid = np.concatenate([np.zeros(300), np.linspace(0.0, 1.5e-3, 300)])
    still = {"velocity": (0.0, 0.0, 0.0), "dt": 1e-3}
    poses = [Pose(position=(0.0, y, 5e-3 - d), **still) for d, y in zip(depth, slid, strict=True)]
    return FakeBus(finger).publish(*poses)


@pytest.fixture(scope="module")
def whole():
    return pressed_and_slid()


def test_without_friction_the_finger_slides_freely_and_no_solver_runs(whole):
    without = pressed_and_slid("effects.friction=off")
    assert max(np.hypot(*f.force[:2]) for _, f, _, _ in whole) > 0.1
    assert all(f.force == (0.0, 0.0, 0.0) and s.iterations == 0 for _, f, s, _ in without)
    assert [c.force for c, *_ in without] == [c.force for c, *_ in whole], "the press is the same"
    # Each node in contact slides exactly by the motion of the finger.
    slip = without[-1][2]
    assert slip.gross and slip.path[slip.state > 0] == approx(1.5e-3, rel=1e-6)


def test_the_frictionless_case_is_the_limit_of_small_friction(whole):
    del whole
    little = pressed_and_slid("finger.friction=1e-9")
    without = pressed_and_slid("effects.friction=off")
    assert little[-1][2].path == approx(without[-1][2].path, abs=1e-8)
    assert np.array_equal(little[-1][2].state, without[-1][2].state)


def test_without_relaxation_the_force_is_that_of_the_springs_in_series(whole):
    contact = pressed_and_slid("effects.relaxation=off")[-1][0]
    finger = BundleContact(**load("fingertip-slide").nodes["finger"].settings)
    finger.start()
    bundle = finger.bundle
    shorter = np.clip(2e-3 - bundle.heights, 0.0, None)
    springs = bundle.cell * shorter / (bundle.lengths / bundle.moduli).sum(axis=1)
    assert contact.force == approx(springs.sum(), rel=1e-6)
    assert max(c.force for c, *_ in whole) > 3.0 * contact.force


def test_without_the_sheet_each_beam_sticks_separately(whole):
    without = pressed_and_slid("effects.sheet=off")
    assert [c.force for c, *_ in without] == [c.force for c, *_ in whole]
    assert abs(without[-1][1].force[1] - whole[-1][1].force[1]) > 0.01


def test_slip_is_recorded_for_each_node_and_not_needed_by_forces(whole):
    without = pressed_and_slid("effects.slip=off")
    assert [(c.force, f.force, f.stick) for c, f, *_ in without] == [(c.force, f.force, f.stick) for c, f, *_ in whole]
    assert len(without[-1][2].state) == len(without[-1][2].path) == len(without[-1][3].slipped) == 0
    assert len(whole[-1][2].state) > 20 and whole[-1][2].fraction > 0.0


@pytest.mark.parametrize("graph", GRAPHS)
def test_a_disabled_effect_changes_the_plan_or_is_an_error(graph):
    """For every graph and every effect of the catalogue."""
    before = plan(load(graph, overrides=["log.fields=all"] if graph != "softness" else []))
    settings = {name: spec.settings for name, spec in before.graph.nodes.items()}
    sets = ["log.fields=all"] if graph != "softness" else []
    for effect in list_effects():
        try:
            after = plan(load(graph, overrides=[*sets, f"effects.{effect}=off"]))
        except GraphError as error:
            assert effect in str(error)
            continue
        changed = after.wanted != before.wanted or after.order != before.order or after.observers != before.observers
        changed |= {name: spec.settings for name, spec in after.graph.nodes.items()} != settings
        has = any(e.name == effect for spec in before.graph.nodes.values() for e in effects(spec.cls))
        assert changed or has, (graph, effect)


@pytest.mark.parametrize("effect", ["friction", "slip", "sheet", "relaxation"])
def test_effects_of_the_bundle_can_be_enabled(effect):
    assert "finger" in plan(load("fingertip-slide", overrides=[f"effects.{effect}=on"])).order


@pytest.mark.parametrize("graph", ["kidney", "pinch"])
def test_disabling_relaxation_of_the_tissue_disables_that_of_the_fingertip(graph):
    settings = load(graph, overrides=["effects.relaxation=off"]).nodes
    name = "contact" if graph == "kidney" else "joint"
    assert settings[name].settings["finger_damping"] == settings["tissue"].settings["damping"] == 0.0


def test_a_press_without_relaxation_dissipates_nothing():
    """Work of a closed press on an elastic body: the dissipation of implicit steps goes to zero with their length."""

    def lost(damping, rate):
        t = np.arange(1, round(0.6 * rate)) / rate
        approach = 6e-3 * np.sin(np.pi * t / 0.6) ** 2
        law = {"nodes": [], "displacement": np.zeros((0, 3)), "stiffness": 3e3, "exponent": 1.5, "damping": 0.0}
        bus = FakeBus(Series(finger_damping=damping), rate=rate)
        force, s2 = [], 0.0
        for e in approach:
            bus.publish(Surface(**law, rest_indentation=0.0, previous_indentation=s2))
            near = Proximity.example(loaded=True)
            (contact,) = bus.publish(msgspec.structs.replace(near, approach=float(e), tick=-1, time=-1))
            s2 = contact.indentation
            force.append(contact.force)
        work = np.array(force) * np.diff(np.concatenate([[0.0], approach]))
        return work.sum() / np.abs(work).sum() * 2.0

    off = [lost(0.0, rate) for rate in (500.0, 1000.0, 2000.0)]
    assert off[0] == approx(2.0 * off[1], rel=0.1) and off[1] == approx(2.0 * off[2], rel=0.1), (
        "first order in the step"
    )
    assert off[2] < 0.02
    assert lost(8.0, 2000.0) > 3.0 * off[2]
