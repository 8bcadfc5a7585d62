"""The ledger in a graph: its balance closes, and it detects a body that generates energy and removes the force."""

import numpy as np
import pytest
from expected_notes import FLAT, STIFF, UNTAKEN
from pytest import approx

import palpate
from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Force, Ledger, Pose, Surface
from palpate.nodes.controller import Haptic
from palpate.nodes.ledger import Energy
from palpate.records.reader import Recording

UP = (0.0, 0.0, 1.0)
BOUNCE = (
    "scene.surface.vertices=1500",
    "scene.energy.ledger=true",
    "scene.hand.begin=[0, 0, 0.111]",
    "scene.hand.path=[" + "{to: [0, 0, 0.095], time: 0.15}, {to: [0, 0, 0.103], time: 0.15}, " * 4
    + "{to: [0, 0, 0.115], time: 0.15}]",
)  # fmt: skip
GIVING = ("tissue.use=nodes_that_make_energy.Giving", "scene.tissue.stiffness=3e3", "scene.tissue.exponent=1.5",
          "scene.tissue.retardation=0")  # fmt: skip
STROKE = (
    "scene.surface.vertices=1500",
    "scene.energy.ledger=true",
    "scene.hand.begin=[-0.02, 0, 0.111]",
    "scene.hand.path=[{to: [-0.02, 0, 0.098], time: 0.15}, {to: [0.02, 0, 0.097], time: 0.3},"
    " {to: [0.02, 0, 0.115], time: 0.15}]",
)


@pytest.fixture
def kidney(tmp_path):
    """Runs the kidney with these settings; returns its recording and its result."""

    def run(*sets, duration=0.7):
        file = tmp_path / "kidney.mcap"
        launch = find("kidney").but(record=file, place="fused", overrides=sets, duration=duration)
        result = execute(launch).result
        assert result.ok, [str(death) for death in result.deaths]
        return Recording(file), result

    return run


@pytest.mark.parametrize("body", ["MassSpring", "ReducedFE", "BeamBundle"])
def test_the_balance_of_a_stroke_closes_and_no_part_generates_energy(kidney, body):
    recording, result = kidney(*STROKE, f"tissue.use=deformation.{body}")
    last, every = (messages := list(recording.messages("ledger")))[-1], recording.messages("ledger")
    parts = sum(
        getattr(last, f"{p}_{k}") for p in ("fingertip", "tissue", "friction") for k in ("stored", "dissipated")
    )
    assert last.hand > 5e-3
    assert last.hand - last.controller - last.sampling == approx(parts + last.unexplained, rel=1e-9)
    assert abs(last.unexplained) < 1e-3 * last.hand
    assert max(m.generated for m in every) < 0.05 * last.hand and not last.tripped
    assert min(np.diff([m.fingertip_dissipated for m in messages])) >= -1e-9
    assert not any("above the bound" in note for note in result.notes)


def test_a_body_that_generates_energy_trips_the_ledger_and_the_force_ramps_down(kidney):
    recording, result = kidney(*BOUNCE, *GIVING, "scene.energy.bound=2 mJ", duration=1.4)
    ledger = list(recording.messages("ledger"))
    tripped = next(m.tick for m in ledger if m.tripped)
    assert ledger[-1].tripped and ledger[tripped].generated_by in ("tissue", "display")
    assert ledger[tripped - 1].generated <= 2e-3 < ledger[tripped].generated
    sizes = np.array([np.linalg.norm(m.force) for m in recording.messages("controller")])
    contact = np.array([m.force for m in recording.messages("contact")])
    assert sizes[:tripped].max() > 0.3 and not sizes[tripped + 102 :].any()
    assert contact[tripped + 102 :].max() > 0.3  # the tissue would still press
    printed = [note for note in result.notes if "above the bound" in note]
    assert len(printed) == 1 and "bound of 2 mJ" in printed[0] and f"at {tripped / 1000:.3f} s" in printed[0]
    assert result.health["ledger"]["state"] == "tripped" and result.health["tissue"]["state"] == "ready"


def test_the_same_body_without_a_bound_continues(kidney):
    recording, _ = kidney(*BOUNCE, *GIVING, "scene.energy.bound=0", duration=1.4)
    assert not any(m.tripped for m in recording.messages("ledger"))
    assert max(m.generated for m in recording.messages("ledger")) > 2e-3


def test_without_a_ledger_its_inputs_are_not_computed(kidney):
    sets = [s for s in STROKE if "ledger" not in s]
    recording, _ = kidney(*sets)
    assert "ledger" not in recording.streams
    for stream in ("contact", "friction", "tissue"):
        assert not any(m.stored for m in recording.messages(stream))


def test_the_ledger_changes_no_force_while_it_does_not_trip(kidney):
    forces = []
    for sets in (STROKE, [s for s in STROKE if "ledger" not in s]):
        recording, _ = kidney(*sets)
        forces.append([m.force for m in recording.messages("controller")])
    assert forces[0] == forces[1]


def test_the_controller_ramps_down_and_stays_down():
    contact = Contact(foot=(0, 0, 0), normal=UP, force=1.0, compression=1e-3, indentation=1e-3, compression_rate=0.0,
                      indentation_rate=0.0, used=(0, 0))  # fmt: skip
    pose = Pose(position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), dt=1e-3)
    bus = FakeBus(Haptic(passivity=False, ramp=0.05, slew=1e6), pose=pose)
    books = {
        f: 0.0
        for f in Ledger.__struct_fields__
        if f not in ("tick", "time", "source", "used", "delayed", "generated_by", "tripped", "carried")
    }
    good, bad = Ledger(**books), Ledger(**books, tripped=True)
    full = [bus.publish(good, contact)[-1].force[2] for _ in range(5)]
    down = [bus.publish(bad, contact)[-1].force[2] for _ in range(60)]
    assert full[-1] == approx(1.0) and np.diff(down).max() <= 0.0
    assert down[24] == approx(0.5, abs=0.03) and not any(down[50:])
    back = [bus.publish(good, contact)[-1].force[2] for _ in range(3)]
    assert not any(back)  # a restarted ledger does not restore the force
    bus = FakeBus(Haptic(passivity=False, ramp=0.0, slew=1e6), pose=pose)
    assert [bus.publish(ledger, contact)[-1].force[2] for ledger in (good, bad, good)] == [1.0, 0.0, 0.0]


def test_an_outage_does_not_count_as_motion_of_the_hand():
    body = Surface(nodes=[], displacement=np.zeros((0, 3)), stiffness=1e3, exponent=1.0, damping=0.0,
                   rest_indentation=0.0, previous_indentation=0.0, stored=(0.0,))  # fmt: skip
    contact = Contact(foot=(0, 0, 0), normal=UP, force=0.0, compression=0.0, indentation=0.0, compression_rate=0.0,
                      indentation_rate=0.0, stored=(0.0,))  # fmt: skip
    bus = FakeBus(Energy())
    force = Force(force=(0.0, 0.0, 1.0), state="contact", energy=0.0)

    def at(z):
        return bus.publish(Pose(position=(0.0, 0.0, z), velocity=(0.0, 0.0, 0.0), dt=1e-3), contact, body, force)[-1]

    at(0.0)
    assert at(1e-3).hand == approx(-1e-3)
    bus.hold("contact", None)
    assert bus.publish(force)[-1].hand == approx(-1e-3)
    assert at(0.5).hand == approx(-1e-3)
    assert at(0.501).hand == approx(-2e-3)


TWO = """
    extends: palpate-two
    nodes:
      ledger: {use: ledger.Energy, in: {force: [controller-1, controller-2], contact: [contact-1, contact-2],
               pose: [finger-1, finger-2], friction: [friction-1, friction-2], body: tissue}}
      controller-1: {in: {ledger: ledger}}
"""
HANDS = {"kidney": ["controller", "finger"], TWO: ["controller-1", "finger-1", "controller-2", "finger-2"]}


@pytest.mark.parametrize(("graph", "sets", "late"), [
    ("kidney", ["tissue.stiffness=3000", "scene.energy.ledger=on"], 0),
    ("kidney", ["tissue.use=deformation.ReducedFE", "scene.energy.ledger=on"], 0),
    ("kidney", ["tissue.stiffness=1500", "scene.energy.ledger=on", "device.delay=2", "controller.delay=2"], 2),
    (TWO, [], 0),
], ids=["stiff", "reduced", "late", "two fingers"])  # fmt: skip
@pytest.mark.notes(UNTAKEN, sets=["tissue.use=deformation.ReducedFE", "scene.energy.ledger=on"])
@pytest.mark.notes(FLAT, STIFF, "the display generated", late=2)
def test_the_work_of_the_hand_is_that_of_the_streams(graph, sets, late, write):
    """Sum of -F dx of the messages of controller and finger, with the delay of the device's reports."""
    nodes = HANDS[graph]
    streams, hand = {name: [] for name in nodes}, 0.0
    for tick in palpate.steps(write("two.yaml", TWO) if graph is TWO else graph, sets=sets, duration=1.2):
        for name in nodes:
            message = tick[name]
            streams[name].append(message.force if isinstance(message, Force) else message.position)
        hand = tick["ledger"].hand
    work = 0.0
    for controller, finger in zip(nodes[::2], nodes[1::2], strict=True):
        force, motion = np.array(streams[controller]), np.diff(streams[finger], axis=0)
        work -= float((force[: len(motion) - late] * motion[late:]).sum())
    assert abs(work) > 1e-4 and hand == approx(work, rel=1e-9)
