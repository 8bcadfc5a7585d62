"""contact.Joint and contact.Share on given bodies, without graph and mesh."""

import msgspec
import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Contacts, Proximity, Surface
from palpate.messages.contact import Neighbour
from palpate.nodes.base import InputError, SettingError
from palpate.nodes.contact import Series
from palpate.nodes.contact.joint import Joint, Share

LAW = {"stiffness": 3e3, "exponent": 1.5, "damping": 2.0, "rest_indentation": 0.0, "previous_indentation": 0.0}
AT = {"foot": (0.1, 0.2, 0.3), "normal": (0.0, 0.0, 1.0), "coordinates": (0.0, 0.0), "element": 0}


def near(depth, name="a", tick=-1):
    return Proximity(
        **AT, gap=-depth, approach=max(depth, 0.0), separation=max(-depth, 0.0), slip=(0.0, 0.0, 0.0), source=name,
        tick=tick, time=tick * 1_000_000 if tick >= 0 else -1,
    )  # fmt: skip


def tissue(count=1, coupling=None, laws=None, **more):
    """A body under `count` fingers with the same law, or with `laws`."""
    laws = np.array(laws) if laws is not None else np.tile([*LAW.values()], (count, 1))
    several = {"laws": laws, "slopes": np.zeros((count, 12)), "coupling": coupling}
    given = (LAW | several if count > 1 else LAW) | more
    return Surface(nodes=[], displacement=np.zeros((0, 3)), source="tissue", **given)


def test_one_finger_is_bit_equal_to_series():
    alone, joint = Series(), Joint()
    alone.start()
    joint.start()
    shape = {"tangential_gradient": (0.1, 0.2, 0.0), "shape_operator": tuple(np.linspace(0.0, 20.0, 9).tolist())}
    for tick in range(60):
        body = None if 30 <= tick < 36 else tissue(step=2e-3, relaxation=0.01, tick=tick - 1, **shape)
        seen = near(3e-3 * np.sin(tick / 15), tick=tick)
        one, several = alone.step(seen, body, dt=1e-3), joint.step([seen], body, dt=1e-3)
        for name in ("force", "compression", "indentation", "compression_rate", "indentation_rate", "stored"):
            assert np.array_equal(getattr(several, name), np.ravel(getattr(one, name)))
        assert several.lateral_force.tolist() == [list(one.lateral_force)]


def test_uncoupled_fingers_have_the_forces_of_single_fingers():
    depths, joint = (1e-3, 2e-3, 3e-3), FakeBus(Joint(), body=tissue(3, np.eye(3)))
    (together,) = joint.publish([near(depth) for depth in depths])
    alone = [FakeBus(Series(), body=tissue()).publish(near(depth))[0] for depth in depths]
    assert together.force == tuple(contact.force for contact in alone)
    assert together.lateral_force.shape == (3, 3) and len(together.stored) == 3


@pytest.mark.parametrize(("apart", "facing", "noted"), [(3.9e-3, 1.0, True), (4.1e-3, 1.0, False), (1e-3, -1.0, False)])
def test_fingers_that_press_nearly_the_same_place_are_noted(apart, facing, noted):
    """Not those of a pinch, on two sides of a thin part, nor one that hovers."""
    joint = Joint(thickness=4e-3)
    bus = FakeBus(joint, body=tissue(3, np.eye(3)))
    other = msgspec.structs.replace(near(2e-3), foot=(0.1, 0.2 + apart, 0.3), normal=(0.0, 0.0, facing))
    bus.publish([near(2e-3), near(-1e-3), other])
    found = [text for text in joint.notes() if "keep each other apart" in text]
    assert len(found) == noted and all("0 and 2" in text and "3.9 mm" in text for text in found)
    assert joint.notes() == [], "once"


@pytest.mark.parametrize("make", [Series, Joint])
@pytest.mark.parametrize("rate", [1e3, 1e4])
def test_a_foot_that_leaps_over_lifted_tissue_does_not_kick(make, rate):
    """A finger above the undeformed surface touches tissue that another one lifts by 1.6 mm. Its foot leaps by 2 mm to
    tissue lifted by 0.3 mm more: the force rose to 17 N for a tick at 10 kHz. It now returns within 0.2 s."""
    node = make()
    node.start()

    def force(place, lifted):
        seen = msgspec.structs.replace(near(-1e-5), foot=(place, 0.0, 0.0), tick=force.tick)
        force.tick += 1
        body = tissue(rest_indentation=-lifted, previous_indentation=-lifted)
        answer = node.step([seen] if make is Joint else seen, body, dt=1.0 / rate)
        return float(np.ravel(answer.force)[0])

    force.tick = 1
    first = [force(0.0, 1.6e-3) for _ in range(round(0.2 * rate))]
    leapt = [force(2e-3, 1.6e-3), *(force(2e-3, 1.9e-3) for _ in range(round(0.2 * rate)))]
    assert first[-1] > 0.07 and leapt[0] == first[-1]
    assert leapt[-1] > 1.3 * first[-1] and max(leapt) < 1.02 * leapt[-1]
    assert np.diff(leapt).max() * rate < 75.0  # [N/s]


def test_coupling_reduces_the_force_of_each_of_sixteen_fingers():
    def pressed(share, count):
        coupling = np.full((count, count), share)
        return FakeBus(Joint(), body=tissue(count, coupling)).publish([near(3e-3)] * count)[0].force

    apart, together = pressed(0.0, 2), pressed(0.6, 2)
    assert apart[0] > together[0] == pytest.approx(together[1], rel=1e-12)
    many = pressed(0.3, 16)
    assert len(many) == 16 and min(many) == pytest.approx(max(many), rel=1e-9) and min(many) > 0.0


def test_each_share_has_the_contact_of_its_finger():
    (solved,) = FakeBus(Joint(), body=tissue(2, np.eye(2))).publish([near(1e-3), near(2e-3)])
    solved = msgspec.structs.replace(solved, tick=-1, time=-1)
    for place in (0, 1):
        (contact,) = FakeBus(Share(finger=place), proximity=near(1e-3)).publish(solved)
        assert isinstance(contact, Contact) and contact.foot == AT["foot"] and contact.normal == AT["normal"]
        for name in ("force", "compression", "indentation", "compression_rate", "indentation_rate"):
            assert getattr(contact, name) == getattr(solved, name)[place]
        assert contact.stored == solved.stored[place : place + 1]
        assert contact.lateral_force == tuple(solved.lateral_force[place].tolist())
    bare = msgspec.structs.replace(solved, stored=())
    assert FakeBus(Share(finger=1), proximity=near(1e-3)).publish(bare)[0].stored == ()


def test_what_a_body_generates_is_sent_to_the_finger_that_gets_it():
    """The body is twice as stiff when the second finger leaves as when it presses."""
    joint, work, last = Joint(), 0.0, None
    joint.start()
    depths = [*np.linspace(0.0, 3e-3, 100), *np.linspace(3e-3, 0.0, 100)]
    for k, depth in enumerate(depths):
        factor = 1.0 if k < 100 else 2.0
        laws = [[factor * 3e3, 1.5, 0.0, 0.0, 0.0]] * 2
        solved = joint.step([near(0.2e-3, tick=k), near(depth, tick=k)], tissue(2, np.eye(2), laws=laws), dt=1e-3)
        if last is not None:
            work += 0.5 * (solved.force[1] + last[0]) * (depth - last[1])
        last = solved.force[1], depth
        assert solved.generated[0] == 0.0 and (k > 99 or solved.generated[1] == 0.0)
    assert solved.generated[1] == approx(-work, rel=0.02) and work < -5e-5
    solved = msgspec.structs.replace(solved, tick=-1, time=-1)
    for place in (0, 1):
        (contact,) = FakeBus(Share(finger=place), proximity=near(1e-3)).publish(solved)
        assert contact.generated.tolist() == [solved.generated[place]]


def test_a_finger_that_was_missing_has_put_in_nothing_until_it_moves_again():
    """It moves by 5 mm unseen, while the other one presses: the place where it returns is no work."""
    joint, laws = Joint(), np.eye(2)
    joint.start()
    for k in range(200):
        first = near(2e-3 if k < 50 else 7e-3, tick=k)
        joint.step([None if 50 <= k < 60 else first, near(1e-3, tick=k)], tissue(2, laws), dt=1e-3)
        if k == 60:
            assert not joint.own["given"][0] and not joint.own["returned"][0] and joint.own["ends"][0]["known"]


def test_where_another_organ_touches_the_body_no_energy_is_assigned():
    side = Neighbour(force=0.0, yields=np.zeros((2, 2)), pressing=(0.0, 0.0), source="side")
    bus = FakeBus(Joint(), body=tissue(3, np.eye(3)), neighbour=[side])
    (solved,) = bus.publish([near(1e-3), near(2e-3)])
    assert solved.generated == ()
    (contact,) = FakeBus(Share(finger=1), proximity=near(1e-3)).publish(
        msgspec.structs.replace(solved, tick=-1, time=-1)
    )
    assert len(contact.generated) == 0


@pytest.mark.parametrize("place", [-1, 2])
def test_a_share_of_an_unknown_finger_is_an_error(place):
    zero = (0.0, 0.0)
    of_two = Contacts(force=zero, compression=zero, indentation=zero, compression_rate=zero, indentation_rate=zero,
                      lateral_force=np.zeros((2, 3)), source="joint")  # fmt: skip
    share = Share(finger=place)
    share.start()
    with pytest.raises(InputError, match=rf"Contacts of 'joint' .*found 2 fingers, expected .* at place {place}"):
        share.step(of_two, near(1e-3))
    with pytest.raises(SettingError, match="finger"):
        Share(finger=16)


def test_a_body_without_all_contacts_is_an_error_with_its_name():
    with pytest.raises(InputError, match=r"'tissue'.*laws of 0 contacts, expected 2"):
        FakeBus(Joint(), body=tissue()).publish([near(1e-3), near(1e-3)])


def test_a_wrong_law_of_one_contact_is_an_error_with_the_name_of_its_message():
    body = tissue(2, np.eye(2), laws=[[1e3, 1.0, 0.0, 0.0, 0.0], [-1.0, 1.0, 0.0, 0.0, 0.0]], tick=3)
    joint = Joint()
    joint.start()
    with pytest.raises(InputError, match=r"^Surface of 'tissue' at tick 3: stiffness .*found -1.0"):
        joint.step([near(1e-3), near(1e-3)], body, dt=1e-3)
    assert not joint.own["finger"]["hears"].any()  # nothing has changed


def test_without_the_body_all_forces_are_zero_within_8_ms():
    joint = Joint()
    joint.start()
    pressing = [near(3e-3), near(2e-3)]
    for _ in range(20):
        assert min(joint.step(pressing, tissue(2, np.full((2, 2), 0.3)), dt=1e-3).force) > 0.05
    gone = [joint.step(pressing, None, dt=1e-3).force for _ in range(9)]
    assert gone[-1] == (0.0, 0.0) and (np.diff(gone, axis=0) <= 0.0).all()


def test_a_lifted_body_is_touched_before_its_undeformed_surface():
    """Two springs in series from the place where the body is: 2 mm above its undeformed surface."""
    series, law = Series(finger_law="power", finger_power_stiffness=3e3, finger_damping=0.0), dict(LAW, damping=0.0)
    series.start()
    law |= {"rest_indentation": -2e-3, "previous_indentation": -2e-3}
    found = {}
    for tick, depth in enumerate((-3e-3, -2e-3, -1e-3, 0.0, 1e-3)):
        contact = series.step(near(depth, tick=tick), tissue(**law), dt=1e-3)
        found[depth] = contact.force
        assert contact.compression + contact.indentation == pytest.approx(max(depth, -2e-3), abs=1e-12)
    for depth, force in found.items():
        assert force == pytest.approx(3e3 * max(0.5 * (depth + 2e-3), 0.0) ** 1.5, rel=1e-9)


def test_a_lifted_body_that_disappears_leaves_no_force_after_8_ms():
    series, law = Series(), LAW | {"rest_indentation": -3e-3, "previous_indentation": -3e-3}
    series.start()
    for tick in range(5):
        pressed = series.step(near(-0.5e-3, tick=tick), tissue(tick=tick - 1, **law), dt=1e-3).force
    gone = [series.step(near(-0.5e-3, tick=5 + k), None, dt=1e-3).force for k in range(9)]
    assert pressed > 0.05 and gone[0] > 0.0 and gone[-1] == 0.0 and (np.diff([pressed, *gone]) <= 0.0).all()


def test_the_joint_sleeps_only_if_all_fingers_are_far_and_at_rest():
    joint, body = Joint(), tissue(2, np.eye(2))
    joint.start()
    for _ in range(400):
        joint.step([near(-5e-3), near(-5e-3)], body, dt=1e-3)
    assert joint.rests([near(-5e-3), near(-5e-3)], body)
    assert not joint.rests([near(-5e-3), near(-1e-3)], body)
    assert not joint.rests([near(-5e-3), near(-5e-3)], None) and not joint.rests([near(-5e-3)] * 2, tissue())


def test_each_finger_beyond_its_law_is_reported_once():
    hard = tissue(2, np.eye(2), laws=[[1e9, 1.0, 0.0, 0.0, 0.0]] * 2)
    bus = FakeBus(Joint(), body=hard)
    assert not bus.node.notes() and not bus.node.condition()
    first = {"foot": (0.0, 0.0, 0.0)}  # not where the second one presses
    bus.publish([msgspec.structs.replace(near(1e-3), **first), near(4.5e-3)])
    assert bus.node.condition() and ["4.5 mm" in note for note in bus.node.notes()] == [True]
    bus.publish([msgspec.structs.replace(near(4.2e-3), **first), near(4.6e-3)])
    assert ["4.2 mm" in note for note in bus.node.notes()] == [True] and not bus.node.notes()


@pytest.mark.parametrize("rate", [1e3, 4e3])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_a_finger_whose_place_is_missing_is_lifted_off_within_8_ms_and_the_other_stays(share, rate):
    """Lifted within that time, its viscous fingertip would lose the contact at once, and on a coupled body the other
    finger would feel that: 0.2 N in a tick."""
    joint, dt, indented = Joint(), 1.0 / rate, (0.0, 0.0)
    joint.start()
    forces, gone, back = [], round(0.3 * rate), round(0.35 * rate)
    for tick in range(round(1.2 * rate)):
        laws = [[3e3, 1.5, 2.0, 0.0, each] for each in indented]
        body = tissue(2, np.array([[1.0, share], [share, 1.0]]), laws, tick=tick - 1)
        seen = [near(7e-3, tick=tick), None if gone <= tick < back else near(6e-3, tick=tick)]
        solved = joint.step(seen, body, dt=dt)
        indented = solved.indentation
        forces.append(solved.force)
    one, other = np.array(forces).T
    ends, usual = gone + round(8e-3 * rate), other[gone - 1]
    assert usual > 0.3 and (other[ends:back] == 0.0).all()
    falls = -np.diff(other[gone - 1 : ends + 1])
    assert (falls >= 0.0).all() and falls.max() < 0.55 * usual * (1e3 / rate)
    rises = np.diff(one[gone - 1 : back])
    assert rises.max() <= share * falls.max() + 1e-9, "as fast as the other is lifted"
    assert one[back - 1] >= one[gone - 1] + 0.1 * share
    assert np.diff(other[back - 1 :]).max() * rate < 40.0 and np.abs(np.diff(one[back - 1 :])).max() * rate < 40.0
    assert (one[-1], other[-1]) == pytest.approx((one[gone - 1], usual), rel=0.02)


def test_a_finger_and_the_body_that_are_missing_leave_no_force_and_no_other_finger():
    """One hovers, the other presses until its place and the body are missing in the same step."""
    joint, body = Joint(), tissue(2, np.eye(2))
    joint.start()
    for _ in range(20):
        assert joint.step([near(-5e-3), near(6e-3)], body, dt=1e-3).force[1] > 0.3
    gone = np.array([joint.step([near(-5e-3), None], None, dt=1e-3).force for _ in range(12)])
    assert np.isfinite(gone).all() and (gone[:, 0] == 0.0).all() and gone[-1, 1] == 0.0
    assert (np.diff(gone[:, 1]) <= 0.0).all()
