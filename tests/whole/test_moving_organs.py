"""Organs that move with their foundations: the scene's key `motions`."""

import json

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation
from streams import read

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Force, Friction, Ledger, Pose, Surface
from palpate.messages.contact import OrganContact
from palpate.messages.tissue import Support
from palpate.nodes.contact import Between
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.studies.organ_pairs import support_at
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.moments import bodies_of, instants

SIZE = ("scene.surface.vertices=2000", "scene.energy.ledger=true")
AMPLITUDE, PERIOD = np.array([3e-3, -2e-3, 5e-3]), 0.4
BREATH = (
    "scene.motions={breathing: {moves: [tissue], amplitude: [3 mm, -2 mm, 5 mm], period: 0.4 s, waveform: breathing}}"
)
GIVEN = ("finger.use=device.RecordedPose", "finger.in.state=null")


def run(path, *overrides, graph="kidney", place="fused", duration=0.5):
    launch = find(graph).but(duration=duration, record=path, place=place, overrides=(*SIZE, *overrides))
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


def breath(time):
    """The law of Lujan et al. (1999) with n = 2, independently of the node."""
    return AMPLITUDE * ((1.0 - np.cos(2.0 * np.pi * np.asarray(time) / PERIOD)) / 2.0)[:, None] ** 2


def table(path, places):
    lines = [f"{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(places.tolist())]
    path.write_text("\n".join(["t [ms],x [m],y [m],z [m]", *lines]))
    return path


@pytest.mark.parametrize("body", ["MassSpring", "BeamBundle", "ReducedFE", "Rigid"])
@pytest.mark.notes
def test_an_organ_that_moves_under_the_finger_feels_as_one_at_rest_under_the_opposite_motion(body, tmp_path):
    """G. Galilei: forces depend on the relative motion only. In one run the organ moves by d, and the finger by its
    path and d; in the other the finger moves by its path."""
    time = np.arange(400) / 1000.0
    path = np.array([0.0, 0.0, 0.1075]) + np.stack([20e-3 * time, 0.0 * time, -6e-3 * np.sin(8.0 * time)], axis=1)
    both = []
    for name, places, sets in (("still", path, ()), ("moving", path + breath(time), (BREATH,))):
        given = table(tmp_path / f"{name}.csv", places)
        sets = (f"tissue.use=deformation.{body}", *GIVEN, f"finger.path={given}", *sets)
        found = run(tmp_path / f"{name}.mcap", *sets, duration=0.4)
        both.append(read(found, contact=Contact, friction=Friction, controller=Force, finger=Pose))
    (still, rubbed, hand, path), (contacts, frictions, hands, poses) = both
    assert max(each.force for each in still) > 0.3
    apart = [np.subtract(one.position, other.position) for one, other in zip(poses, path, strict=True)]
    assert np.linalg.norm(apart, axis=1).max() > 6e-3
    for one, other in ((still, contacts), (rubbed, frictions), (hand, hands)):
        one, other = (np.array([each.force for each in every]) for every in (one, other))
        np.testing.assert_allclose(other, one, rtol=1e-6, atol=1e-6 * np.abs(one).max())


TURN, PIVOT = np.array([0.25, -0.15, 0.3]), np.array([0.01, 0.02, 0.07])
TURNS = (
    "scene.motions={breathing: {moves: [tissue], amplitude: [3 mm, -2 mm, 5 mm], period: 0.4 s, waveform: breathing, "
    "rotation: [0.25, -0.15, 0.3], pivot: [0.01, 0.02, 0.07]}}"
)


@pytest.mark.parametrize("body", ["MassSpring", "ReducedFE"])
@pytest.mark.notes
def test_an_organ_that_turns_under_the_finger_feels_as_one_at_rest_under_the_opposite_motion(body, tmp_path):
    """In one run the finger moves by p, in the other the organ by x -> c + R(r w) (x - c) + d w with the finger at
    p in its frame: the same contact, and the force on the hand turned by R."""
    time = np.arange(300) / 1000.0
    path = np.array([0.0, 0.0, 0.1075]) + np.stack([20e-3 * time, 0.0 * time, -6e-3 * np.sin(8.0 * time)], axis=1)
    share = breath(time) / AMPLITUDE
    turn = Rotation.from_rotvec(TURN * share)
    both = []
    for name, places, sets in (
        ("still", path, ()),
        ("moving", PIVOT + turn.apply(path - PIVOT) + breath(time), (TURNS,)),
    ):
        given = table(tmp_path / f"{name}.csv", places)
        sets = (f"tissue.use=deformation.{body}", *GIVEN, f"finger.path={given}", *sets)
        both.append(run(tmp_path / f"{name}.mcap", *sets, duration=0.3))
    still, rubbed, hand = read(both[0], contact=Contact, friction=Friction, controller=Force)
    contacts, frictions, hands, supports = read(
        both[1], contact=Contact, friction=Friction, controller_world=Force, breathing=Support
    )
    assert max(each.force for each in still) > 0.3 and np.degrees(np.abs(TURN * share[-1]).max()) > 4.0
    np.testing.assert_allclose([each.rotation for each in supports], TURN * share, atol=1e-12)
    want = turn.apply([each.force for each in hand])
    for found, expected in (
        ([each.force for each in contacts], [each.force for each in still]),
        ([each.force for each in frictions], [each.force for each in rubbed]),
        ([each.force for each in hands], want),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=2e-5 * np.abs(expected).max())


def test_the_ledger_counts_the_work_of_a_foundation_that_turns(tmp_path):
    """Work of the hand in the world from forces and poses; hand and foundation give what the parts receive."""
    hold = "scene.hand.path=[{to: [0, 0, 0.1015], time: 0.15}, {hold: 0.9}]"
    books, forces, poses = read(
        run(tmp_path / "turns.mcap", TURNS, hold, duration=0.5), ledger=Ledger, controller_world=Force, finger=Pose
    )
    force, way = (np.array([getattr(each, name) for each in every])
                  for every, name in ((forces, "force"), (poses, "position")))  # fmt: skip
    hand = -np.cumsum(np.sum(force[:-1] * np.diff(way, axis=0), axis=1))
    np.testing.assert_allclose([each.hand for each in books[1:]], hand, atol=2e-9)
    assert abs(books[-1].carried[0]) > 1e-4 and max(each.generated for each in books) < 1e-4
    assert_books_close(books[-1])


def test_turned_foundations_move_a_contact_of_organs_as_rigid_bodies():
    """Both turned together: the same forces, turned. One turned about the middle of its ball: as an organ at rest,
    to the coarseness of the cells."""
    still, turned = winkler(), winkler()
    rise, turn = np.array([0.0, 0.0, 3e-3]), Rotation.from_rotvec([0.3, -0.5, 0.8])
    centre = np.array([0.01, 0.0, 0.02])

    def support(way, rotation):
        return [Support(displacement=tuple(way), velocity=(0.0, 0.0, 0.0), rotation=rotation.as_rotvec(),
                        spin=np.zeros(3), centre=centre)]  # fmt: skip

    for share in np.linspace(0.0, 1.0, 60):
        part = Rotation.from_rotvec(share * turn.as_rotvec())
        one = still.step([], [], second_support=support_at(share * rise), dt=1e-3)
        other = turned.step([], [], support(np.zeros(3), part), support(part.apply(share * rise), part), dt=1e-3)
        np.testing.assert_allclose(other.resultant, part.apply(one.resultant), rtol=1e-9, atol=1e-12)
    assert one.force > 0.1 and other.force == approx(one.force, rel=1e-9)
    assert other.carried[0] == approx(one.carried[0], rel=1e-3) and len(other.torques) == 2


def test_a_rigid_organ_that_rises_against_a_finger_at_rest_compresses_it_by_the_closed_form(tmp_path):
    """f = b/m (exp(m s) - 1) with s = h0 - gap + d_z, without damping of the fingertip."""
    time = np.arange(400) / 1000.0
    given = table(tmp_path / "still.csv", np.broadcast_to([0.0, 0.0, 0.1095], (400, 3)))
    rise = "scene.motions={push: {moves: [tissue], path: [{to: [0, 0, 0.002], time: 0.3}]}}"
    flat = ("scene.surface.surface=plane", "scene.surface.position=[0, 0, 0.105]", "scene.finger.finger_damping=0")
    sets = ("tissue.use=deformation.Rigid", *flat, *GIVEN, f"finger.path={given}", rise)
    (contacts,) = read(run(tmp_path / "rise.mcap", *sets, duration=0.4), contact=Contact)
    s = np.clip(time / 0.3, 0.0, 1.0)
    depth = np.maximum(2e-3 * s**3 * (10.0 - 15.0 * s + 6.0 * s * s) - 0.5e-3, 0.0)
    expected = 26.2641 / 1681.06 * np.expm1(1681.06 * depth)
    assert expected.max() > 0.1
    np.testing.assert_allclose([each.force for each in contacts], expected, rtol=1e-4, atol=1e-6)


def assert_books_close(last):
    """The work of hand and foundation is in the parts."""
    parts = sum(
        getattr(last, f"{part}_{what}")
        for part in ("fingertip", "tissue", "friction") for what in ("stored", "dissipated")
    )  # fmt: skip
    total = last.controller + last.sampling + parts + last.unexplained
    assert last.hand + last.carried[0] == approx(total, abs=1e-9)


@pytest.fixture(scope="module")
def breathing(tmp_path_factory):
    hold = "scene.hand.path=[{to: [0, 0, 0.1015], time: 0.15}, {hold: 0.9}]"
    return run(tmp_path_factory.mktemp("breathing") / "one.mcap", BREATH, hold, duration=0.8)


def test_the_ledger_counts_the_work_of_the_foundation_and_no_part_generates_energy(breathing):
    """Work of hand and foundation from the recorded forces, poses and displacements, in the frame of the world."""
    books, forces, poses, supports = read(breathing, ledger=Ledger, controller=Force, finger=Pose, breathing=Support)
    force = np.array([each.force for each in forces])
    way = np.array([each.position for each in poses])
    moved = np.array([each.displacement for each in supports])
    np.testing.assert_allclose(moved, breath(np.arange(len(moved)) / 1000.0), atol=1e-12)
    hand = -np.cumsum(np.sum(force[:-1] * np.diff(way, axis=0), axis=1))
    carried = np.cumsum(np.sum(force[:-1] * np.diff(moved, axis=0), axis=1))
    np.testing.assert_allclose([each.hand for each in books[1:]], hand, atol=1e-9)
    np.testing.assert_allclose([each.carried[0] for each in books[1:]], carried, atol=1e-9)
    assert np.ptp(carried) > 1e-3
    assert_books_close(books[-1])
    assert max(each.generated for each in books) < 1e-4 and not books[-1].tripped


def test_the_force_on_the_hand_has_no_jump_while_the_organ_breathes(breathing):
    """The fingertip is stiffer than both in series: with f = b/m (exp(m s) - 1), df/ds = b + m f."""
    forces, poses, supports = read(breathing, controller=Force, finger=Pose, breathing=Support)
    force, way, moved = (
        np.array([getattr(each, name) for each in every])
        for every, name in ((forces, "force"), (poses, "position"), (supports, "displacement"))
    )
    size, steps = np.linalg.norm(force, axis=1), np.linalg.norm(np.diff(way - moved, axis=0), axis=1)
    assert size.max() > 1.0
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)
    assert change.max() < (26.2641 + 1681.06 * size.max()) * steps.max()
    assert change.max() < 0.15  # [N] and 0.09 N at rest, while the hand alone moves by 80 mm/s


def test_pictures_show_organ_and_finger_where_they_are(breathing):
    touch = TouchStreams(breathing, whole=True)
    found = bodies_of(touch)
    for each in instants(touch, found, 3):
        far = np.linalg.norm(each.displacement - breath([each.time])[0], axis=1)
        assert np.median(far) < 1e-9  # most of the surface is not deformed
        tip = each.tips[0] - breath([each.time])[0]
        assert abs(tip[0]) < 4e-3 and 0.098 < tip[2] < 0.106


def test_it_replays_and_runs_in_processes_with_the_same_bytes(breathing, tmp_path):
    report = verify(breathing, plan_of(breathing), tolerance=0.0)
    assert report.ok, report
    hold = "scene.hand.path=[{to: [0, 0, 0.1015], time: 0.15}, {hold: 0.9}]"
    apart = run(tmp_path / "apart.mcap", BREATH, hold, place="apart", duration=0.2)
    ours = {(name, tick): payload for name, tick, payload in apart.payloads()}
    theirs = {(name, tick): payload for name, tick, payload in breathing.payloads()}
    assert len(ours) > 1000 and all(theirs[key] == payload for key, payload in ours.items())


def winkler(friction=0.0):
    """Two balls of 42 mm, 1 mm apart, on independent springs of the same stiffness without retardation."""
    bodies = []
    for height in (0.0, 43e-3):
        surface = {"surface": "sphere", "vertices": 2000, "position": (0.0, 0.0, height)}
        settings = {"stiffness": 300.0, "exponent": 1.0, "damping": 0.0, "retardation": 0.0} | surface
        bodies.append({"use": "MassSpring", "settings": settings, "surface": surface})
    node = Between(bodies=json.dumps(bodies[::-1]), friction=friction, cells=300)
    node.start()
    return node


def test_a_foundation_that_rises_closes_the_gap_of_two_organs_and_does_the_work_of_their_springs():
    """Independent springs in series: p = <d.n - g>/C of each cell, and the energy p²C/2."""
    node = winkler()
    gap, normal = node._held["rest"].copy(), node._held["normals"].copy()
    soft = np.diag(node._held["pair.first"]) + np.diag(node._held["pair.second"])
    for share in np.linspace(0.0, 1.0, 2001):
        answer = node.step([], [], second_support=support_at(np.array([0.0, 0.0, 3e-3 * share])), dt=1e-3)
    force = np.maximum(-(gap - 3e-3 * normal[:, 2]), 0.0) / soft
    assert answer.force == approx(force.sum(), rel=1e-9) and force.sum() > 0.1
    stored = 0.5 * np.sum(soft * force**2)
    assert answer.carried[0] == approx(stored, rel=2e-3)  # the work of the last step of each cell's force
    assert answer.carried[0] > stored + answer.dissipated and answer.generated < 1e-15


def test_only_the_motion_of_two_foundations_against_each_other_matters():
    one, two, both = winkler(0.3), winkler(0.3), winkler(0.3)
    rng, way = np.random.default_rng(3), np.zeros(3)
    for _ in range(60):
        way = way + rng.uniform([-5e-5, -5e-5, 0.0], [5e-5, 5e-5, 1e-4])
        other = rng.uniform(-1e-2, 1e-2, 3)
        answers = (
            one.step([], [], second_support=support_at(way), dt=1e-3),
            two.step([], [], first_support=support_at(-way), dt=1e-3),
            both.step([], [], first_support=support_at(other), second_support=support_at(other + way), dt=1e-3),
        )
        for answer in answers[1:]:
            np.testing.assert_allclose(answer.resultant, answers[0].resultant, rtol=1e-9, atol=1e-12)
    assert answers[0].force > 0.1 and np.linalg.norm(answers[0].friction) > 0.01


def test_a_foundation_presses_one_organ_into_another_and_the_ledger_has_its_work(tmp_path):
    """The kidney rises by 4 mm against the ball, then the finger touches the ball. Work of the foundation from the
    recorded forces between the organs; before the touch it is all that the organs store and lose."""
    quick = (
        "scene.liver-surface.vertices=2000",
        "scene.hand.path=[{hold: 0.15}, {to: [0, 0, 0.143], time: 0.15}, {to: [0, 0, 0.160], time: 0.1}]",
    )
    push = "scene.motions={push: {moves: [kidney], path: [{to: [0, 0, 0.004], time: 0.1}]}}"
    found = run(tmp_path / "push.mcap", *quick, push, graph="neighbours", duration=0.42)
    books, between, supports, livers, kidneys = read(
        found, ledger=Ledger, between=OrganContact, push=Support, liver=Surface, kidney=Surface
    )
    force = np.array([each.resultant for each in between])
    moved = np.array([each.displacement for each in supports])
    work = np.cumsum(np.sum(force[1:] * np.diff(moved, axis=0), axis=1))  # the second body's, against -R
    carried = np.array([each.carried[0] for each in books[1:]])
    np.testing.assert_allclose(carried, work, rtol=1e-9, atol=1e-12)
    at = 150
    stored = livers[at].stored[0] + kidneys[at].stored[0]
    assert books[at].tissue_stored == stored and 0.0 < stored < carried[at - 1]
    assert books[at].tissue_stored + books[at].tissue_dissipated == approx(carried[at - 1], rel=1e-9)
    assert max(each.force for each in between) > 0.5 and max(each.generated for each in books) < 1e-4
    assert_books_close(books[-1])


@pytest.mark.notes("without friction")
def test_the_ledger_keeps_what_a_contact_of_organs_did_before_it_was_restarted():
    """The kidney has risen by 4 mm against the ball when their contact restarts; the first 0.3 mJ of the foundation
    remain in the balance."""
    sets = [
        *SIZE, "scene.liver-surface.vertices=2000", "scene.hand.path=[{hold: 1}]",
        "scene.motions={push: {moves: [kidney], path: [{to: [0, 0, 0.004], time: 0.1}]}}",
    ]  # fmt: skip
    totals, ledgers = [], []
    for tick in palpate.steps("neighbours", duration=0.3, sets=sets):
        totals.append(tick["between"])
        ledgers.append(tick["ledger"])
        if len(totals) == 200:
            tick.set("between", reach=tick.settings("between")["reach"])
    before, after = totals[199], totals[-1]
    assert (before.steps, after.steps) == (200, len(totals) - 200) and before.carried[0] > 2e-4
    assert ledgers[199].carried[0] == approx(before.carried[0], rel=1e-12)
    assert ledgers[-1].carried[0] == approx(before.carried[0] + after.carried[0], rel=1e-12)
    assert max(each.generated for each in ledgers) < 1e-4
    assert max(each.force for each in totals[200:]) < 1.5 * before.force  # 21 times in one step
    assert after.force == approx(before.force, rel=1e-6)


@pytest.mark.parametrize("motions, text", [
    ("{a: {moves: [organ]}}", "no body of the graph"),
    ("{a: {amplitude: [0, 0, 1 mm]}}", "no list `moves`"),
    ("{a: {moves: [tissue]}, b: {moves: [tissue]}}", "is moved by 'a' and 'b'"),
    ("{contact: {moves: [tissue]}}", "is the name of a node"),
    ("{a: {moves: [tissue], period: 0}}", "period"),
    ("[tissue]", "expected a mapping"),
    ("{a: {moves: [tissue], wave: sine}}", "wave"),
])  # fmt: skip
def test_a_wrong_motion_is_refused(motions, text):
    with pytest.raises(GraphError, match=text):
        load("kidney", overrides=[f"scene.motions={motions}"])


def test_organs_of_one_finger_that_move_differently_are_noted():
    graph = load("organs", overrides=["scene.motions={a: {moves: [liver], amplitude: [0, 0, 1 mm]}}"])
    assert any("move differently" in note for note in graph.notes)
    assert graph.nodes["collision-liver"].edges[0].producer == "finger-a"
    assert graph.nodes["collision-kidney"].edges[0].producer == "finger"
    assert not any(node.settings.get("organs") for node in graph.nodes.values())  # no bridge between them


def test_organs_of_one_finger_that_move_together_are_felt_as_one():
    graph = load("organs", overrides=["scene.motions={a: {moves: [kidney, liver], amplitude: [0, 0, 1 mm]}}"])
    assert not any("move differently" in note for note in graph.notes)
    assert all(graph.nodes[f"collision-{organ}"].settings["organs"] for organ in ("kidney", "liver"))
