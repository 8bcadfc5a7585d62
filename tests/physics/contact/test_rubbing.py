"""Friction of two bodies on each other (physics.contact.organs.rubbing)."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

from palpate.physics.contact.organs import between
from palpate.physics.contact.organs.rubbing import rubbing, step_rubbing

SIZE, DT = 12, 1e-3
UP = np.tile((0.0, 0.0, 1.0), (SIZE, 1))
TANGENTS = np.stack([np.tile((1.0, 0.0, 0.0), (SIZE, 1)), np.tile((0.0, 1.0, 0.0), (SIZE, 1))])


def body(rng, stiff):
    """A random compliance of n, t_1 and t_2 forces and displacements, symmetric positive definite (3m,3m) [m/N]."""
    root = rng.standard_normal((3 * SIZE, 3 * SIZE))
    whole = 1e-4 / stiff * (root @ root.T / SIZE + 0.5 * np.eye(3 * SIZE))
    return whole[:SIZE, :SIZE], whole[:, SIZE:]


def pair_of(rng, mu, bristles=1e4, viscous=0.0, taus=(0.02, 0.005), tangents=TANGENTS):
    (one, drag), (other, drags) = body(rng, 1.0), body(rng, 3.0)
    signs = np.repeat((-1.0, 1.0, 1.0), SIZE)[:, None]
    made = between.pair(rng.uniform(0, 2e-4, SIZE), one, other, taus)
    return made, rubbing(tangents, drag, signs * drags, mu, bristles, viscous)


def run(made, rub, motions, pressed):
    """Steps with the first foundation carried by each motion [m] (n,3), and the candidates closed by `pressed` [m] (n).
    Returns forces on the first body (n,3), normal forces (n), and the work of the friction on both surfaces (n)."""
    forces, normals, works = [], [], []
    for carried, depth in zip(motions, pressed, strict=True):
        others = np.stack([np.full(SIZE, -depth), np.zeros(SIZE)])
        between.step_pair(made, others, DT, 10_000)
        rub.carried[:] = carried
        before = rub.moved.copy()
        step_rubbing(made, rub, DT)
        by = (rub.moved - before).reshape(2, 2, SIZE)
        relative = by[0] - by[1] + np.einsum("ami,i->am", rub.tangents[0], carried)
        along = np.einsum("mi,ami->am", rub.force[0], rub.tangents[0])
        works.append(float((along * relative).sum()))
        forces.append(rub.force[0].sum(axis=0))
        normals.append(made.active.force.sum())
    return np.array(forces), np.array(normals), np.array(works)


def random_motion(rng, steps):
    """Random slides between 1 um and 30 mm with stops, and random presses that also part [m]."""
    size, turn = 10.0 ** rng.uniform(-6, -1.5), rng.uniform(0, 2 * np.pi, 2)
    t = np.arange(steps) * 2 * np.pi / steps
    way = size * np.stack([np.sin(t + turn[0]), 0.5 * np.sin(2 * t + turn[1]), 0.1 * np.cos(t)], axis=1)
    held = rng.uniform(0, 1, steps) < 0.2
    moves = np.where(held[:, None], 0.0, np.diff(way, axis=0, prepend=way[:1]))
    return moves, 3e-4 * np.sin(rng.uniform(1, 4) * t + rng.uniform(0, 6)) + rng.uniform(-1e-4, 4e-4)


RUNS = 200


def test_random_slides_neither_exceed_the_limit_nor_generate_energy():
    """Work on the surfaces plus the energy that bristles store and lose is zero; the loss never falls."""
    rng, slid = np.random.default_rng(3), 0
    for _ in range(RUNS):
        mu, viscous = 10.0 ** rng.uniform(-2, 0.3), float(rng.choice([0.0, 1.0, 30.0]))
        made, rub = pair_of(rng, mu, 10.0 ** rng.uniform(2, 6), viscous, 10.0 ** rng.uniform(-4, -1, 2))
        moves, pressed = random_motion(rng, 120)
        lost = []
        works = []
        for move, depth in zip(moves, pressed, strict=True):
            force, normal, work = run(made, rub, [move], [depth])
            works.append(work[0])
            film = viscous * normal[0] * rub.speed
            rounding = 1e-12 * (np.linalg.norm(film) + mu * normal[0])
            assert np.linalg.norm(rub.total - film) <= mu * normal[0] + rounding
            assert force[0] == approx(-rub.total, rel=1e-9, abs=1e-12)
            lost.append(rub.balance["dissipated"][0])
        scale = max(lost[-1], 1e-12)
        assert np.diff(lost, prepend=0.0).min() >= -1e-12 * scale
        assert sum(works) + rub.balance["stored"][0] + lost[-1] == approx(0.0, abs=1e-9 * scale)
        slid += rub.balance["slipped"][0] > 1e-6
    assert slid > RUNS // 2


def test_on_a_curved_patch_each_candidate_keeps_its_limit_and_no_energy_is_generated():
    """Normals inclined by up to 40 degrees, pressed and dragged along any direction, with and without a film."""
    rng, inclined = np.random.default_rng(8), 0
    for _ in range(RUNS // 4):
        normals = UP + 0.84 * rng.uniform(-1, 1, (SIZE, 3)) * (1.0, 1.0, 0.0) / np.sqrt(2)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        across = np.cross(normals, rng.standard_normal((SIZE, 3)))
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        mu, viscous = 10.0 ** rng.uniform(-2, 0.3), float(rng.choice([0.0, 3.0]))
        made, rub = pair_of(rng, mu, 1e4, viscous, tangents=np.stack([across, np.cross(normals, across)]))
        moves, pressed = random_motion(rng, 60)
        lost, worked = 0.0, 0.0
        for move, depth in zip(moves + np.outer(np.gradient(pressed), (0.0, 0.0, 1.0)), pressed, strict=True):
            _, _, work = run(made, rub, [move], [depth])
            worked += work[0]
            mean = rub.speed - normals * (normals @ rub.speed)[:, None]
            p = made.active.force
            dry = np.linalg.norm(rub.force[0] + viscous * p[:, None] * mean, axis=1)
            assert (dry <= mu * p + 1e-9 * (p + np.linalg.norm(rub.force[0], axis=1))).all()
            inward = (rub.force[0] * normals).sum(axis=1)
            assert inward == approx(0.0, abs=1e-12 * (1.0 + np.abs(rub.force[0]).max()))
            assert rub.balance["dissipated"][0] >= lost * (1.0 - 1e-12)
            lost = rub.balance["dissipated"][0]
            inclined += abs(rub.speed[2]) > 0.1 * np.linalg.norm(rub.speed) > 0.0
        assert worked + rub.balance["stored"][0] + lost == approx(0.0, abs=1e-9 * max(lost, 1e-12))
    assert inclined > 100


def rotating(seed, mu, viscous, whole):
    """60 steps of bodies on an inclined patch that rotate by up to 0.3 rad per step, after a rotation `whole` (3,3) of
    all: friction on the first body (n,3), work on both surfaces and of the rigid motions (n), stored and lost (n,2)."""
    rng = np.random.default_rng(seed)
    normals = UP + 0.3 * rng.uniform(-1, 1, (SIZE, 3)) * (1.0, 1.0, 0.0)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    across = np.cross(normals, rng.standard_normal((SIZE, 3)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    made, rub = pair_of(rng, mu, 1e4, viscous, tangents=np.stack([across, np.cross(normals, across)]))
    moves, pressed = random_motion(rng, 60)
    turns = [Rotation.identity(), Rotation.identity()]
    pulls, works, kept = [], [], []
    for move, depth in zip(moves, pressed, strict=True):
        turns = [Rotation.from_rotvec(rng.uniform(-0.17, 0.17, 3)) * turn for turn in turns]
        between.step_pair(made, np.stack([np.full(SIZE, -depth), np.zeros(SIZE)]), DT, 10_000)
        rub.axes[:] = [whole @ turn.as_matrix() for turn in turns]
        rub.carried[:] = whole @ move
        before = rub.moved.copy()
        step_rubbing(made, rub, DT)
        by, along = (rub.moved - before).reshape(2, 2, SIZE), np.einsum("bmi,bami->bam", rub.force, rub.tangents)
        works.append(float((along * by).sum() + rub.pull @ (whole @ move)))
        pulls.append(rub.pull.copy())
        kept.append((rub.balance["stored"][0], rub.balance["dissipated"][0]))
        film = viscous * np.linalg.norm(rub.speed)
        assert (np.linalg.norm(rub.force, axis=2) <= (mu + film) * made.active.force * (1 + 1e-9) + 1e-15).all()
    return np.array(pulls), np.array(works), np.array(kept)


@pytest.mark.parametrize("viscous", [0.0, 3.0])
def test_bodies_that_rotate_get_no_energy_from_their_friction_and_its_frame_does_not_matter(viscous):
    whole, rubbed = Rotation.from_rotvec([1.0, -2.0, 0.5]).as_matrix(), 0.0
    for seed in range(20):
        pulls, works, kept = rotating(seed, 0.3, viscous, np.eye(3))
        scale = max(kept[-1, 1], 1e-12)
        np.testing.assert_allclose(np.cumsum(works) + kept.sum(axis=1), 0.0, atol=1e-9 * scale)
        assert np.diff(kept[:, 1], prepend=0.0).min() >= -1e-12 * scale
        others, again, _ = rotating(seed, 0.3, viscous, whole)
        largest = np.abs(pulls).max()
        np.testing.assert_allclose(others, pulls @ whole.T, atol=1e-8 * largest)
        np.testing.assert_allclose(again, works, atol=1e-8 * np.abs(works).max())
        rubbed += largest > 1e-3
    assert rubbed > 12


@pytest.mark.parametrize("axis, degrees, kept", [
    ((0.0, 0.0, 1.0), 180.0, False), ((0.0, 1.0, 0.0), 180.0, False), ((1.0, 0.0, 0.0), 180.0, False),
    ((0.0, 0.0, 1.0), 179.0, True), ((0.6, 0.0, 0.8), 120.0, True),
])  # fmt: skip
def test_bristles_that_a_turn_leaves_no_direction_lose_their_energy_to_the_balance(axis, degrees, kept):
    """The first body turns within one step, in which nothing else moves: about the normal, where the bristles cancel,
    and about axes along the surface, where the normals of the two bodies cancel. What was stored is lost then, not
    more; a smaller turn, also one that is nearly opposite, keeps it up to the work of that step."""
    made, rub = pair_of(np.random.default_rng(9), 0.5, 1e3, taus=(0.0, 0.0))
    _, _, works = run(made, rub, np.tile((1e-5, 0.0, 0.0), (30, 1)), np.full(30, 5e-4))
    worked, (stored, lost) = works.sum(), (float(rub.balance[name][0]) for name in ("stored", "dissipated"))
    assert stored > 1e-7 and worked + stored + lost == approx(0.0, abs=1e-12 * lost)
    rub.axes[0] = Rotation.from_rotvec(np.radians(degrees) * np.array(axis)).as_matrix()
    between.step_pair(made, np.stack([np.full(SIZE, -5e-4), np.zeros(SIZE)]), DT, 10_000)
    rub.carried[:] = 0.0
    before = rub.moved.copy()
    step_rubbing(made, rub, DT)
    by, along = (rub.moved - before).reshape(2, 2, SIZE), np.einsum("bmi,bami->bam", rub.force, rub.tangents)
    worked += float((along * by).sum())
    after, spent = float(rub.balance["stored"][0]), float(rub.balance["dissipated"][0])
    assert worked + after + spent == approx(0.0, abs=1e-12 * spent)
    if kept:
        assert rub.bristle @ rub.bristle > 0.0 and spent - lost < 0.5 * stored
    else:  # the bristles of this step are those of a body at rest
        assert spent - lost == approx(stored, rel=0.2) and after < 0.2 * stored


@pytest.mark.parametrize("degrees", [0.0, 10.0, 30.0])
def test_rigid_bodies_on_a_wedge_have_the_friction_of_the_parts_along_its_faces(degrees):
    """Half of the normal force on each face, (s, 0, c) and (-s, 0, c): the slide along the ridge has the limit mu N;
    across it the part mu N c^2, in which Coulomb's law for each face would be mu N c; the film has c c^4 N v."""
    s, c = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    faces = np.where(np.arange(SIZE) % 2 == 0, -1.0, 1.0)
    across = np.stack([np.full(SIZE, c), np.zeros(SIZE), -s * faces], axis=1)
    along = np.tile((0.0, 1.0, 0.0), (SIZE, 1))
    stiff = 1e-7 * np.eye(SIZE)
    drags = np.zeros((3 * SIZE, 2 * SIZE))
    for direction, share, film in (((0.0, 1.0, 0.0), 1.0, 1.0), ((1.0, 0.0, 0.0), c**2, c**4)):
        for viscous in (0.0, 2.0):
            made = between.pair(np.zeros(SIZE), stiff, stiff, (0.0, 0.0))
            rub = rubbing(np.stack([across, along]), drags, drags, 0.3, 1e6, viscous)
            forces, normals, _ = run(made, rub, np.tile(np.array(direction) * 1e-4, (50, 1)), np.full(50, 1e-6))
            expected = 0.3 * share * normals[-1] + viscous * film * normals[-1] * 0.1
            assert forces[-1] == approx(-expected * np.array(direction), rel=1e-9, abs=1e-9 * normals[-1])


def test_it_sticks_below_the_limit_with_the_stiffness_of_bodies_and_bristles_in_series():
    rng = np.random.default_rng(4)
    made, rub = pair_of(rng, 5.0, 2e3, taus=(0.0, 0.0))
    run(made, rub, np.zeros((3, 3)), np.full(3, 5e-4))
    step, before = np.array([1e-6, 0.0, 0.0]), rub.total.copy()
    run(made, rub, [step], [5e-4])
    p = made.active.force / made.active.force.sum()
    tt = rub.first[SIZE:] + rub.second[SIZE:]
    mean = np.array(
        [[p @ tt[b * SIZE : (b + 1) * SIZE, a * SIZE : (a + 1) * SIZE] @ p for a in (0, 1)] for b in (0, 1)]
    )
    expected = np.linalg.solve(mean + np.eye(2) / 2e3, step[:2])
    assert np.linalg.norm(before) > 0.0 and (rub.total - before)[:2] == approx(expected, rel=1e-6)


def test_a_slide_has_the_limit_against_its_motion_at_any_step():
    """Bodies without retardation dragged over 10 mm: the friction is mu N along the way, in 10 or 1000 steps."""
    for steps in (10, 1000):
        made, rub = pair_of(np.random.default_rng(5), 0.3, taus=(0.0, 0.0))
        run(made, rub, np.zeros((3, 3)), np.full(3, 5e-4))
        way = np.array([6e-3, 8e-3, 0.0])
        forces, normals, _ = run(made, rub, np.tile(way / steps, (steps, 1)), np.full(steps, 5e-4))
        assert np.linalg.norm(forces[-1]) == approx(0.3 * normals[-1], rel=1e-9)
        assert forces[-1] / np.linalg.norm(forces[-1]) == approx(-way / 1e-2, abs=2e-2)


def test_a_film_of_fluid_resists_in_proportion_to_the_speed():
    made, rub = pair_of(np.random.default_rng(6), 1e-9, viscous=0.2, taus=(0.0, 0.0))
    run(made, rub, np.zeros((3, 3)), np.full(3, 5e-4))
    for speed in (1e-3, 1e-2, 1e-1):
        forces, normals, _ = run(made, rub, np.tile((speed * DT, 0, 0), (400, 1)), np.full(400, 5e-4))
        assert forces[-1][0] == approx(-0.2 * normals[-1] * speed, rel=1e-3)


@pytest.mark.parametrize("viscous", [0.0, 1.0])
def test_bodies_that_part_forget_the_bristles(viscous):
    made, rub = pair_of(np.random.default_rng(7), 0.5, viscous=viscous)
    run(made, rub, np.tile((1e-5, 0, 0), (20, 1)), np.full(20, 5e-4))
    stored, lost = (float(rub.balance[name][0]) for name in ("stored", "dissipated"))
    assert np.linalg.norm(rub.total) > 0.0 and stored > 0.0
    run(made, rub, np.zeros((1, 3)), [-1e-2])
    assert not made.active.force.any()
    assert not rub.force.any() and not rub.bristle.any() and rub.balance["stored"][0] == 0.0
    assert rub.balance["dissipated"][0] - lost == approx(stored, rel=1e-12)
