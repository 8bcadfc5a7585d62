"""The area law of a scene: one setting for the node that spreads the load and for the body."""

from decimal import Decimal

import msgspec
import numpy as np
import pytest
from pytest import approx

from palpate.cli.terminal.options import choose_launch
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.messages import Contact
from palpate.messages.base import NO_FLOATS
from palpate.nodes.base import SettingError
from palpate.nodes.deformation import BeamBundle, MassSpring, ReducedFE
from palpate.nodes.spread import Kernel
from palpate.physics.contact.area import PLATE, fingertip
from palpate.physics.errors import PalpateError
from palpate.studies.accuracy.bodies import reduced_fe
from palpate.studies.accuracy.cases import TOUCHES
from palpate.studies.accuracy.outcome import Fidelity
from palpate.studies.accuracy.reference import reference_solution

PLANE = {"surface": "plane", "vertices": 10000, "position": (0.0, 0.0, 0.0)}
TABLE = {"area": "table", "area_forces": (0.1, 1.0), "area_radii": (3e-3, 6e-3)}


def pressed(node, force):
    touch = msgspec.structs.replace(
        Contact.example(loaded=True),
        foot=(0.0, 0.0, 0.0),
        normal=(0.0, 0.0, 1.0),
        force=force,
        compression=1e-3,
        whole=NO_FLOATS,
    )
    return node.step(touch, None, dt=1e-3)


def test_the_radii_of_a_fingertip_are_cube_roots_to_the_last_bits():
    (forces, plate), radius_of_curvature, modulus = PLATE, 9e-3, 21e3
    found = fingertip(radius_of_curvature, modulus).radii
    for force, flat, radius in zip(forces, plate, found, strict=True):
        cube = Decimal(flat) ** 3 + Decimal(3) / 4 * Decimal(force) * Decimal(radius_of_curvature) / Decimal(modulus)
        assert abs(Decimal(float(radius)) / cube ** (Decimal(1) / 3) - 1) < 4e-16


def test_the_patch_grows_by_the_law_and_keeps_the_force():
    spread = Kernel(**PLANE, **TABLE)
    spread.start()
    for force, radius in ((0.1, 3e-3), (0.3, 3e-3 * 3.0**0.30103), (1.0, 6e-3), (3.0, 6e-3)):
        load = pressed(spread, force)
        away = np.linalg.norm(spread.mesh().vertices[load.nodes], axis=1)
        assert away.max() < radius and away.max() == approx(radius, abs=1.2e-3)
        assert load.forces[:, 2].sum() == approx(-force)
    light = pressed(spread, 1e-6)
    assert 0 < len(light.nodes) <= 4 and light.forces[:, 2].sum() == approx(-1e-6)


def test_a_rigid_tip_with_a_law_is_within_its_range():
    spread = Kernel(**PLANE, area="ball")
    spread.start()
    touch = msgspec.structs.replace(Contact.example(loaded=True), force=0.1, compression=1e-9)
    spread.step(touch, None, dt=1e-3)
    assert spread.condition() == "" and spread.notes() == []


@pytest.mark.parametrize("radius", [0.2e-3, 60e-3])
def test_a_radius_that_does_not_fit_the_mesh_is_an_error(radius):
    spread = Kernel(**PLANE, area="table", area_forces=(1.0,), area_radii=(radius,))
    with pytest.raises(SettingError, match=f"reaches a radius of {1e3 * radius:.2g} mm, expected one between"):
        spread.start()


@pytest.mark.parametrize("kind", [Kernel, ReducedFE, MassSpring])
@pytest.mark.parametrize(
    ("radii", "printed"),
    [
        ((2e-3, 1e-3), "the radius goes from"),
        ((1e-3,), "a radius for each force"),
        ((1e-4, 2e-2), "grows at most as"),
    ],
)
def test_an_invalid_law_is_an_error(kind, radii, printed):
    with pytest.raises(SettingError, match=f"'area_forces' and 'area_radii': .*{printed}"):
        kind(area="table", area_forces=(0.1, 1.0), area_radii=radii)


def test_other_bodies_reject_the_law_or_keep_theirs():
    for body in (BeamBundle(area="ball"), ReducedFE(surface="fingertip", model="sampled", young=160.0, area="ball")):
        with pytest.raises(SettingError, match="'area': found 'ball', expected 'fixed'"):
            body.start()
    body = MassSpring(area="ball")
    body.start()
    (note,) = body.notes()
    assert "its force law K s^n stays" in note


def test_a_law_for_another_modulus_is_reported():
    body = ReducedFE(**PLANE, area="ball", area_modulus=50e3)
    body.start()
    (note,) = body.notes()
    assert "area_modulus is 5e+04 Pa, expected 2.382e+04 Pa" in note


def test_a_scene_gives_the_law_to_both():
    sets = ["tissue.use=deformation.ReducedFE", "scene.surface.area=ball", "scene.surface.area_radius=6 mm"]
    nodes = choose_launch("kidney", sets, None, None, False).plan().graph.nodes
    for name in ("spread", "tissue"):
        assert (nodes[name].settings["area"], nodes[name].settings["area_radius"]) == ("ball", 6e-3)
    with pytest.raises(PalpateError, match="area_forces"):
        choose_launch("kidney", [*sets[:1], "scene.surface.area=table"], None, None, False).plan()


@pytest.mark.parametrize(
    ("sets", "found"),
    [
        (["scene.surface.area=ball", "tissue.area=fixed"], "'ball' in spread .* and 'fixed' in tissue"),
        (["tissue.area=fingertip"], "'fixed' in spread .* and 'fingertip' in tissue"),
        (["scene.surface.area=ball", "spread.area_radius=4 mm"], "0.004 in spread .* and 0.008 in tissue"),
        (["spread.area_radius=4 mm"], "0.004 in spread .* and 0.008 in tissue"),
    ],
)
def test_different_laws_are_refused(sets, found):
    for body in ("ReducedFE", "MassSpring", "BeamBundle"):
        with pytest.raises(GraphError, match=f"found {found}"):
            load("kidney", overrides=[f"tissue.use=deformation.{body}", *sets])
    nodes = load("kidney", overrides=["scene.surface.area=ball"]).nodes
    assert nodes["spread"].settings["area"] == nodes["tissue"].settings["area"] == "ball"


@pytest.mark.parametrize("name", ["ReducedFE", "ReducedFE-linear"])
def test_the_ball_of_the_bench_follows_hertz(name):
    """On the slab, which is not quite a half-space; a patch of fixed width has an error of 222 %."""
    method = next(m for m in reduced_fe.methods() if m.name == name)
    outcome = method.compute(TOUCHES["ball"], Fidelity("as it is"), 1)
    right = reference_solution(TOUCHES["ball"]).value("force", outcome.times)
    assert np.sqrt(np.mean((outcome.values["force"] - right) ** 2)) < 0.03 * right.max()


@pytest.mark.parametrize(
    ("name", "value"),
    [("poisson", 0.3), ("bed", 500.0), ("coarse", 700), ("capsule_thickness", 1e-3), ("nodule_radius", 4e-3)],
)
def test_the_stored_layers_of_the_fingertip_refuse_the_settings_of_a_homogeneous_organ(name, value):
    """They changed nothing."""
    body = ReducedFE(surface="fingertip", model="sampled", young=160.0, **{name: value})
    with pytest.raises(SettingError, match=f"setting '{name}'.*takes the layers of the surface fingertip"):
        body.start()
