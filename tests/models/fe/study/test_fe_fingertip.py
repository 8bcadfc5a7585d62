"""The layered fingertip: its shape, its layers under load, its record; and the node that reads the record."""

from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction
from palpate.models.fe import hencky
from palpate.models.fe.element.elements import POINTS, gradients
from palpate.models.fe.element.files import write_vtu
from palpate.models.fe.element.mesh import MeshError
from palpate.models.fe.meshing.fingertip import (
    BONE,
    DERMIS,
    EPIDERMIS,
    NAIL,
    PLATE,
    SUBCUTIS,
    FingertipDimensions,
    materials,
)
from palpate.models.fe.study.press_record import LEVELS, PressRun, record
from palpate.models.fe.study.pressing import Pressing
from palpate.nodes.base import SettingError
from palpate.nodes.tactile.flow import Flow
from palpate.physics.materials.hyperelastic import rest_moduli


@lru_cache
def pressed():
    press = Pressing(FingertipDimensions(cells=3), "steel", "cortical")
    curve = record(press, 1.5e-4)
    return press, curve


def test_the_layers_have_their_volumes():
    tip = FingertipDimensions(cells=5)
    _, det = gradients(tip.mesh.points, tip.mesh.elements, POINTS)
    volume = det.sum(axis=1) / 24
    volumes = [volume[tip.mesh.region == k].sum() for k in (BONE, SUBCUTIS, DERMIS, EPIDERMIS)]
    capsule = 0.5 * (np.pi * tip.radii**2 * tip.phalanx + 2 / 3 * np.pi * tip.radii**3)
    assert np.cumsum(volumes) == approx(capsule, rel=2e-3)


def test_the_finger_first_touches_at_the_origin_with_its_tip_lower():
    tip = FingertipDimensions(cells=4)
    points = tip.mesh.points
    assert points[:, 2].min() == approx(0.0, abs=3e-5)
    assert np.linalg.norm(points[np.argmin(points[:, 2])]) < 2e-3
    assert points[:, 0].min() == approx(0.0, abs=1e-12)
    rear = points[tip.rear]
    assert rear[:, 1].min() > 0 and rear[:, 2].mean() > 0.01


def test_other_dimensions_are_one_argument_and_bad_ones_are_refused():
    thick = FingertipDimensions(dermis=2e-3, bone=5e-3, cells=3)
    assert thick.radii[-1] == approx(5e-3 + 2.5e-3 + 2e-3 + 0.41e-3)
    assert (thick.mesh.corner_volumes > 0).all()
    for wrong in ({"bone": 0.0}, {"cells": 2}, {"tilt": 1.0}, {"dermis": np.nan}):
        with pytest.raises(MeshError):
            FingertipDimensions(**wrong)
    for wrong in (0.0, -1.0, np.nan, "stone", "literal", "stone/2", "cortical/0", "printed/", "/2"):
        with pytest.raises(MeshError, match="expected printed, calibrated, cortical"):
            materials(wrong)
    with pytest.raises(ValueError, match="steel, silicone"):
        Pressing(FingertipDimensions(cells=3), "rubber")


def test_the_sets_differ_by_one_divisor_and_by_the_bone():
    printed, calibrated, cortical = (materials(name) for name in ("printed", "calibrated", "cortical"))
    for layer in (BONE, SUBCUTIS, DERMIS, EPIDERMIS, NAIL):
        hard, soft = (np.array(rest_moduli(moduli[layer])) for moduli in (printed, calibrated))
        assert hard / soft == approx(16.3)  # bone, nail and bulk moduli too
    assert rest_moduli(cortical[BONE])[0] / rest_moduli(printed[BONE])[0] == approx(1000.0)
    assert cortical | {BONE: printed[BONE]} == printed
    assert calibrated[PLATE] == printed[PLATE]
    assert materials(16.3) == calibrated and materials("16.3") == calibrated
    assert materials("cortical/2")[BONE] == hencky(8.5e9, 0.3)


def test_pressing_makes_force_area_and_strain_and_the_bone_stays_rigid():
    press, curve = pressed()
    assert (np.diff(curve.force) > 0).all() and (np.diff(curve.volumes, axis=0) >= -1e-15).all()
    assert (np.diff(curve.volumes, axis=1) <= 1e-15).all()
    assert curve.area[-1] > 0
    values = press.strain()
    bone = press.finger.mesh.region == BONE
    assert values[bone].max() < 1e-3 * values.max()
    assert press.volumes(LEVELS) == approx(curve.volumes[-1])
    reaction = press.solver.reaction.sum(axis=0)[2]
    assert 2 * reaction == approx(-press.force, rel=1e-3)
    touch = press.touch
    assert 2 * float((touch.traction * touch.area).sum()) == approx(press.force, rel=1e-6)


@pytest.mark.long
def test_dividing_all_moduli_divides_the_force_on_a_rigid_plate():
    _, whole = pressed()
    soft = record(Pressing(FingertipDimensions(cells=3), "steel", "cortical/16"), 1.5e-4)
    assert soft.force[-1] == approx(whole.soften(16.0).force[-1], rel=5e-3)
    depth, area, volumes = soft.at(0.5 * soft.force[-1])
    assert 0 < depth < 1.5e-4 and area > 0 and volumes.shape == LEVELS.shape
    with pytest.raises(ValueError, match="ends at"):
        soft.at(100.0)


@pytest.mark.long
def test_an_interrupted_run_continues_from_its_last_step(tmp_path):
    record(Pressing(FingertipDimensions(cells=3), "steel", "cortical"), 7.5e-5, PressRun(tmp_path))
    again = record(Pressing(FingertipDimensions(cells=3), "steel", "cortical"), 1.5e-4, PressRun(tmp_path))
    _, whole = pressed()
    assert again.indentation[-1] == approx(1.5e-4)
    assert again.force[-1] == approx(whole.force[-1], rel=5e-3)


@pytest.mark.long
def test_a_soft_plate_yields():
    _, hard = pressed()
    soft = record(Pressing(FingertipDimensions(cells=3, plate=(15e-3, 10e-3)), "silicone", "cortical"), 2e-4)
    assert 0 < soft.force[-1] < 0.95 * np.interp(2e-4, hard.indentation, hard.force)


@pytest.mark.long
@pytest.mark.parametrize(("phalanx", "depths"), [(12e-3, (1.191e-3, 1.943e-3)), (15.5e-3, (1.233e-3, 2.085e-3))])
def test_the_length_of_the_phalanx_explains_the_difference_of_the_calibrated_finger_from_the_other_solvers(
    phalanx, depths
):
    """On steel at 0.11 and 0.50 N; the second pair of indentations is the other solver's (finite-elements.md)."""
    pressed = record(Pressing(FingertipDimensions(cells=3, phalanx=phalanx), "steel", "calibrated"), 2.2e-3)
    assert [pressed.at(force)[0] for force in (0.11, 0.50)] == approx(depths, abs=0.01e-3)


def test_fields_are_written_as_vtk(tmp_path):
    meshio = pytest.importorskip("meshio")
    press, _ = pressed()
    mesh = press.finger.mesh
    write_vtu(tmp_path / "finger.vtu", mesh, {"displacement": press.solver.displacement}, {"strain": press.strain()})
    back = meshio.read(tmp_path / "finger.vtu")
    assert back.points == approx(mesh.points)
    assert (back.cells[0].data == mesh.elements).all()
    assert back.point_data["displacement"] == approx(press.solver.displacement)


def contact(force):
    return Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0,
                   compression_rate=0, indentation_rate=0)  # fmt: skip


def table(folder):
    path = folder / "table.npz"
    force = np.array([0.0, 0.1, 0.5])
    np.savez(path, levels=[0.1, 0.2], **{
        "silicone.force": force, "silicone.area": 1e-4 * force, "silicone.volumes": np.outer(force, [2e-6, 1e-6]),
    })  # fmt: skip
    return str(path)


def test_flow_reads_between_the_recorded_forces(tmp_path):
    bus = FakeBus(Flow(table=table(tmp_path), friction=0.5))
    none, some, most = bus.publish(contact(0.0), contact(0.3), contact(9.0))
    assert none.area == 0.0 and (none.volumes == 0).all()
    assert some.area == approx(3e-5) and some.area_rate == approx(1e-4)
    assert some.volumes == approx([6e-7, 3e-7]) and some.volume_rates == approx([2e-6, 1e-6])
    assert some.stick_radius == approx(np.sqrt(some.area / np.pi))
    assert most.area == approx(5e-5) and most.area_rate == 0.0
    bus.hold("friction", Friction(force=(0.2, 0, 0), bristle=(0, 0, 0), stick=False))
    assert bus.publish(contact(0.3))[0].stick_radius == 0.0


def test_flow_computes_only_what_is_wanted(tmp_path):
    node = Flow(table=table(tmp_path))
    node.wanted = frozenset({"area"})
    sent = FakeBus(node).publish(contact(0.3))[0]
    assert sent.area > 0 and len(sent.volumes) == 0 and sent.stick_radius == 0.0


@pytest.mark.parametrize(
    ("wanted", "columns"),
    [
        ({"area"}, 1),
        ({"area_rate"}, 1),
        ({"stick_radius"}, 1),
        ({"volumes"}, 2),
        ({"volume_rates", "area"}, 3),
        (None, 3),
    ],
)
def test_flow_stores_no_unread_curve(tmp_path, wanted, columns):
    """What is wanted is the same as in the full node; of the rest there is not even a column to be read."""
    node, full = Flow(table=table(tmp_path)), FakeBus(Flow(table=table(tmp_path)))
    if wanted is not None:
        node.wanted = frozenset(wanted)
    few = FakeBus(node)
    for force in (0.0, 0.07, 0.3, 9.0):
        part, whole = few.publish(contact(force))[0], full.publish(contact(force))[0]
        for name in wanted or ("area", "area_rate", "volumes", "volume_rates", "stick_radius"):
            assert getattr(part, name) == approx(getattr(whole, name))
    assert node._columns.shape[1] == columns


@pytest.mark.parametrize(
    "wrong",
    [
        {"silicone.force": [0.0, 0.5, 0.5]},
        {"silicone.force": [0.1, 0.2, 0.5]},
        {"silicone.area": [0.0, np.nan, 1.0]},
        {"silicone.area": [0.0, 1.0]},
        {"silicone.area": ["none", "some", "all"]},
        {"levels": ["low", "high"]},
    ],
)
def test_flow_rejects_a_table_that_is_not_a_curve(tmp_path, wrong):
    with np.load(table(tmp_path)) as archive:
        data = {name: archive[name] for name in archive.files}
    np.savez(tmp_path / "wrong.npz", **(data | wrong))
    with pytest.raises(SettingError, match="forces that rise from 0"):
        FakeBus(Flow(table=str(tmp_path / "wrong.npz")))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "wrong.npz").read_bytes()[:200])
    with pytest.raises(SettingError, match=r"cut\.npz"):
        FakeBus(Flow(table=str(tmp_path / "cut.npz")))


def test_flow_rejects_a_missing_table(tmp_path):
    with pytest.raises(SettingError, match="palpate build fe table"):
        FakeBus(Flow(table=str(tmp_path / "no.npz")))
