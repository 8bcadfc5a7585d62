"""What the full model refuses, and what it says: the place, the load step, and that what was computed is kept."""

import numba
import numpy as np
import pytest
from pytest import approx

from palpate.models.fe import (
    ConvergenceError,
    MaterialError,
    MeshError,
    Pair,
    RigidIndenter,
    Settings,
    Solver,
    TetMesh,
    box,
    capsule,
    hencky,
    linear,
    mooney_rivlin,
    neo_hooke,
    plane,
    sphere,
)
from palpate.models.fe.contact.protocol import ElasticFoundation
from palpate.physics.materials.hyperelastic import Material

SOFT = neo_hooke(1e4, 0.3)
CUBE = box((1.0, 1.0, 1.0), (1, 1, 1))


def clamped(mesh):
    """The flags of a mesh held at z = 0."""
    return np.repeat(mesh.points[:, 2:] < 1e-9, 3, axis=1)


def top(mesh):
    z = mesh.points[mesh.faces][:, :, 2]
    return mesh.faces[(z > z.max() - 1e-9).all(axis=1)]


@pytest.mark.parametrize("law", [neo_hooke, hencky, linear])
def test_a_ratio_or_modulus_that_no_material_has_is_refused(law):
    for poisson in (0.5, 0.7, -1.0, np.nan):
        with pytest.raises(MaterialError, match=r"expected a number above -1 and below 0\.5"):
            law(1e4, poisson)
    for young in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(MaterialError, match="positive"):
            law(young, 0.3)


def test_mooney_rivlin_constants_without_stiffness_are_refused():
    with pytest.raises(MaterialError, match="d1 > 0"):
        mooney_rivlin(1.0, 1.0, 0, 0, 0, 0.0)
    with pytest.raises(MaterialError, match=r"c10 \+ c01 > 0"):
        mooney_rivlin(-2.0, 1.0, 0, 0, 0, 1e-5)


def test_a_modulus_wrong_by_a_factor_of_a_thousand_is_reported():
    """180 kPa of silicone, given in MPa and given in kPa as if they were MPa."""
    with pytest.raises(
        MaterialError, match=r"region 0: Young's modulus 0.18 Pa, expected 50 .* 0.18 MPa is 1.8e\+05 Pa"
    ):
        Solver(CUBE, {0: hencky(0.18, 0.48)}, clamped(CUBE))
    for stiff in (lambda: neo_hooke(180e9, 0.48), lambda: mooney_rivlin(15e9, 15e9, 0, 0, 0, 1e-11)):
        with pytest.raises(MaterialError, match=r"rubber-like.*1.8e\+0?8 kPa|rubber-like.*take `hencky`"):
            stiff()
    Solver(CUBE, {0: hencky(200e9, 0.3)}, clamped(CUBE))  # steel is a material


def test_the_modulus_of_a_custom_law_is_checked():
    @numba.njit
    def slack(F, J, p, P, A):
        P[:], A[:] = 0.0, 0.0
        return 0.0, 0.5 * (J - 1) ** 2, J - 1, 1.0

    with pytest.raises(MaterialError, match="slack: shear modulus 0 Pa"):
        Solver(CUBE, {0: Material(slack, ())}, clamped(CUBE))
    with pytest.raises(TypeError, match=r"numba\.njit"):
        Solver(CUBE, {0: Material(lambda F, J, p, P, A: (0, 0, 0, 0), ())}, clamped(CUBE))


def test_a_mesh_in_millimetres_is_noticed():
    finger = box((20.0, 20.0, 30.0), (1, 1, 1))
    with pytest.raises(MeshError, match=r"41\.2. m across, expected 1e-05 \.\.\. 4 m.*points \* 1e-3"):
        Solver(finger, {0: SOFT}, clamped(finger))


def test_an_inverted_flat_or_bent_element_is_named_with_its_place():
    turned = CUBE.elements.copy()
    turned[3] = turned[3][[1, 0, 2, 3, 4, 6, 5, 8, 7, 9]]
    with pytest.raises(MeshError, match=r"element 3 at \(.*\) m: volume -.* swap two of its corners"):
        TetMesh(CUBE.points, turned)
    flat = CUBE.points.copy()
    flat[:, 2] = 0.0
    with pytest.raises(MeshError, match="remove it if it is flat"):
        TetMesh(flat, CUBE.elements)
    bent = CUBE.points.copy()
    bent[CUBE.elements[2, 4]] += (0.6, 0.6, 0.6)
    with pytest.raises(
        MeshError, match=r"element \d at \(.*\) m: its edges are so curved that its Jacobian is negative"
    ):
        Solver(TetMesh(bent, CUBE.elements), {0: SOFT}, clamped(CUBE))


def test_invalid_points_and_nodes_are_named():
    broken = CUBE.points.copy()
    broken[5, 1] = np.nan
    with pytest.raises(MeshError, match=r"point 5: found \[.*nan.*\], expected finite numbers"):
        TetMesh(broken, CUBE.elements)
    for wrong in (-1, 99):
        lost = CUBE.elements.copy()
        lost[4, 7] = wrong
        with pytest.raises(MeshError, match=rf"element 4: refers to node {wrong}, expected 0 \.\.\. 26"):
            TetMesh(CUBE.points, lost)
    with pytest.raises(MeshError, match=r"expected \(E, 10\)"):
        TetMesh(CUBE.points, CUBE.elements[:, :4])
    with pytest.raises(MeshError, match=r"region: found shape \(2,\)"):
        TetMesh(CUBE.points, CUBE.elements, np.zeros(2, dtype=int))


def test_a_face_of_three_elements_is_an_error():
    twice = np.concatenate([CUBE.elements, CUBE.elements[:1], CUBE.elements[:1]])
    with pytest.raises(MeshError, match=r"the face of nodes \[.*\] belongs to more than two elements"):
        _ = TetMesh(CUBE.points, twice).faces


def test_a_region_without_material_is_named():
    with pytest.raises(MeshError, match=r"regions \[0\] have no material; materials are given for \[1\]"):
        Solver(CUBE, {1: SOFT}, clamped(CUBE))


def test_a_mask_of_another_shape_or_type_is_refused():
    for wrong in (np.zeros(len(CUBE.points), dtype=bool), np.zeros((27, 3)), np.arange(9)):
        with pytest.raises(ValueError, match=r"fixed: found shape .*, expected \(27, 3\) of bool"):
            Solver(CUBE, {0: SOFT}, wrong)


def test_pieces_separated_by_double_nodes_are_named():
    """Two boxes one on the other, their common nodes never merged: the upper one hangs on nothing."""
    points = np.concatenate([CUBE.points, CUBE.points + (0, 0, 1.0)])
    mesh = TetMesh(points, np.concatenate([CUBE.elements, CUBE.elements + 27]))
    with pytest.raises(
        MeshError, match=r"6 elements around \(0\.\d+, 0\.\d+, 1\.\d+\) m has no support.*9 places .* more than"
    ):
        Solver(mesh, {0: SOFT}, clamped(mesh))
    upper = (mesh.faces >= 27).all(axis=1)
    level = (np.abs(points[mesh.faces][:, :, 2] - 1.0) < 1e-9).all(axis=1)
    touch = Pair(mesh.faces[level & upper], mesh.faces[level & ~upper])
    Solver(mesh, {0: SOFT}, clamped(mesh), contacts=[touch])  # a contact may hold it


def test_a_body_that_nothing_holds_is_refused():
    with pytest.raises(MeshError, match="has no support"):
        Solver(CUBE, {0: SOFT}, np.zeros((27, 3), dtype=bool))
    fixed = np.zeros((27, 3), dtype=bool)
    fixed[0, 0] = True
    free = Solver(CUBE, {0: SOFT}, fixed, loads=lambda load: load * np.ones((27, 3)))
    with pytest.raises(ConvergenceError, match=r"load step from 0 to .* The state at load 0 is kept"):
        free.advance(1.0)


def pressed_from_above(mesh, fixed, *others):
    """A plate goes 0.05 m into the cube at the origin."""
    corner = mesh.points[mesh.faces]
    upper = mesh.faces[(corner[:, :, 2] > 1.0 - 1e-9).all(axis=1)]
    plate = RigidIndenter(upper, plane, (0.0, 0.0, -1.0), lambda load: np.array([0.0, 0.0, 1.0 - 0.05 * load]))
    return Solver(
        mesh, {0: SOFT}, fixed, contacts=[plate, *others], settings=Settings(step=1.0, largest=1.0, least=0.4)
    )


def test_a_body_that_only_a_contact_pushes_is_refused():
    free = pressed_from_above(CUBE, np.zeros((27, 3), dtype=bool))
    with pytest.raises(
        ConvergenceError, match=r"nothing holds the piece of 6 elements around \(0\.5.*Fix some of its nodes"
    ):
        free.advance(1.0)
    guided = np.zeros((27, 3), dtype=bool)
    guided[:, :2] = CUBE.points[:, :2] < 1e-9
    with pytest.raises(ConvergenceError, match=r"against moving along \(0, 0, -?1\): no contact carries a force"):
        pressed_from_above(CUBE, guided).advance(1.0)


def test_a_second_body_that_nothing_touches_is_refused():
    mesh = TetMesh(
        np.concatenate([CUBE.points, CUBE.points + (1.5, 0, 0)]), np.concatenate([CUBE.elements, CUBE.elements + 27])
    )
    fixed = clamped(mesh)
    fixed[27:] = False
    with pytest.raises(ConvergenceError, match=r"nothing holds the piece of 6 elements around \(2, 0\.5, 0\.5\) m"):
        pressed_from_above(mesh, fixed).advance(1.0)


def test_an_elastic_foundation_holds_a_body_and_plates_hold_it_except_against_sliding():
    below = CUBE.faces[(CUBE.points[CUBE.faces][:, :, 2] < 1e-9).all(axis=1)]
    free = np.zeros((27, 3), dtype=bool)
    laid = pressed_from_above(CUBE, free, ElasticFoundation(below, 1e5))
    laid.advance(1.0)
    assert laid.contacts[0].force[2] < -1.0
    floor = RigidIndenter(below, plane, (0.0, 0.0, 1.0), lambda load: np.zeros(3))
    with pytest.raises(ConvergenceError, match=r"its contacts carry a force, but not against this"):
        pressed_from_above(CUBE, free, floor).advance(1.0)
    guided = free.copy()
    guided[:, :2] = CUBE.points[:, :2] < 1e-9
    body = pressed_from_above(CUBE, guided, RigidIndenter(below, plane, (0.0, 0.0, 1.0), lambda load: np.zeros(3)))
    body.advance(1.0)
    assert body.contacts[1].force[2] == approx(-body.contacts[0].force[2], rel=1e-4) and body.load == 1.0


def test_an_invalid_contact_is_an_error():
    place = np.zeros(3)
    for wrong in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match=r"friction .*: expected a number >= 0"):
            RigidIndenter(top(CUBE), plane, (0, 0, -1), lambda load: place, friction=wrong)
        with pytest.raises(ValueError, match=r"friction .*: expected a number >= 0"):
            Pair(top(CUBE), top(CUBE), friction=wrong)
    with pytest.raises(ValueError, match="bound -1 m"):
        RigidIndenter(top(CUBE), plane, (0, 0, -1), lambda load: place, bound=-1)
    for wrong in (np.zeros((0, 6), dtype=int), np.zeros((2, 3), dtype=int)):
        with pytest.raises(ValueError, match=r"expected \(F, 6\) with F > 0, such as `TetMesh.faces`"):
            RigidIndenter(wrong, plane, (0, 0, -1), lambda load: place)
    far = top(CUBE) + 99 - top(CUBE).max()
    with pytest.raises(MeshError, match=r"refers to node 99, the mesh has 27"):
        Solver(CUBE, {0: SOFT}, clamped(CUBE), contacts=[RigidIndenter(far, plane, (0, 0, -1), lambda load: place)])
    with pytest.raises(TypeError, match=r"numba\.njit"):
        RigidIndenter(top(CUBE), lambda x, p, n, c: 0.0, (), lambda load: place)


@pytest.mark.parametrize(
    ("shape", "given", "count"), [(sphere, (), 1), (sphere, (1e-3, 2e-3), 1), (capsule, (1e-3,), 2), (plane, (1.0,), 3)]
)
def test_a_shape_gets_as_many_numbers_as_it_reads(shape, given, count):
    with pytest.raises(ValueError, match=rf"{shape.__name__}: .* expected {count} finite numbers"):
        RigidIndenter(top(CUBE), shape, given, path=lambda load: np.zeros(3))
    with pytest.raises(ValueError, match="finite"):
        RigidIndenter(top(CUBE), shape, (np.nan,) * count, path=lambda load: np.zeros(3))


def test_functions_of_the_load_are_checked_at_their_load():
    fixed = clamped(CUBE)
    none = np.full((27, 3), np.nan)
    for held, text in ((lambda load: np.zeros(3), r"held at load 0\.1: found shape"),
                       (lambda load: none, r"held at load 0\.1: the value at node 0 is not finite")):  # fmt: skip
        with pytest.raises(ValueError, match=text):
            Solver(CUBE, {0: SOFT}, fixed, held).advance(1.0)
    with pytest.raises(ValueError, match=r"loads at load .*: found shape \(27,\), expected \(27, 3\)"):
        Solver(CUBE, {0: SOFT}, fixed, loads=lambda load: np.zeros(27)).advance(1.0)
    for wrong in (np.nan, np.inf):
        with pytest.raises(ValueError, match="expected a finite number"):
            Solver(CUBE, {0: SOFT}, fixed).advance(wrong)
    for name in ("tolerance", "iterations", "step", "largest", "least"):
        with pytest.raises(ValueError, match=f"{name} 0, expected a positive number"):
            Settings(**{name: 0})


def squeezed():
    """A clamped cube whose top goes down by the load, and the flags of its top."""
    mesh = box((1, 1, 1), (2, 2, 2))
    z = mesh.points[:, 2]
    up = z > 1 - 1e-9
    fixed = np.repeat((up | (z < 1e-9))[:, None], 3, axis=1)
    body = Solver(mesh, {0: SOFT}, fixed, lambda load: -load * np.outer(up, (0, 0, 1.0)), settings=Settings(least=0.02))
    return body, up


def test_a_diverged_step_names_its_load_and_keeps_the_last_state(tmp_path):
    body, up = squeezed()
    kept = []
    with pytest.raises(ConvergenceError, match=r"load step from .* at (node \d+, )?\(.*\) m.* is kept"):
        body.advance(1.5, lambda load: (kept.append(load), body.save(tmp_path / "state.npz")))
    assert 0.3 < body.load < 1.0 and body.load == kept[-1]
    assert body.displacement[up, 2] == approx(-body.load)
    again, _ = squeezed()
    again.resume(tmp_path / "state.npz")
    assert again.load == body.load and (again.displacement == body.displacement).all()
    again.advance(0.2)  # and continues from there, here to a smaller load
    assert again.displacement[up, 2] == approx(-0.2)


def pushed(pull):
    """A block on a rigid floor that only the floor holds from below, under a force that turns into a pull."""
    mesh = box((1.0, 1.0, 0.5), (2, 2, 1))
    x, y, z = mesh.points.T
    floor = mesh.faces[(mesh.points[mesh.faces][:, :, 2] < 1e-9).all(axis=1)]
    touch = RigidIndenter(floor, plane, (0, 0, 1.0), lambda load: np.zeros(3))
    up = z > 0.5 - 1e-9
    fixed = np.stack([x < 1e-9, y < 1e-9, 0 * x > 1], axis=1)
    body = Solver(mesh, {0: SOFT}, fixed, contacts=[touch], settings=Settings(least=0.01),
                  loads=lambda load: np.outer(up, (0, 0, pull(load))) / up.sum())  # fmt: skip
    return body, touch


def test_a_contact_that_is_lost_is_named_and_the_run_until_then_is_kept():
    body, touch = pushed(lambda load: -100.0 * min(load, 2.0 - load))
    body.advance(1.0)
    assert touch.force[2] == approx(100.0, rel=1e-4)
    with pytest.raises(
        ConvergenceError, match=r"load step from (1\.9\d*|2) to 2.*nothing touches contact 0: contact is lost"
    ):
        body.advance(3.0)
    assert 1.9 < body.load <= 2.0


def test_a_contact_that_is_never_made_is_named():
    body, _ = pushed(lambda load: 100.0 * load)
    with pytest.raises(ConvergenceError, match=r"load step from 0 to .*nothing touches contact 0.*load 0 is kept"):
        body.advance(1.0)


def test_a_state_of_another_model_or_none_is_refused(tmp_path):
    body, _ = squeezed()
    body.save(tmp_path / "state.npz")
    other = Solver(CUBE, {0: SOFT}, clamped(CUBE))
    with pytest.raises(ValueError, match=r"another model: displacement: found \(125, 3\), expected \(27, 3\)"):
        other.resume(tmp_path / "state.npz")
    half = (tmp_path / "state.npz").read_bytes()[:400]
    (tmp_path / "cut.npz").write_bytes(half)
    (tmp_path / "text.npz").write_text("load 1\n")
    for name in ("cut.npz", "text.npz"):
        with pytest.raises(ValueError, match=rf"{name}: not a saved state .* remove it to start again"):
            other.resume(tmp_path / name)
    touched = Solver(CUBE, {0: SOFT}, clamped(CUBE),
                     contacts=[RigidIndenter(top(CUBE), plane, (0, 0, -1.0), lambda load: np.ones(3))])  # fmt: skip
    other.save(tmp_path / "bare.npz")
    with pytest.raises(ValueError, match=r"another model: contact0.multiplier: found none, expected \(\d+, 6\)"):
        touched.resume(tmp_path / "bare.npz")
    touched.save(str(tmp_path / "touched.npz"))
    with pytest.raises(ValueError, match=r"another model: contact0.multiplier: found \(\d+, 6\), expected none"):
        other.resume(str(tmp_path / "touched.npz"))
