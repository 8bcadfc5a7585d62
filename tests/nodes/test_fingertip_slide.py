"""The nodes of the fingertip pressed on a plate and slid."""

import numpy as np
import pytest
from formulas import dome
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import MessageError, Pose
from palpate.nodes.base import SettingError
from palpate.nodes.fingertip import BundleContact, Slide
from palpate.physics.fingertip.anatomy import Anatomy
from palpate.physics.materials.voigt import ViscoelasticMaterial


class Dome(BundleContact):
    """A paraboloid on elastic beams, which has closed forms."""

    def _bundle(self):
        skin = ViscoelasticMaterial(self.skin_modulus, 0.0, self.poisson)
        tissue = ViscoelasticMaterial(self.tissue_modulus, 0.0, self.poisson)
        return dome(8e-3, 4e-3, self.pitch, self.reach, tissue, skin=self.sheet, skin_material=skin)


def pose(depth, x=0.0, y=0.0):
    return Pose(position=(x, y, 5e-3 - depth), velocity=(0, 0, 0), dt=1e-3)


def run(finger, seconds=3.5, **motion):
    """Messages (contact, friction, slip, surface) of a finger that a hand moves."""
    hand = FakeBus(Slide(**{"hold": 0.2, **motion}))
    return FakeBus(finger).publish(*hand.run(round(seconds * 1000)))


@pytest.fixture(scope="module")
def dome_run():
    return run(Dome(reach=2e-3), distance=8e-3)


def test_the_hand_presses_holds_and_slides_at_the_given_speeds():
    poses = FakeBus(Slide(hold=0.5, direction=0.3, distance=1e-3)).run(2000)
    x, y, z = np.array([p.position for p in poses]).T
    time = np.arange(1, 2001) * 1e-3
    assert z == approx(5e-3 - np.minimum(4e-3 * time, 2e-3))
    way = np.clip(2e-3 * (time - 1.0), 0, 1e-3)
    assert x == approx(way * np.cos(0.3)) and y == approx(way * np.sin(0.3))
    assert poses[1200].velocity[0] == approx(2e-3 * np.cos(0.3))


def test_the_dome_has_its_closed_form_force_and_slips_from_the_rim(dome_run):
    contact, friction, slip, _ = dome_run[690]
    assert contact.force == approx(0.861, abs=5e-4) and friction.force == (0, 0, 0)
    assert slip.contacts == 69 and slip.fraction == 0 and slip.front == approx(np.sqrt(69 / np.pi) * 1.2e-3)
    contact, friction, slip, _ = dome_run[-1]
    assert friction.force[1] == approx(0.7 * contact.force, rel=1e-5)
    assert slip.gross and not slip.incipient and slip.front == 0 and not friction.stick
    rim = np.argsort(-np.hypot(*slip.points.T))
    assert slip.first[rim[:17]].mean() == approx(0.31, abs=0.03)
    assert slip.first[rim[-17:]].mean() == approx(1.03, abs=0.05)
    assert np.all(slip.state == 2) and np.all(slip.path > 0)


def test_the_warning_of_incipient_slip_precedes_gross_slip(dome_run):
    warned = [s.incipient for _, _, s, _ in dome_run].index(True)
    gross = [s.gross for _, _, s, _ in dome_run].index(True)
    assert gross - warned > 800
    at_warning = dome_run[warned][1].force[1] / dome_run[gross][1].force[1]
    assert at_warning < 0.3
    front = [s.front for _, _, s, _ in dome_run[700:]]
    assert np.all(np.diff(front) <= 0)


def test_the_law_of_the_finger_is_the_tangent_of_its_next_step():
    bus = FakeBus(BundleContact(angle=0.3))
    depth = np.concatenate([np.linspace(0, 2e-3, 300), np.full(100, 2e-3), np.linspace(2e-3, 1.5e-3, 300)])
    seen = bus.publish(*[pose(d) for d in depth])
    error = []
    for before, after, d in zip(seen, seen[1:], depth[1:], strict=False):
        law = before[3].stiffness * max(d - before[3].rest_indentation, 0)
        assert law <= after[0].force * (1 + 1e-9) + 1e-9
        error.append(after[0].force - law)
    assert np.array(error[300:398]) == approx(0, abs=1e-9)
    assert np.median(error[:299]) < 0.02


def test_friction_acts_along_the_slide_and_never_exceeds_its_limit():
    for direction in (0.0, 2.0):
        slid = run(BundleContact(), 1.6, direction=direction)[::50]
        assert np.hypot(*slid[-1][1].force[:2]) > 0.1
        for contact, friction, _, _ in slid:
            size = np.hypot(*friction.force[:2])
            assert size <= 0.7 * contact.force * (1 + 1e-9)
            if size > 0.1:
                along = np.dot(friction.force[:2], [np.cos(direction), np.sin(direction)])
                assert along > 0.99 * size


def test_surface_has_pressure_and_slip_of_the_nodes_in_contact(dome_run):
    contact, _, slip, surface = dome_run[1200]
    assert len(surface.nodes) == len(surface.pressure) == len(surface.slipped) == slip.contacts
    assert surface.pressure.sum() * (1.2e-3) ** 2 == approx(contact.force)
    assert surface.slipped.mean() == approx(slip.fraction) and 0 < slip.fraction < 1


def test_the_finger_gives_no_force_before_touch_and_after_lifting():
    bus = FakeBus(BundleContact())
    for contact, friction, slip, surface in (*bus.publish(pose(-1e-3, 0.01)),):
        assert contact.force == 0 and friction.force == (0, 0, 0) and slip.contacts == 0 and not friction.stick
        assert surface.stiffness > 0 and surface.rest_indentation >= 0
    bus.publish(*[pose(1e-3)] * 50, *[pose(1e-3, 1e-5 * k) for k in range(100)])
    contact, friction, slip, surface = bus.publish(pose(-1e-3))[0]
    assert contact.force == 0 and friction.force == (0, 0, 0) and not friction.stick
    assert surface.rest_indentation > 0 and np.all(slip.first == -1)


def test_pressing_beyond_the_reach_is_bounded_and_flagged():
    bus = FakeBus(Dome(reach=2e-3))
    inside = bus.publish(*[pose(2e-3)] * 5)[-1]
    beyond = bus.publish(*[pose(30e-3)] * 5)[-1]
    assert inside[2].limited == 0 and beyond[2].limited == 69
    assert inside[0].force < beyond[0].force <= 69 * 0.9 * 3.4e4 * 1.2e-3**2 * (1 + 1e-9)


def test_pressing_deeper_than_the_meshed_pad_is_flagged_before_beams_reach_their_limit():
    """Beams at the rim are missing there: the force is finite, and smaller than with a larger pad."""
    seen = [FakeBus(BundleContact(reach=reach)).publish(*[pose(3e-3)] * 3)[-1] for reach in (2e-3, 3e-3, 4e-3)]
    assert [s[2].deeper for s in seen] == [True, False, False]
    assert not any(s[2].limited for s in seen)
    assert 0 < seen[0][0].force < 0.95 * seen[1][0].force
    assert seen[1][0].force == approx(seen[2][0].force, rel=0.05)


def test_the_hand_lifts_the_finger_once_the_slide_has_ended():
    poses = FakeBus(Slide(hold=0.2, distance=1e-3, lift=1e-3)).run(5000)
    z = np.array([p.position[2] for p in poses])
    time = np.arange(1, 5001) * 1e-3
    assert 5e-3 - z == approx(
        np.where(time < 1.2, np.minimum(4e-3 * time, 2e-3), np.maximum(3.2e-3 - 1e-3 * time, -1e-3))
    )
    still = FakeBus(Slide(hold=0.1, distance=0.0, lift=2e-3)).run(1700)
    assert still[599].position[2] == approx(3e-3) and still[-1].position[2] == approx(5e-3 + 2e-4)
    assert FakeBus(Slide(speed=0.0, lift=1e-3)).run(5000)[-1].position[2] == approx(3e-3)


def test_duplicate_reordered_and_late_messages_are_ignored():
    bus = FakeBus(Dome(reach=2e-3))
    bus.publish(*[pose(1e-3, 1e-5 * k) for k in range(50)])
    bus.twice()
    one, two = bus.publish(pose(1e-3, 60e-5))
    assert one[0].force == two[0].force and one[1].force == two[1].force
    bus.swap()
    bus.publish(pose(1e-3, 70e-5), pose(1e-3, 80e-5))
    bus.late(0.3)
    bus.drop(2)
    for contact, friction, *_ in bus.publish(*[pose(1e-3, 1e-3)] * 5):
        assert 0 <= np.hypot(*friction.force[:2]) <= 0.7 * contact.force * (1 + 1e-9)


@pytest.mark.parametrize("dt", [1e-9, 1e-3, 10.0])
def test_extreme_poses_give_finite_bounded_results(dt):
    random = np.random.default_rng(3)
    bus = FakeBus(BundleContact(), rate=1 / dt)
    for scale in 10.0 ** random.uniform(-9, 2, 60):  # at most 1 km, the bound of a position
        x, y, z = scale * random.normal(size=3)
        try:
            contact, friction, slip, _ = bus.publish(Pose(position=(x, y, z), velocity=(0, 0, 0), dt=dt))[0]
        except MessageError as error:  # rates and viscous forces of a step of 1 ns are refused by name
            assert dt == 1e-9 and "expected at most" in str(error)
            continue
        assert contact.force >= 0 and slip.iterations <= 30
        assert np.hypot(*friction.force[:2]) <= 0.7 * contact.force * (1 + 1e-9)
    steady = bus.publish(*[pose(1e-3)] * 20)[-1]
    assert np.isfinite(steady[0].force) and np.abs(steady[3].displacement).max(initial=0.0) < 0.1


@pytest.mark.parametrize("far", [1e17, 1e300])
def test_a_pose_beyond_every_device_is_refused_by_name(far):
    bus = FakeBus(BundleContact(), rate=1000.0)
    with pytest.raises(MessageError, match=r"found .*expected at most 1000, 1000 times the reach of an arm"):
        bus.publish(Pose(position=(far, 0.0, 0.0), velocity=(0, 0, 0), dt=1e-3))


def test_zero_friction_slips_everywhere_without_force():
    answers = run(Dome(reach=2e-3, friction=0.0), 1.2)
    assert all(np.hypot(*f.force[:2]) < 1e-9 for _, f, _, _ in answers)
    assert answers[-1][2].gross


def test_a_saved_fingertip_gives_the_same_forces(tmp_path):
    Anatomy().fingertip().save(tmp_path / "finger.npz")
    kinds = BundleContact(), BundleContact(shape=str(tmp_path / "finger.npz"))
    forces = [FakeBus(k).publish(*[pose(1e-3, 1e-5 * n) for n in range(20)])[-1][0].force for k in kinds]
    assert forces[0] == approx(forces[1], rel=1e-12)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        (dict(shape="nowhere.npz"), "cannot be read"),
        (dict(reach=20e-3), "between skin and nail"),
        (dict(pitch=1e-6), "increase the pitch"),
        (dict(lateral="rigid"), "lateral"),
        (dict(angle=2.0), "angle"),
    ],
)
def test_invalid_settings_of_the_finger_are_errors(given, text):
    with pytest.raises(SettingError, match=text):
        BundleContact(**given).start()
