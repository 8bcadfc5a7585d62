"""The beam foundation as the body of a touch: its pressures, a nodule in it, the energy of a whole run."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, Proximity, Surface
from palpate.nodes.base.contacts import press_body
from palpate.nodes.base.nodule import WithNodule
from palpate.nodes.base.surface import surface_mesh
from palpate.nodes.contact import Series
from palpate.nodes.deformation import BeamBundle, MassSpring
from palpate.nodes.display import PinArray
from palpate.nodes.spread import Kernel
from palpate.records.reader import Recording

FLAT = {"surface": "plane", "vertices": 2500, "position": (0.0, 0.0, 0.0)}
MESH = surface_mesh("plane", 2500)
UP = (0.0, 0.0, 1.0)
NODULE = {"nodule_radius": 4e-3, "nodule_position": (3e-3, 0.0, 0.0)}


def pressed(force, foot=(0.0, 0.0, 0.0)):
    contact = Contact(
        foot=foot, normal=UP, force=force, compression=2e-3, indentation=1e-3, compression_rate=0, indentation_rate=0
    )
    (load,) = FakeBus(Kernel(**FLAT, radius=6e-3)).publish(contact)
    return contact, Load(nodes=load.nodes, forces=load.forces, foot=foot, normal=UP)


def test_the_pressures_belong_to_the_displaced_nodes_and_sum_to_the_force():
    _, load = pressed(0.8)
    answer = FakeBus(BeamBundle(**FLAT)).publish(load, load)[-1]
    assert len(answer.pressure) == len(answer.nodes) > 20
    assert (answer.pressure * MESH.areas[answer.nodes]).sum() == approx(0.8)
    by_node = dict(zip(load.nodes.tolist(), -load.forces[:, 2], strict=True))
    expected = [by_node.get(node, 0.0) / MESH.areas[node] for node in answer.nodes.tolist()]
    assert answer.pressure == approx(expected)


def test_recovering_nodes_have_no_pressure():
    bus = FakeBus(BeamBundle(**FLAT))
    _, here = pressed(0.8)
    _, there = pressed(0.8, (0.02, 0.0, 0.0))
    bus.publish(*[here] * 50)
    answer = bus.publish(there)[-1]
    assert (answer.pressure == 0).sum() > 20
    assert (answer.pressure * MESH.areas[answer.nodes]).sum() == approx(0.8)
    x = MESH.vertices[answer.nodes, 0]
    assert x[answer.pressure > 0].min() > 0.01
    empty = Load(nodes=[], forces=np.zeros((0, 3)), foot=(0, 0, 0), normal=UP)
    assert not bus.publish(empty)[-1].pressure.any()


def test_a_node_listed_twice_in_a_load_is_loaded_twice():
    bus = FakeBus(BeamBundle(**FLAT))
    (answer,) = bus.publish(Load(nodes=[7, 7], forces=[[0, 0, -0.1], [0, 0, -0.2]], foot=(0, 0, 0), normal=UP))
    assert answer.nodes.tolist() == [7] and answer.pressure == approx(0.3 / MESH.areas[7])


def test_the_pins_use_the_pressure_of_the_listed_nodes():
    """The pins under an eccentric load are highest on that side, and only the load moves them."""
    display = PinArray(shows="pressure", rows=8, columns=8, rate=1e3, **FLAT)
    contact, load = pressed(0.8)
    _, aside = pressed(0.8, (4e-3, 0.0, 0.0))
    body = BeamBundle(**FLAT)
    middle, right = (
        FakeBus(display).publish(FakeBus(body).publish(one)[0], contact)[0].heights for one in (load, aside)
    )
    assert middle == approx(middle[:, ::-1], rel=0.02) and middle == approx(middle[::-1], rel=0.02)
    assert right[:, 4:].sum() > 1.5 * right[:, :4].sum()


@pytest.mark.parametrize("kind", [BeamBundle, MassSpring])
def test_a_nodule_reduces_the_indentation_and_stiffens_the_body(kind):
    """At the same force the surface indents less above the nodule, and equally elsewhere."""
    _, load = pressed(0.4)
    plain, hard = (FakeBus(kind(**FLAT, **more)).publish(*[load] * 20)[-1] for more in ({}, NODULE))
    assert (plain.nodes == hard.nodes).all()
    factor = WithNodule(**FLAT, **NODULE).hardness()[plain.nodes]
    deep, less = -plain.displacement[:, 2], -hard.displacement[:, 2]
    assert (less[factor > 1.05] < deep[factor > 1.05]).all() and (factor > 1.05).any()
    assert less[factor == 1.0] == approx(deep[factor == 1.0])
    assert hard.previous_indentation < plain.previous_indentation and hard.stiffness > plain.stiffness


def test_beams_over_a_nodule_deform_less_by_the_factor():
    _, load = pressed(0.1)
    plain, hard = (FakeBus(BeamBundle(**FLAT, **more)).publish(load)[-1] for more in ({}, NODULE))
    factor = WithNodule(**FLAT, **NODULE).hardness()[plain.nodes]
    assert plain.displacement[:, 2] / hard.displacement[:, 2] == approx(factor, rel=1e-9)


@pytest.fixture(scope="module")
def kidney(tmp_path_factory):
    file = tmp_path_factory.mktemp("beams") / "run.mcap"
    sets = ("tissue.use=deformation.BeamBundle", "effects.pressure=on", "scene.surface.vertices=1500")
    assert execute(find("kidney").but(record=file, place="fused", overrides=sets)).result.ok
    return Recording(file)


def test_a_kidney_of_beams_absorbs_work_in_each_touch(kidney):
    from palpate.views.pictures.touch import touches, work

    contact = kidney.columns("contact")
    approach = contact["compression"] + contact["indentation"]
    assert (contact["force"] >= 0).all() and contact["force"].max() > 0.5
    slices = touches(contact["time"], contact["force"])
    assert len(slices) >= 2
    assert all(work(approach[one], contact["force"][one]) > 0 for one in slices)
    assert kidney.columns("controller")["energy"].min() > -5e-4
    assert np.linalg.norm(kidney.columns("controller")["force"], axis=1).max() <= 9.0


def test_its_pressures_carry_the_contact_force_at_each_tick(kidney):
    settings = next(n for n in kidney.about["plan"]["nodes"] if n["name"] == "tissue")["settings"]
    areas = surface_mesh("kidney", settings["vertices"], tuple(settings["position"])).areas
    force = kidney.columns("contact")["force"]
    for tick, surface in list(enumerate(kidney.messages("tissue")))[300:2000:97]:
        assert isinstance(surface, Surface) and len(surface.pressure) == len(surface.nodes)
        carried = (surface.pressure * areas[surface.nodes]).sum()
        assert carried == approx(
            force[tick], rel=0.1, abs=1e-9
        )  # the normals of the vertices scatter around that of the contact


HILUM = {"surface": "kidney", "vertices": 10000, "position": (0.0, 0.0, 0.0), "rotation": (2 * np.pi / 3 / 3**0.5,) * 3}
FOOT, NORMAL = (1.84e-3, 8.95e-3, -20.56e-3), np.array([-0.075, -0.52, -0.851]) / np.linalg.norm([0.075, 0.52, 0.851])
ALONG = np.cross(NORMAL, (1.0, 0.0, 0.0)) / np.linalg.norm(np.cross(NORMAL, (1.0, 0.0, 0.0)))
KIDNEY_BEAMS = {"layers": (3e-3, 27e-3), "moduli": (257600.0, 64400.0), "relaxations": (0.63e-3, 12.6e-3)}


def hollow_load(spread, force, friction):
    given = Contact(foot=FOOT, normal=tuple(NORMAL), force=force, compression=2e-3, indentation=1e-3,
                    compression_rate=0.0, indentation_rate=0.0)  # fmt: skip
    return spread.step(
        given, Friction(force=tuple(friction * force * ALONG), bristle=(0.0, 0.0, 0.0), stick=False), dt=2e-4
    )


@pytest.mark.parametrize("friction", [0.5, -0.5])
def test_the_law_is_that_of_forces_that_grow_with_their_friction(friction):
    """In a hollow friction indents inclined beams, or lifts them. From 1.5 to 1.95 N of normal force, and as much more
    friction, the law of the step gives the indentation exactly, or a little more where friction lifts."""
    spread, body = Kernel(**HILUM), BeamBundle(**HILUM, **KIDNEY_BEAMS)
    spread.start()
    body.start()
    for _ in range(40):
        law = press_body(body, hollow_load(spread, 1.5, friction), dt=2e-4)
    one, two = (law.rest_indentation + (f / law.stiffness) ** (1.0 / law.exponent) for f in (1.5, 1.95))
    reached = press_body(body, hollow_load(spread, 1.95, friction), dt=2e-4).previous_indentation
    assert two == approx(reached, rel=1e-6) if friction < 0.0 else two > reached > one


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_friction_in_a_hollow_does_not_make_contact_and_body_oscillate(sense):
    """5 kHz, 2.1 N, friction 0.5: the force alternated between 1.1 and 4.1 N while the finger was still."""
    spread, body, contact = Kernel(**HILUM), BeamBundle(**HILUM, **KIDNEY_BEAMS), Series()
    for node in (spread, body, contact):
        node.start()
    surface, forces = press_body(body, hollow_load(spread, 0.0, 0.0), dt=2e-4), []
    for k in range(1500):
        depth = 11.36e-3 * min(k / 1000, 1.0)
        given = Proximity(foot=FOOT, normal=tuple(NORMAL), slip=(0.0, 0.0, 0.0), gap=4e-3 - depth, approach=depth,
                          separation=0.0, coordinates=(0.0, 0.0), element=0, time=k * 200_000)  # fmt: skip
        force = contact.step(given, surface, dt=2e-4).force
        forces.append(force)
        surface = press_body(body, hollow_load(spread, force, 0.5 * sense), dt=2e-4)
    assert max(forces) > 1.0
    assert np.abs(np.diff(forces)[1010:]).max() < 0.02
