"""The body in modes with sampled points: comparison with the full model, and passivity."""

from functools import lru_cache

import numpy as np
import pytest
from formulas import series
from pressing import CondensedBody, SampledBody
from pytest import approx
from sampled_slab import MODES, RADIUS, YOUNG, at, basis, body, compliance, mode_shapes, pressed, slab, touches
from scipy.optimize import brentq, nnls

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Load
from palpate.models.fe import hencky, mooney_rivlin, neo_hooke
from palpate.models.fe.meshing.fingertip import FingertipDimensions
from palpate.models.fe.meshing.organ import Organ
from palpate.models.fe.reduce import snapshots
from palpate.models.fe.reduce.reducible import of_finger, of_organ
from palpate.models.fe.reduce.reduction import CELLS, truncation_errors
from palpate.models.fe.reduce.sampling import at_rest, fit_gamma, nonnegative, points_of, select_points
from palpate.models.fe.reduce.snapshots import MILD, mirror, press_from_rest, press_touches, scatter
from palpate.nodes.base import SettingError
from palpate.nodes.base.surface import FINGER_LENGTH, FINGER_RADIUS, surface_mesh, surface_patch
from palpate.nodes.deformation import ReducedFE
from palpate.physics.archive import ArchiveError
from palpate.physics.bodies.condensed_basis import Basis
from palpate.physics.bodies.sampled.energy import barrier, forces, scratch, tangent
from palpate.physics.bodies.sampled.solve import invert, offline_budget, settle
from palpate.physics.bodies.sampled.step import gamma
from palpate.physics.bodies.sampled_body import SampledBasis
from palpate.physics.contact.series import exponential
from palpate.physics.contact.terminal import Terminal
from palpate.physics.geometry.closest import ClosestPoint
from palpate.records.reader import Recording


def settled(it, foot, n, nodes, push, force):
    for _ in range(3):
        law = it.step(nodes, force * push, foot, n, 1e6)
    assert it.settled
    return law


def everything(points):
    """q, dW/dq and d²W/dq² at a random point where the barrier is active."""
    r = points.modes.shape[1]
    q = np.random.default_rng(5).standard_normal(r)
    return q * np.sqrt(1.5 * points.limit / (q @ q)), scratch(points), np.zeros(r), np.zeros((r, r))


def solved():
    """A small body, its stiffness at rest, a load, and the solution of the full model."""
    small = of_organ(Organ(surface_mesh("sphere", 12)))
    rest = small.elastic.pattern.matrix(small.elastic.tangent(np.zeros_like(small.mesh.points))).toarray()
    top = int(np.argmax(small.surface.vertices[:, 2]))
    load = small.hats[:, top][:, None] * np.array([2e-5, 1e-5, -6e-5])
    full = small.solver(1e3, lambda share: 1e3 * share * load)
    full.advance(1.0)
    return small, rest, load, full


def test_the_full_solution_is_an_equilibrium_in_modes_that_contain_it():
    """All points are used; the modes are the twelve softest and the remainder of the full model's displacement."""
    small, rest, load, full = solved()
    values, vectors = np.linalg.eigh(rest)
    phi, u = (vectors / np.sqrt(values))[:, :12], full.displacement.ravel()
    own = u - phi @ (phi.T @ (rest @ u))
    phi = np.column_stack([phi, own / np.sqrt(own @ rest @ own)])
    q, p, r = phi.T @ (rest @ u), phi.T @ load.ravel(), phi.shape[1]
    points, g, K = points_of(small, phi.reshape(-1, 3, r), 1e300), np.zeros(r), np.zeros((r, r))
    forces(points, q, scratch(points), g)
    assert g == approx(p, abs=1e-5 * np.abs(p).max())
    assert tangent(points, q, scratch(points), K) and np.linalg.eigvalsh(K).min() > 0.0
    forces(points, p, scratch(points), g)  # the linear solution is not an equilibrium
    assert np.abs(g - p).max() > 0.02 * np.abs(p).max()


@pytest.mark.long
def test_with_all_modes_and_all_points_the_body_equals_the_full_model():
    """Each free displacement of a small body is a mode."""
    small, rest, load, full = solved()
    values, vectors = np.linalg.eigh(rest)
    phi = (vectors / np.sqrt(values)).reshape(-1, 3, len(values))
    points = points_of(small, phi, 1e300)
    r = len(values)
    q, g, H, K, L = np.zeros(r), np.zeros(r), np.eye(r), np.zeros((r, r)), np.zeros((r, r))
    energy, p = 0.0, phi.reshape(-1, r).T @ load.ravel()
    for _ in range(40):
        energy, _, done = settle(points, scratch(points), p, q, g, H, K, L, np.zeros((4, r)), energy, offline_budget())
        if done:
            break
        tangent(points, q, scratch(points), K)
        invert(K, L, H)
    assert done
    for _ in range(3):  # remove the remaining residual by Newton's method
        tangent(points, q, scratch(points), K)
        invert(K, L, H)
        q += H @ (p - g)
        assert forces(points, q, scratch(points), g) < np.inf
    displacement = (phi.reshape(-1, r) @ q).reshape(-1, 3)
    linear = (phi.reshape(-1, r) @ p).reshape(-1, 3)
    size = np.abs(full.displacement).max()
    assert displacement == approx(full.displacement, abs=1e-3 * size)
    assert np.abs(linear - full.displacement).max() > 0.02 * size


@pytest.mark.parametrize(
    "law", [neo_hooke(1.0, 0.44), hencky(1.0, 0.3), mooney_rivlin(0.1, 0.07, 3.0, 2.0, 1.0, 1.0)], ids=["nH", "H", "MR"]
)
def test_force_and_tangent_are_derivatives_of_the_energy(law):
    small = of_organ(Organ(surface_mesh("sphere", 12)))
    small.materials = lambda young: {0: law, 1: law}
    rng = np.random.default_rng(1)
    phi = 4e-4 * rng.standard_normal((len(small.mesh.points), 3, 3))
    points = points_of(small, phi, 0.05)
    q, work, g, hessian = everything(points)
    h = 1e-5
    forces(points, q, work, g)
    assert tangent(points, q, work, hessian)
    up, down = np.zeros(3), np.zeros(3)
    for k in range(3):
        d = h * np.eye(3)[k]
        slope = (forces(points, q + d, work, up) - forces(points, q - d, work, down)) / (2 * h)
        assert slope == approx(g[k], rel=1e-5, abs=1e-7 * np.abs(g).max())
        assert (up - down) / (2 * h) == approx(hessian[k], rel=1e-4, abs=1e-6 * np.abs(hessian).max())
    assert hessian == approx(hessian.T, rel=1e-9, abs=1e-12 * np.abs(hessian).max())


def test_elements_with_one_volume_ratio_are_an_error():
    small = of_organ(Organ(surface_mesh("sphere", 12)))
    small.materials = lambda young: {0: neo_hooke(1.0, 0.48)}
    with pytest.raises(ValueError, match="'neo_hooke' with the mixed element: expected the plain element"):
        points_of(small, np.zeros((*small.mesh.points.shape, 2)), 1.0)


def test_modes_in_single_precision_give_the_same_forces():
    points = points_of(slab(), np.ascontiguousarray(mode_shapes()[:, :, :8]), 1e300)
    q, derivatives = np.random.default_rng(3).standard_normal(8) * 1e-3, []
    for kind in (np.float64, np.float32):
        own, g, hessian = points._replace(modes=points.modes.astype(kind)), np.zeros(8), np.zeros((8, 8))
        energy = forces(own, q, scratch(own), g)
        assert tangent(own, q, scratch(own), hessian)
        derivatives.append(np.r_[energy / 1e-6, g / 1e-3, hessian.ravel()])
    assert derivatives[1] == approx(derivatives[0], abs=3e-6 * np.abs(derivatives[0]).max())


def test_a_computed_touch_is_cached_and_a_damaged_file_is_ignored(tmp_path, monkeypatch):
    small, calls = of_organ(Organ(surface_mesh("sphere", 12))), []

    def counted(body, own, solve=snapshots.press_touch):
        calls.append(own)
        return solve(body, own)

    monkeypatch.setattr(snapshots, "press_touch", counted)
    few = scatter(small.surface, 2, np.ones(len(small.surface.triangles), dtype=bool), 0.02, 1e-4 * MILD[:2], 1)
    first = press_touches(small, few, folder=tmp_path)
    again = press_touches(small, few, folder=tmp_path)
    assert len(calls) == 2
    assert [p.solutions.tobytes() for p in again] == [p.solutions.tobytes() for p in first]
    next(tmp_path.iterdir()).write_bytes(b"half")
    assert press_touches(small, few, folder=tmp_path)[0].solutions == approx(first[0].solutions)
    assert len(calls) == 3
    stiffer = of_organ(Organ(surface_mesh("sphere", 12), poisson=0.4))
    press_touches(stiffer, few[:1], folder=tmp_path)
    assert len(calls) == 4 and len(list(tmp_path.iterdir())) == 3


def test_presses_of_an_organ_resume_where_they_were_interrupted(tmp_path, monkeypatch):
    small, calls = of_organ(Organ(surface_mesh("sphere", 12))), []

    def counted(*given, equilibrium=snapshots._equilibrium):
        calls.append(given)
        return equilibrium(*given)

    def interrupt(share):
        if share > 0.5:
            raise KeyboardInterrupt

    few = scatter(small.surface, 3, np.ones(len(small.surface.triangles), dtype=bool), 0.02, 1e-4 * MILD[:2], 1)
    monkeypatch.setattr(snapshots, "_equilibrium", counted)
    last = press_from_rest(small, few[2:])
    alone = len(calls)
    with pytest.raises(KeyboardInterrupt):
        press_from_rest(small, few, interrupt, tmp_path)
    assert len(list(tmp_path.iterdir())) == 2
    calls.clear()
    again = press_from_rest(small, few, folder=tmp_path)
    assert len(calls) == alone and len(list(tmp_path.iterdir())) == 3
    assert again[2].solutions.tobytes() == last[0].solutions.tobytes()


def test_the_inverse_is_exact_and_an_indefinite_tangent_is_shifted():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((12, 12))
    K, H = A @ A.T + 0.1 * np.eye(12), np.zeros((12, 12))
    invert(K, np.zeros((12, 12)), H)
    assert approx(np.eye(12), abs=1e-9) == H @ K
    invert(np.diag(np.r_[-1.0, np.ones(11)]), np.zeros((12, 12)), H)
    assert np.isfinite(H).all() and np.linalg.eigvalsh(H).min() > 0


def test_weights_are_not_negative_and_as_accurate_as_those_of_another_solver():
    rng = np.random.default_rng(2)
    A = rng.random((40, 30))
    b = A @ np.maximum(rng.standard_normal(30), 0.0) + 0.05 * rng.standard_normal(40)
    kept, x = nonnegative(A.T, b, 1e-9, 40)
    assert (x > 0).all() and len(set(kept.tolist())) == len(kept)
    assert np.linalg.norm(A[:, kept] @ x - b) == approx(nnls(A, b)[1], rel=1e-6)
    few, _ = nonnegative(A.T, b, 0.3, 40)
    assert len(few) < len(kept)


def test_the_shipped_sample_has_positive_weights_and_is_exact_at_rest():
    points = basis().points
    assert (points.weights > 0).all()
    assert len(points.kinds) < 0.5 * len(slab().mesh.elements)
    r = points.modes.shape[1]
    g, hessian = np.ones(r), np.zeros((r, r))
    assert forces(points, np.zeros(r), scratch(points), g) == 0.0
    assert np.abs(g).max() == approx(0.0, abs=1e-12)
    tangent(points, np.zeros(r), scratch(points), hessian)
    assert hessian == approx(np.eye(r), abs=1e-5)  # single precision
    missed = basis().residual_compliance.astype(float)
    assert np.linalg.eigvalsh(0.5 * (missed + missed.T)).min() > -1e-6 * np.abs(missed).max()


def test_modes_are_orthonormal_in_the_stiffness_at_rest():
    phi = mode_shapes().reshape(-1, MODES)
    rest = slab().elastic.pattern.matrix(slab().elastic.tangent(np.zeros_like(slab().mesh.points)))
    assert phi.T @ (rest @ phi) == approx(np.eye(MODES), abs=1e-9)


def test_a_light_touch_equals_the_condensed_body_at_every_point():
    rest = Basis(slab().surface.vertices, slab().surface.triangles, compliance().astype(np.float32))
    linear = CondensedBody(rest, slab().surface, YOUNG, 0.0, RADIUS, 1.0)
    for place in ((0.0, 0.0, 0.0), (0.013, -0.021, 0.0), (-0.044, 0.04, 0.0)):
        foot, n, nodes, push = at(place)
        indentation = settled(body(), foot, n, nodes, push, 1e-6)[3]
        assert indentation == approx(linear.step(nodes, 1e-6 * push, foot, n, 1e6)[2], rel=1e-3)


def unseen():
    return press_from_rest(slab(), touches(5, 17))


@lru_cache
def missed_by(count):
    """Errors of the indentation at the largest load of touches outside the snapshots."""
    errors = []
    for own in unseen():
        it, push = body(count=count, of=42), own.touch.load
        nodes = np.flatnonzero(np.abs(push).max(axis=1) > 0).astype(np.int32)
        force = float(own.touch.levels[-1]) * YOUNG
        truth = float(np.sum((slab().hats @ push) * own.solutions[-1]))
        n, foot = tuple(own.touch.normal.tolist()), tuple(own.touch.foot.tolist())
        settled(it, foot, n, nodes, push[nodes], force)
        u = np.zeros_like(push)
        where, moved = it.displaced(foot)
        u[where] = moved
        errors.append(abs(float(np.sum(push * u)) / truth - 1))
    return errors


@pytest.mark.long
def test_held_out_touches_are_accurate_and_more_modes_are_better():
    few, many = missed_by(12), missed_by(40)
    assert max(many) < 0.03
    assert np.mean(many) < np.mean(few)


def test_a_subset_of_points_changes_the_result_little():
    phi = mode_shapes()
    surface_modes = np.einsum("nv,nia->via", slab().hats, phi).reshape(-1, MODES)
    left = compliance() - surface_modes @ surface_modes.T
    _, one, share = truncation_errors(points_of(slab(), phi, 1e300), surface_modes, left, slab(), pressed()[:2])
    _, two, _ = truncation_errors(basis().points, surface_modes, left, slab(), pressed()[:2])
    assert one * share == approx(two * share, abs=0.02)  # of the indentation


def test_weights_of_one_do_not_change_the_points():
    whole = points_of(slab(), np.ascontiguousarray(mode_shapes()[:, :, :6]), 1.0)
    every = at_rest(select_points(whole, np.arange(len(whole.kinds)), np.ones(len(whole.kinds))))
    assert np.abs(every.modes - whole.modes).max() < 1e-9 * np.abs(whole.modes).max()


def test_the_iteration_from_rest_agrees_with_newton():
    (one,), (two,) = pressed()[:1], press_touches(slab(), touches()[:1])
    for a, b in zip(one.solutions, two.solutions, strict=True):
        assert np.abs(a - b).max() < 3e-3 * np.abs(b).max()


def test_half_the_modulus_under_half_the_force_indents_the_same():
    foot, n, nodes, push = at((0.011, 0.006, 0.0))
    one = settled(body(), foot, n, nodes, push, 1.2)[3]
    soft = SampledBody(basis(), slab().surface, YOUNG / 2, 0.0, RADIUS, 1.0)
    assert settled(soft, foot, n, nodes, push, 0.6)[3] == approx(one, rel=1e-6)


def test_the_mean_displacement_of_the_patch_is_the_indentation():
    foot, n, nodes, push = at((0.011, 0.006, 0.0))
    it = body()
    s = settled(it, foot, n, nodes, push, 1.2)[3]
    where, moved = it.displaced(foot)
    u = np.zeros_like(slab().surface.vertices)
    u[where] = moved
    assert np.sum(push * u[nodes]) == approx(s, rel=1e-5)


def test_random_loads_at_a_point_never_gain_work():
    """Normal and tangential loads; the stored energy is the work of loading to the same load at rest."""
    foot, n, nodes, push = at((0.011, 0.006, 0.0))
    side = np.outer(-push[:, 2], (1.0, 0.3, 0.0))
    it, rng = body(0.02), np.random.default_rng(4)
    work, before = 0.0, np.zeros_like(slab().surface.vertices)
    for _ in range(300):
        load = rng.random() * 1.2 * (rng.random() < 0.7) * push + 0.3 * rng.standard_normal() * side
        it.step(nodes, load, foot, n, 10.0 ** rng.uniform(-4, 0))
        where, moved = it.displaced(foot)
        u = np.zeros_like(before)
        u[where] = moved
        work += float(np.sum(load * (u - before)[nodes]))
        before = u
        assert work >= -1e-9
    assert work > 1e-6


@pytest.mark.parametrize("dt", [1e-5, 1e-3, 0.1, 100.0])
def test_a_closed_cycle_of_indentation_against_a_finger_costs_energy(dt):
    foot, n, nodes, push = at()
    finger, it = exponential(60.0, 900.0), body(0.02)
    law, s1, gained = it.step(nodes[:0], push[:0], foot, n, dt), 0.0, 0.0
    way = np.concatenate([np.linspace(0, 9e-3, 60), np.linspace(9e-3, 0, 60)])
    last = 0.0
    for e in way:
        f, s1, _ = series(float(e), dt, s1, finger, 0.0, Terminal(law[0], law[1], 0.0, law[2], law[3]))
        gained += f * (e - last)
        last = e
        law = it.step(nodes, f * push, foot, n, dt) if f > 0 else it.step(nodes[:0], push[:0], foot, n, dt)
        assert np.isfinite(law).all() and law[0] > 0 and 1 <= law[1] <= 3
    assert f == 0.0
    assert gained >= -1e-9


def test_contact_in_series_settles_at_the_static_force():
    foot, n, nodes, push = at((0.011, 0.006, 0.0))
    finger, it = exponential(60.0, 900.0), body()
    law, s1 = it.step(nodes[:0], push[:0], foot, n, 1e3), 0.0
    for _ in range(60):
        f, s1, _ = series(5e-3, 1e3, s1, finger, 0.0, Terminal(law[0], law[1], 0.0, law[2], law[3]))
        law = it.step(nodes, f * push, foot, n, 1e3)

    def miss(force):
        own = np.log1p(force * 900.0 / 60.0) / 900.0
        return own + settled(body(), foot, n, nodes, push, force)[3] - 5e-3

    assert f == approx(brentq(miss, 1e-6, 2.0, xtol=1e-10), rel=3e-3)


def test_the_terminal_law_foretells_the_next_step():
    foot, n, nodes, push = at((0.011, 0.006, 0.0))
    it, rng, law = body(0.02), np.random.default_rng(1), None
    force, far = 0.4, []
    for _ in range(200):
        force = float(np.clip(force + 0.02 * rng.standard_normal(), 0.05, 1.0))
        now = it.step(nodes, force * push, foot, n, 1e-3)
        if law is not None:
            foretold = law[2] + (force / law[0]) ** (1.0 / law[1])
            far.append(abs(foretold - now[3]) / now[3])
        law = now
    assert max(far) < 5e-3


def test_a_loaded_finger_that_slides_meets_no_jump():
    mesh = surface_mesh("plane", 2500)
    it, laws = SampledBody(basis(), mesh, YOUNG, 0.02, RADIUS, 1.0), []
    for x in np.linspace(-0.02, 0.02, 801):
        foot, n, nodes, push = at((x, 0.3 * x, 0.0), mesh=mesh)
        laws.append(it.step(nodes, 0.8 * push, foot, n, 1e-3))
    later = np.array(laws[200:])[:, 3]
    assert np.abs(np.diff(later)).max() < 0.01 * later.mean()


@pytest.mark.parametrize("force", [30.0, 1e4, 1e12])
def test_extreme_loads_give_finite_bounded_results(force):
    foot, n, nodes, push = at()
    it, rng = body(0.02), np.random.default_rng(7)
    limit = basis().points.limit
    for _ in range(60):
        pull = rng.standard_normal(3) * force
        law = it.step(nodes, np.outer(-push[:, 2], pull), foot, n, 1e-2)
        assert np.isfinite(law).all() and law[0] > 0
        assert it.q @ it.q < 4.0 * limit
        assert np.isfinite(it.displaced(foot)[1]).all()
        assert it.evaluations <= 14
    for _ in range(3000):
        law = it.step(nodes[:0], push[:0], foot, n, 1e-2)
    assert np.abs(it.q).max() == 0.0 and law[3] == 0.0


def test_the_derivatives_of_the_barrier_and_of_gamma_are_right():
    h = 1e-7
    for square in (0.5, 1.5, 3.0):
        _, first, second = barrier(square, 1.0)
        up, down = barrier(square + h, 1.0), barrier(square - h, 1.0)
        assert (up[0] - down[0]) / (2 * h) == approx(first, abs=1e-6)
        assert (up[1] - down[1]) / (2 * h) == approx(second, abs=1e-5)
    assert barrier(4.0, 1.0)[0] == np.inf
    for power in (0.0, 0.5, 2.0):
        for w in (0.7, 3.5):
            slope = (gamma((w + h) ** 2, 0.4, power, 3.0)[0] - gamma((w - h) ** 2, 0.4, power, 3.0)[0]) / (2 * h)
            assert gamma(w * w, 0.4, power, 3.0)[1] * w == approx(slope, rel=1e-6)
        pull = np.array([gamma(x * x, 0.4, power, 3.0)[0] * x for x in np.linspace(0, 5, 51)])
        assert (np.diff(pull)[:30] > 0).all() and np.diff(pull)[30:] == approx(0.0, abs=1e-12)


def test_the_bend_of_known_data_is_found():
    w = np.geomspace(1e-3, 1.0, 60)
    pull = np.array([gamma(x * x, 0.05, 0.3, np.inf)[0] for x in w]) * w
    parameters = fit_gamma(w, pull, 1.0 / pull)
    again = np.array([gamma(x * x, *parameters, np.inf)[0] for x in w]) * w
    assert again == approx(pull, rel=0.05)


def test_a_stored_basis_keeps_its_numbers_and_a_damaged_one_is_refused(tmp_path):
    path = tmp_path / "basis.npz"
    basis().save(path)
    back = SampledBasis.load(path)
    foot, n, nodes, push = at()
    it = SampledBody(back, slab().surface, YOUNG, 0.0, RADIUS, 1.0)
    assert settled(it, foot, n, nodes, push, 0.8)[3] == approx(settled(body(), foot, n, nodes, push, 0.8)[3], rel=1e-3)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(ArchiveError, match="palpate build basis"):
        SampledBasis.load(path)


def test_the_node_receives_a_load_and_sends_a_surface_at_any_pose(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    indentations = []
    for turn in ((0.0, 0.0, 0.0), (0.4, -0.3, 0.2)):
        node = ReducedFE(
            surface="plane", coarse=80, vertices=900, model="sampled", modes=16, young=YOUNG, rotation=turn,
            radius=RADIUS, retardation=0.0,
        )  # fmt: skip
        basis().save(tmp_path / "palpate/bases" / node.filename())
        bus, mesh = FakeBus(node), node.mesh()
        middle = int(np.argmin(np.linalg.norm(mesh.vertices - np.array(node.position), axis=1)))
        foot, n = mesh.vertices[middle], mesh.normals[middle]
        q = np.linalg.norm(mesh.vertices - foot, axis=1) / RADIUS
        nodes = np.flatnonzero(q < 1)
        share = (1 - q[nodes] ** 2) ** 2
        load = Load(nodes=nodes, forces=np.outer(share / share.sum(), -0.8 * n), foot=tuple(foot), normal=tuple(n))
        (empty,) = bus.publish(Load(nodes=[], forces=np.zeros((0, 3)), foot=tuple(foot), normal=tuple(n)))
        assert (
            empty.previous_indentation == 0.0
            and empty.rest_indentation == 0.0
            and np.abs(empty.displacement).max() == 0.0
        )
        last = bus.publish(*[load] * 6)[-1]
        assert last.stiffness > 0 and 1 <= last.exponent <= 3
        assert (last.displacement @ n).min() < -1e-3
        indentations.append(last.previous_indentation)
    assert indentations[1] == approx(indentations[0], rel=1e-3)


def test_a_missing_basis_is_an_error_with_the_command_to_build_it(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(
        SettingError, match="palpate build basis --set model=sampled --set modes=17 --set surface=fingertip"
    ):
        FakeBus(ReducedFE(surface="fingertip", model="sampled", modes=17))


def test_the_fingertip_has_its_shape_and_light_touches_are_linear():
    finger = FingertipDimensions(cells=CELLS)
    assert finger.radii[-1] == approx(FINGER_RADIUS) and finger.phalanx == approx(FINGER_LENGTH)
    full = of_finger(finger)
    smooth = surface_patch("fingertip")
    foot = ClosestPoint(smooth).find(full.surface.vertices)[0]
    inner = full.surface.vertices[:, 1] > -0.99 * FINGER_LENGTH
    assert foot[inner] == approx(full.surface.vertices[inner], abs=1e-8)
    side = mirror(full.mesh.points)
    assert (full.fixed[side] == full.fixed).all()


def test_a_touch_of_the_fingertip_replays_in_every_placement(tmp_path):
    streams = []
    for place in ("fused", None):
        file = tmp_path / f"{place}.mcap"
        sets = ("scene.hand.begin=[0, 0, 0.1085]", "scene.surface.vertices=1200")
        run = find("fingertip").but(record=file, duration=0.35, overrides=sets, **({"place": place} if place else {}))
        assert execute(run).result.ok
        payloads = {}
        for name, _, payload in Recording(file).payloads():
            payloads.setdefault(name, []).append(payload)
        streams.append(payloads)
    assert len(streams[0]["tissue"]) == 350
    assert streams[0] == streams[1]


def test_mirrored_points_are_found_and_an_asymmetric_body_is_an_error():
    points = np.array([[0.0, 1, 0], [2.0, 0, 0], [-2.0, 0, 0]])
    assert mirror(points).tolist() == [0, 2, 1]
    with pytest.raises(ValueError, match="symmetric"):
        mirror(points[:2])
