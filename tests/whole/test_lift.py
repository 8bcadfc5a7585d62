"""An organ on a foundation of springs that fingers move: the scene's key `foundations`."""

import numpy as np
import pytest
from pytest import approx
from scipy.spatial.transform import Rotation

import palpate
from palpate.engine.faults import GraphError
from palpate.launch.load.graph import load
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.messages import Contact, Force, Friction, Ledger, Pose, unpack
from palpate.messages.tissue import Support
from palpate.nodes.support import Foundation
from palpate.records.player import plan_of
from palpate.records.reader import Recording
from palpate.records.verify import verify
from palpate.views.pictures.touch import TouchStreams
from palpate.views.surface.moments import bodies_of, instants_at

G, MASS, SINKS = 9.80665, 0.13, 5e-3  # SINKS [m] of the organ into its foundation, at rest
NOTES = pytest.mark.notes
SIZE = ("scene.surface.vertices=2000", "scene.energy.ledger=true")
KINDS = {
    "foundation": Support, "ledger": Ledger,
    **{f"{kind}-{finger}": message for finger in ("thumb", "index") for kind, message in (
        ("contact", Contact), ("friction", Friction), ("controller", Force))},
    "thumb": Pose, "index": Pose, "controller-thumb-world": Force, "controller-index-world": Force,
}  # fmt: skip


def run(path, *overrides, graph="pinch", scene="lift", place="fused", duration=2.4):
    launch = find(graph).but(
        scene=scene, duration=duration, record=path, place=place, overrides=(*SIZE, *overrides)
    )  # fmt: skip
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    return Recording(path)


def read(recording, kinds=KINDS):
    found = {name: [] for name in kinds}
    for name, _, payload in recording.payloads():
        if name in kinds:
            found[name].append(unpack(payload, kinds[name]))
    return found


def column(messages, name):
    return np.array([getattr(each, name) for each in messages])


def jump(forces):
    """The largest change of the force on a hand in a tick [N]."""
    return np.linalg.norm(np.diff(column(forces, "force"), axis=0), axis=1).max()


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    return run(tmp_path_factory.mktemp("lift") / "lift.mcap", duration=4.0)


@NOTES
def test_a_pinch_lifts_carries_and_drops_the_kidney(lifted):
    """Off its foundation both hands bear its weight; dropped, it lies where it fell, as deep as before."""
    found = read(lifted)
    at, turn = column(found["foundation"], "displacement"), column(found["foundation"], "rotation")
    hands = sum(column(found[f"controller-{finger}-world"], "force") for finger in ("thumb", "index"))
    held = slice(1850, 2000)
    assert at[held, 2].min() > 2.5 * SINKS and np.abs(np.degrees(turn)).max() < 10.0
    np.testing.assert_allclose(hands[held].mean(axis=0), [0.0, 0.0, -MASS * G], atol=0.01)
    assert np.ptp(at[2000:2800, 0]) > 14e-3  # carried
    end = at[-1]
    assert abs(end[2]) < 1e-5 and end[0] > 14e-3 and np.ptp(at[-200:], axis=0).max() < 1e-5
    assert column(found["contact-thumb"], "force")[3100:].max() == 0.0
    assert max(each.generated for each in found["ledger"]) < 1e-4 and not found["ledger"][-1].tripped


@NOTES
def test_the_ledger_counts_the_work_of_the_hands_on_an_organ_that_moves_and_turns(lifted):
    """Work of both hands from the recorded forces and poses in the world."""
    found = read(lifted)
    work = sum(
        -np.cumsum(np.sum(column(found[f"controller-{finger}-world"], "force")[:-1]
                          * np.diff(column(found[finger], "position"), axis=0), axis=1))
        for finger in ("thumb", "index")
    )  # fmt: skip
    np.testing.assert_allclose(column(found["ledger"], "hand")[1:], work, atol=2e-9)
    last = found["ledger"][-1]
    parts = sum(
        getattr(last, f"{part}_{what}")
        for part in ("fingertip", "tissue", "friction") for what in ("stored", "dissipated")
    )  # fmt: skip
    assert last.hand + last.carried[0] == approx(last.controller + last.sampling + parts + last.unexplained, abs=1e-9)
    assert last.carried[0] < -5e-3  # what foundation, weight and the fall have taken from the hands


@NOTES
@pytest.mark.parametrize("mass, rises", [(200, True), (420, False)])
def test_a_weight_above_twice_the_friction_of_the_grip_slips_and_one_below_is_lifted(mass, rises, tmp_path):
    """The grip N is 2.7 N: 2 mu N is 2.7 N in a slide and 3.8 N in the stick, the weights are 2.0 and 4.1 N. Both sink
    into their foundations by 5 mm."""
    stiff = mass * 1e-3 * G / SINKS
    sets = (
        f"scene.foundations.foundation.mass={mass} g",
        f"scene.foundations.foundation.stiffness={stiff}",
        "scene.foundations.foundation.damping=8",
    )
    found = read(run(tmp_path / "heavy.mcap", *sets, duration=2.0))
    held = column(found["foundation"], "displacement")[-100:, 2]
    grip = column(found["contact-index"], "force")[1000]
    assert 2.5 < grip < 2.9 and 1.4 * grip < 0.42 * G
    assert (held.min() > 2.0 * SINKS) if rises else (held.max() < SINKS)


def table(path, places):
    lines = [f"{k},{x!r},{y!r},{z!r}" for k, (x, y, z) in enumerate(places.tolist())]
    path.write_text("\n".join(["t [ms],x [m],y [m],z [m]", *lines]))
    return path


@NOTES
@pytest.mark.parametrize("attached", ["true", "false"])
def test_the_force_on_the_hand_changes_no_faster_than_with_an_organ_at_rest(attached, tmp_path):
    """The same motion of both fingers, which grip, rise and let go, on an organ at rest and on one that moves."""
    laid = f"moves: [tissue], mass: 130 g, stiffness: 255, damping: 4, attached: {attached}"
    foundation = f"scene.foundations={{foundation: {{{laid}}}}}"
    time, both, given = np.arange(2700) / 1000.0, [], []
    for finger, side in (("thumb", -1.0), ("index", 1.0)):
        x = -0.026 if finger == "thumb" else -0.020
        inward = (
            12e-3 * np.sin(np.minimum(time / 1.2, 0.5) * np.pi) * np.where(time < 2.2, 1.0, 2.2 / 0.3 - time / 0.3 + 1)
        )
        up = 7e-3 * np.clip(time - 1.0, 0.0, 1.0)
        places = np.stack([x + 0.0 * time, side * (32e-3 - np.maximum(inward, 0.0)), 84e-3 + up], axis=1)
        file = table(tmp_path / f"{finger}.csv", places)
        given += [f"{finger}.use=device.RecordedPose", f"{finger}.in.state=null", f"{finger}.path={file}"]
    for k, sets in enumerate(((), (foundation,))):
        both.append(read(run(tmp_path / f"{k}.mcap", *given, *sets, scene=None, duration=2.6)))
    for finger in ("thumb", "index"):
        still, moves = both[0][f"controller-{finger}"], both[1][f"controller-{finger}-world"]
        assert np.linalg.norm(column(moves, "force"), axis=1).max() > 1.0
        assert 0.0 < jump(moves) <= 1.2 * jump(still)


HARD = {
    "light, stiff, 250 Hz": ("mass=1 g", "stiffness=1e5", 250, ()),
    "light, soft, 250 Hz": ("mass=1 g", "stiffness=1", 250, ()),
    "light, attached, undamped": ("mass=1 g", "stiffness=10", 1000, ("attached=true", "damping=0")),
    "lighter, rigid foundation": ("mass=0.1 g", "stiffness=1e6", 1000, ("attached=true", "damping=0")),
}


@NOTES
@pytest.mark.parametrize("case", HARD)
def test_hard_foundations_are_stable_and_generate_no_energy(case, tmp_path):
    mass, stiffness, rate, more = HARD[case]
    sets = [f"scene.foundations.foundation.{one}" for one in (mass, stiffness, *more)]
    found = read(run(tmp_path / "hard.mcap", *sets, f"rate={rate}", duration=2.4))
    assert max(each.generated for each in found["ledger"]) < 1e-4
    speed = np.linalg.norm(column(found["foundation"], "velocity"), axis=1)
    for finger in ("thumb", "index"):
        force = np.linalg.norm(column(found[f"controller-{finger}"], "force"), axis=1)
        assert 2.0 < force.max() < 4.0  # as with other foundations
        assert jump(found[f"controller-{finger}"]) < 0.3 * 1000 / rate
    assert speed[int(0.85 * rate) : int(0.95 * rate)].max() < 0.01  # in the grip, before the lift


@NOTES
@pytest.mark.long
@pytest.mark.parametrize("body", ["ReducedFE", "BeamBundle", "Rigid", "MassSpring"])
def test_every_body_is_lifted_at_10_khz_and_at_1_khz_to_the_same_height(body, tmp_path):
    heights, gentle = [], []
    if body == "Rigid":  # which only the fingertip of 4 mm yields to
        gentle = [
            f"scene.{finger}.path=[{{to: [0.001, {y}, 0.083], time: 0.8}}, {{to: [0.001, {y}, 0.101], time: 1.0}}]"
            for finger, y in (("thumb", -0.014), ("index", 0.027))
        ]
    for rate in (1000, 10000):
        sets = (f"tissue.use=deformation.{body}", f"rate={rate}", *gentle)
        found = read(run(tmp_path / f"{rate}.mcap", *sets, duration=2.0))
        assert max(each.generated for each in found["ledger"]) < 1e-3
        heights.append(column(found["foundation"], "displacement")[-rate // 10 :, 2].mean())
    # the device renders a rigid contact softer than it is, by its rate
    assert heights[1] == approx(heights[0], rel=0.06 if body == "Rigid" else 0.03) and heights[0] > 2.0 * SINKS


@NOTES
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_random_touches_of_an_attached_organ_take_no_more_energy_from_it_than_they_gave(seed, tmp_path):
    """Energy of organ and foundation, from place and velocity, against the work that the ledger says they received."""
    rng, duration = np.random.default_rng(seed), 1.2
    given = ("attached=true", "mass=60 g", "stiffness=150 N/m", "damping=0")
    sets = [f"scene.foundations.foundation.{one}" for one in given]
    for finger, side in (("thumb", -1.0), ("index", 1.0)):
        middle, turns = np.array([0.001, 0.0065, 0.083]), []
        for _ in range(8):
            deep = rng.uniform(0.004, 0.030)
            to = middle + [rng.uniform(-8e-3, 8e-3), side * deep, rng.uniform(-8e-3, 8e-3)]
            turns.append(f"{{to: {np.round(to, 5).tolist()}, time: 0.15}}")
        sets.append(f"scene.{finger}.path=[{', '.join(turns)}]")
    found = read(run(tmp_path / "random.mcap", *sets, duration=duration))
    assert max(each.generated for each in found["ledger"]) < 1e-4
    at, turn, spin = (column(found["foundation"], name) for name in ("displacement", "rotation", "spin"))
    speed = column(found["foundation"], "velocity")
    stiff = np.array([100.0, 100.0, 150.0])  # along the axes of the world; of tilt and twist times b²/4, b²/2
    flat = np.array([150.0 / 4, 150.0 / 4, 100.0 / 2]) * 0.03**2
    inertia = 0.06 * 0.025582**2
    energy = 0.5 * (at**2 @ stiff + turn**2 @ flat + 0.06 * (speed**2).sum(axis=1) + inertia * (spin**2).sum(axis=1))
    received = -np.array([each.carried[0] for each in found["ledger"]])
    lost = received[1:] - energy[:-1]  # the ledger sees the motion of a step in the next tick
    assert energy.max() > 1e-3 and np.abs(turn).max() > 0.02
    assert lost.min() > -0.02 * energy.max()


def test_a_rotated_scene_gives_the_rotated_answer(tmp_path):
    """A finger strokes the kidney on a foundation; organ, foundation and path are rotated about the origin."""
    time = np.arange(300) / 1000.0
    path = np.array([0.0, 0.0, 0.1085]) + np.stack([15e-3 * time, 5e-3 * time, -9e-3 * np.sin(9.0 * time)], axis=1)
    answers = []
    for k, turn in enumerate((Rotation.identity(), Rotation.from_rotvec([0.7, -0.4, 1.2]))):
        file = table(tmp_path / f"{k}.csv", turn.apply(path))
        foundation = (f"scene.foundations={{foundation: {{moves: [tissue], mass: 100 g, stiffness: 80 N/m, damping: 1, "
               f"up: {turn.apply([0.0, 0.0, 1.0]).tolist()}}}}}")  # fmt: skip
        placed = (f"scene.surface.position={turn.apply([0.0, 0.0, 0.084]).tolist()}",
                  f"scene.surface.rotation={turn.as_rotvec().tolist()}")  # fmt: skip
        sets = (foundation, *placed, "finger.use=device.RecordedPose", "finger.in.state=null", f"finger.path={file}")
        kinds = {"foundation": Support, "contact": Contact, "controller-world": Force}
        answers.append(read(run(tmp_path / f"{k}.mcap", *sets, graph="kidney", scene=None, duration=0.3), kinds))
    one, other = answers
    assert max(column(one["contact"], "force")) > 0.3 and np.abs(column(one["foundation"], "rotation")).max() > 0.02
    np.testing.assert_allclose(column(other["contact"], "force"), column(one["contact"], "force"), rtol=1e-5, atol=1e-7)
    for stream, name in (("foundation", "displacement"), ("foundation", "rotation"), ("controller-world", "force")):
        want = turn.apply(column(one[stream], name))
        np.testing.assert_allclose(column(other[stream], name), want, rtol=1e-5, atol=1e-6 * np.abs(want).max())


@NOTES
def test_it_replays_with_the_same_bytes(tmp_path):
    quick = [
        f"scene.{finger}.path=[{{to: [0.001, {y}, 0.083], time: 0.2}}, {{to: [0.001, {y}, 0.090], time: 0.1}}]"
        for finger, y in (("thumb", -0.002), ("index", 0.015))
    ]
    recording = run(tmp_path / "quick.mcap", *quick, duration=0.35)
    found = read(recording)
    assert (
        found["contact-thumb"][-1].force > 1.0 and np.abs(column(found["foundation"], "displacement")[-1]).max() > 5e-5
    )
    report = verify(recording, plan_of(recording), tolerance=0.0)
    assert report.ok, report


@NOTES
@pytest.mark.long
def test_it_runs_in_processes_with_the_same_bytes(lifted, tmp_path):
    apart = run(tmp_path / "apart.mcap", place="apart", duration=0.5)
    ours = {(name, tick): payload for name, tick, payload in apart.payloads()}
    theirs = {(name, tick): payload for name, tick, payload in lifted.payloads()}
    assert len(ours) > 5000 and all(theirs[key] == payload for key, payload in ours.items())


@NOTES
def test_pictures_show_organ_and_fingers_where_they_are(lifted):
    touch = TouchStreams(lifted, whole=True)
    found = bodies_of(touch)
    support = read(lifted, {"foundation": Support})["foundation"]
    (moment,) = instants_at(touch, found, [1900])
    turn, centre = Rotation.from_rotvec(support[1900].rotation.copy()), support[1900].centre
    rest = found.mesh.vertices
    want = turn.apply(rest - centre) + centre + support[1900].displacement
    far = np.linalg.norm(rest + moment.displacement - want, axis=1)
    assert np.median(far) < 1e-9 and 5e-3 < far.max() < 15e-3  # most of the surface is not deformed
    assert moment.tips[0, 1] < -4e-3 < 16e-3 < moment.tips[1, 1]
    for tip in moment.tips:
        assert np.linalg.norm(rest + moment.displacement - tip, axis=1).min() < 2.5e-3


def test_without_the_key_the_graph_has_no_foundation():
    assert not any(node.cls is Foundation or "-foundation" in name for name, node in load("pinch").nodes.items())


@pytest.mark.parametrize("foundation, text", [
    ("[tissue]", "expected a mapping"),
    ("{foundation: {moves: [organ], mass: 0.1, stiffness: 100}}", "no body of the graph"),
    ("{foundation: {mass: 0.1, stiffness: 100}}", "no list `moves`"),
    ("{foundation: {moves: [tissue], stiffness: 100}}", "mass"),
    ("{foundation: {moves: [tissue], mass: 0.1}}", "stiffness"),
    ("{foundation: {moves: [tissue], mass: 0, stiffness: 100}}", "mass"),
    ("{foundation: {moves: [tissue], mass: 0.1, stiffness: -1}}", "stiffness"),
    ("{foundation: {moves: [tissue], mass: 0.1, stiffness: .nan}}", "stiffness"),
    ("{foundation: {moves: [tissue], mass: 0.1, stiffness: 100, spring: 3}}", "spring"),
    ("{foundation: {moves: [tissue], mass: 0.1, stiffness: 100, up: [0, 0, 0]}}", "expected the direction out"),
    ("{foundation: {moves: [tissue, tissue], mass: 0.1, stiffness: 100}}", "moves 2 organs"),
    ("{joint: {moves: [tissue], mass: 0.1, stiffness: 100}}", "is the name of a node"),
    ("{a: {moves: [tissue], mass: 1, stiffness: 9}, b: {moves: [tissue], mass: 1, stiffness: 9}}", "by 'a' and 'b'"),
])  # fmt: skip
def test_a_wrong_foundation_is_refused(foundation, text):
    with pytest.raises(GraphError, match=text):
        load("pinch", overrides=[f"scene.foundations={foundation}"])


@NOTES
def test_lanes_of_an_ensemble_with_different_foundations_have_the_bytes_of_single_runs(tmp_path):
    stiff = [255.0, 600.0]
    lanes = palpate.Ensemble(
        "pinch", 2, {"foundation.stiffness": stiff}, ["foundation.displacement", "controller-thumb-world.force"],
        scene="lift", duration=0.7, sets=SIZE,
    )  # fmt: skip
    answers = lanes.run()
    for lane, stiffness in enumerate(stiff):
        found = read(run(tmp_path / "one.mcap", f"scene.foundations.foundation.stiffness={stiffness}", duration=0.7))
        for stream, name in (("foundation", "displacement"), ("controller-thumb-world", "force")):
            want = column(found[stream], name)
            assert np.array_equal(answers[f"{stream}.{name}"][lane], want) and np.abs(want).max() > 1e-4


def test_a_foundation_that_would_move_the_organ_in_jumps_is_refused():
    with pytest.raises(GraphError, match="every: 5"):
        load("pinch", scene="lift", overrides=["foundation.every=5"])
