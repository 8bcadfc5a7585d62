"""Several contacts on an elastic foundation of beams."""

import numpy as np

from palpate.nodes.base.surface import surface_mesh
from palpate.physics.bodies.beam_foundation import answer, beam_foundation, bear
from palpate.physics.contact.terminal import Terminal, check_law
from palpate.physics.geometry.mesh import Mesh
from palpate.physics.materials.voigt import ViscoelasticMaterial

RADIUS, BALL, STEP, SMALL = 8e-3, 20e-3, 2e-4, 1e-3  # [m] [m] [s] [N]


def ball():
    """A ball with beams of 10 mm, for two contacts."""
    sphere = surface_mesh("sphere", 2500)
    mesh = Mesh(np.ascontiguousarray(sphere.vertices * (BALL / np.linalg.norm(sphere.vertices[0]))), sphere.triangles)
    materials = (ViscoelasticMaterial(1.36e5, 12.6e-3), ViscoelasticMaterial(3.4e4, 12.6e-3))
    return mesh, beam_foundation(mesh, None, (1e-3, 9e-3), materials, RADIUS, 2)


def copied(tree):
    """A foundation with its arrays copied."""
    if isinstance(tree, np.ndarray):
        return tree.copy()
    if hasattr(tree, "_fields"):
        return type(tree)(*map(copied, tree))
    return tuple(map(copied, tree)) if isinstance(tree, tuple) else tree


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def indent(mesh, foundation, fingers, forces):
    """Indentations [m] (2) after a step under two fingers, (foot, normal, friction over normal force) (3) each."""
    for i, ((foot, normal, rubs), force) in enumerate(zip(fingers, forces, strict=True)):
        far = np.linalg.norm(mesh.vertices - foot, axis=1)
        nodes = np.flatnonzero(far < RADIUS).astype(np.int32)
        share = mesh.areas[nodes] * (1.0 - (far[nodes] / RADIUS) ** 2) ** 2
        bear(foundation, i, nodes, force * (share / share.sum())[:, None] * (rubs - normal), foot, normal)
    answer(foundation, STEP)
    return foundation.contacts.laws[:, 4].copy()


def test_two_fingers_that_rub_the_same_beams_do_not_alternate():
    """An error of the forces becomes I - A^-1 B times as large in the next step, with A the compliance of the laws and
    B that of beams under forces whose friction grows with them, by differences. With an eigenvalue below -1 the forces
    alternate: laws without the other finger's friction had -1.56."""
    mesh, start = ball()
    rng, least = np.random.default_rng(1), []
    for _ in range(40):
        foundation = copied(start)
        feet = BALL * unit(np.column_stack([rng.uniform(-3e-3, 3e-3, (2, 2)), [BALL, BALL]]))
        normals = unit(feet / BALL + 0.6 * rng.normal(size=(2, 3)))
        rubs = 0.6 * unit(np.cross(normals, rng.normal(size=(2, 3))))
        fingers, forces = list(zip(feet, normals, rubs, strict=True)), rng.uniform(0.5, 2.0, 2)
        for _ in range(100):
            indent(mesh, foundation, fingers, forces)
        stiffness, exponent = foundation.contacts.laws.T[:2].copy()
        acting = foundation.contacts.coupling @ forces
        slope = stiffness * exponent * (acting / stiffness) ** (1.0 - 1.0 / exponent)
        laws = foundation.contacts.coupling / slope[:, None]
        more, less = (
            np.array([indent(mesh, copied(foundation), fingers, forces + by) for by in sign * SMALL * np.eye(2)])
            for sign in (1.0, -1.0)
        )
        beams = (more - less).T / (2.0 * SMALL)
        least.append(np.linalg.eigvals(np.eye(2) - np.linalg.solve(laws, beams)).real.min())
    assert min(least) > -0.5, least


def test_the_law_of_a_finger_that_rubs_predicts_the_next_step():
    """Under one finger, and under two on the same beams of which one presses lightly. The laws were softer than the
    beams and began at the free indentation, so that they predicted up to twice the indentation; two fingers on a bumpy
    body then exchanged 0.5 N in each step."""
    mesh, start = ball()
    rng, worst = np.random.default_rng(2), 0.0
    for trial in range(60):
        foundation = copied(start)
        feet = BALL * unit(np.column_stack([rng.uniform(-3e-3, 3e-3, (2, 2)), [BALL, BALL]]))
        normals = unit(feet / BALL + 0.6 * rng.normal(size=(2, 3)))
        rubs = rng.uniform(0.1, 0.8) * unit(np.cross(normals, rng.normal(size=(2, 3))))
        forces = np.exp(rng.uniform(np.log(0.1), np.log(2.0), 2)) * (1.0, float(trial % 2))
        fingers = list(zip(feet, normals, rubs, strict=True))
        for _ in range(1 + trial):
            indent(mesh, foundation, fingers, forces)
        stiffness, exponent, _, free = foundation.contacts.laws.T[:4].copy()
        predicted = free + ((foundation.contacts.coupling @ forces) / stiffness) ** (1.0 / exponent)
        limited, found = foundation.moving.sent[1], indent(mesh, foundation, fingers, forces)
        if not limited:
            miss = np.abs(predicted - found) / np.maximum(np.abs(found), 1e-4)
            worst = max(worst, float(miss[forces > 0.0].max()))
    assert worst < 1e-9


def test_laws_of_absurd_forces_are_valid():
    mesh, start = ball()
    rng = np.random.default_rng(3)
    for force in (1e2, 1e4, 1e6, 1e9):
        foundation = copied(start)
        feet = BALL * unit(np.column_stack([rng.uniform(-3e-3, 3e-3, (2, 2)), [BALL, BALL]]))
        rubs = 100.0 * unit(np.cross(feet, rng.normal(size=(2, 3))))
        fingers = list(zip(feet, unit(feet), rubs, strict=True))
        for _ in range(20):
            indent(mesh, foundation, fingers, (force, 1.0))
            for law in foundation.contacts.laws.tolist():
                check_law(Terminal(*law))


def test_a_finger_in_the_air_next_to_one_that_rubs_has_the_law_of_its_patch():
    """Of the few beams that both share friction moves some. Its law was extrapolated from there to the least force, up
    to 50 000 times as far: as soft as 3e-5 N/m³, with an indentation of 36 mm in the air; a finger that landed felt
    nothing at first."""
    mesh, start = ball()
    alone, light, checked = copied(start), 0.02, 0
    feet = BALL * np.array([[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
    indent(mesh, alone, [(foot, foot / BALL, np.zeros(3)) for foot in feet], (0.0, 0.0))
    stiffness, power = alone.contacts.laws[1, :2]
    for apart, rub in [(a, r) for a in np.linspace(0.7, 0.835, 28) for r in (-0.5, 0.5)]:
        turn = 2.0 * RADIUS * apart / BALL
        feet, foundation = BALL * np.array([[0.0, 0.0, 1.0], [np.sin(turn), 0.0, np.cos(turn)]]), copied(start)
        rubs = np.array([[rub, 0.0, 0.0], [0.0, 0.0, 0.0]])
        for _ in range(100):
            indent(mesh, foundation, list(zip(feet, feet / BALL, rubs, strict=True)), (4.0, 0.0))
        (k, n, _, free, _), effect = foundation.contacts.laws[1], foundation.contacts.coupling[1, 0] * 4.0
        if not 0.0 < effect < 1e-3:
            continue
        checked += 1
        assert abs(free + (effect / k) ** (1.0 / n)) < 0.5e-3
        assert 0.7 < (light / k) ** (1.0 / n) / (light / stiffness) ** (1.0 / power) < 1.5
    assert checked > 5
