"""`tactile.Relief`: a relief that slides under the receptors."""

from functools import lru_cache

import numpy as np
import pytest
from pytest import approx

from palpate.launch.load.launchfile import find
from palpate.launch.load.plan import plan
from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Load, MessageError, Proximity, Subsurface
from palpate.nodes.base import SettingError
from palpate.nodes.tactile import Afferents, Relief, Stress
from palpate.physics.texture import relief

RATE, SPEED, WAVE = 2000.0, 60e-3, 3e-3
UNITS = {"densities": (0.1e6, 0.1e6, 0.1e6), "reach": 4e-3}
GRATING = {"wavelength": WAVE, "map": "relief", "roughness": 0.05, "direction": (1.0, 0.0, 0.0)} | UNITS
AMPLITUDE = 0.05 * np.sqrt(2.0) * WAVE / (2.0 * np.pi)
DEPTHS = (0.3e-3, 1.6e-3, 2e-3)


@lru_cache
def below(force):
    load = Load(foot=(0, 0, 0), normal=(0, 0, 1), nodes=np.zeros(1, int), forces=np.array([[0.0, 0.0, -force]]))
    found = FakeBus(Stress(reach=4e-3, depths=DEPTHS)).publish(load)[0]
    return load, Subsurface(points=found.points, stress=found.stress, deflection=found.deflection)


def contact(force):
    return Contact(foot=(0, 0, 0), normal=(0, 0, 1), force=force, compression=0, indentation=0, compression_rate=0,
                   indentation_rate=0)  # fmt: skip


def near(x, speed, along=(1.0, 0.0, 0.0)):
    foot, slip = (tuple(scale * a for a in along) for scale in (x, speed))
    return Proximity(foot=foot, normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0, approach=0, slip=slip)


def slid(course, node=None, force=1.0, along=(1.0, 0.0, 0.0), **settings):
    """Answers while the foot is at the places of a course [m], and the node."""
    load, stress = below(force)
    node = node or Relief(**(GRATING | settings))
    bus = FakeBus(node, rate=RATE, load=load, contact=contact(force))
    out, before = [], course[0]
    for x in course:
        bus.hold("friction", Friction(force=(0, 0, 0), bristle=(0, 0, 0), stick=False))
        bus.hold("proximity", near(x, (x - before) * RATE, along))
        message = bus.publish(Subsurface(points=stress.points, stress=stress.stress, deflection=stress.deflection))[0]
        out.append((message.stress.copy(), message.deflection.copy(), message.points.copy()))
        before = x
    return out, node


def test_the_skin_follows_a_flat_relief_and_the_stress_has_its_frequency():
    course = SPEED * np.arange(400) / RATE
    out, _ = slid(course)
    at = out[0][2]
    receptor = int(np.argmin(np.hypot(*at[:, :2].T)))
    deflection = np.array([u[receptor, 2] for _, u, _ in out])
    modulus = 50e3 / (1.0 - 0.45**2)
    assert np.ptp(deflection) == approx(2.0 * modulus * AMPLITUDE, rel=0.02)  # full contact: u = h
    stress = np.array([s[receptor, 2] for s, _, _ in out])[100:]
    level = np.abs(np.fft.rfft(stress - stress.mean()))
    assert np.argmax(level) * RATE / len(stress) == approx(SPEED / WAVE, abs=RATE / len(stress))
    z = at[receptor, 2]
    k = 2.0 * np.pi / WAVE
    assert np.ptp(stress) == approx(modulus * k * AMPLITUDE * (1.0 + k * z) * np.exp(-k * z), rel=0.03)


def test_a_place_feels_the_same_forth_and_back_and_after_a_lift():
    x = np.concatenate([np.linspace(0, 5e-3, 200), np.linspace(5e-3, 0, 200)])
    out, _ = slid(x)
    forth, back = out[120][1], out[400 - 120 - 1][1]
    assert forth == approx(back, abs=0.02 * np.abs(forth).max())
    far = slid(np.array([3.1e-3, 3.1e-3]))[0][-1][1]
    again = slid(np.array([3.1e-3 + 2 * WAVE, 3.1e-3 + 2 * WAVE]))[0][-1][1]
    assert far == approx(again, abs=1e-9)


def test_a_turned_relief_gives_the_turned_stress(tmp_path):
    path = tmp_path / "units.csv"
    path.write_text("type,x,y,depth\nSA1,0,0,0.0003\nRA1,0,0,0.0016\n")
    course = SPEED * np.arange(21) / RATE
    along_x, along_y = (
        slid(course, along=along, direction=along, units=str(path))[0][-1] for along in ((1.0, 0, 0), (0, 1.0, 0))
    )
    # the y axis of the patch is the world's -y, because its z axis points into the tissue
    assert along_x[0][:, [1, 0, 2, 4, 3, 5]] * [1, 1, 1, -1, 1, 1] == approx(along_y[0], abs=1e-6)
    assert along_x[1][:, [1, 0, 2]] * [1, -1, 1] == approx(along_y[1], abs=1e-9)
    assert np.abs(along_x[0][:, 4]).min() > 100.0 and np.abs(along_x[0][:, 3]).max() < 1e-6


def test_without_force_there_is_no_relief():
    out, _ = slid(SPEED * np.arange(20) / RATE, force=0.0)
    assert not out[-1][0].any() and not out[-1][1].any()


def test_a_light_touch_bears_on_the_tops():
    """At the tops of a high relief a light touch presses more, and between them less, than the mean pressure."""
    out, node = slid(SPEED * np.arange(150) / RATE, force=0.3, roughness=0.4)
    assert node.own["full"] > 3.0 * 3.0 * 0.3 / (np.pi * 8e-3**2)
    receptor = int(np.argmin(np.hypot(*out[0][2][:, :2].T)))
    stress = np.array([s[receptor, 2] for s, _, _ in out])
    mean = stress.mean()
    assert stress.min() < 2.0 * mean < 0.0 and stress.max() > 0.6 * mean


def test_the_afferents_take_the_receptors_of_the_relief_and_refuse_others():
    fires = Afferents(**UNITS)
    bus = FakeBus(fires, rate=RATE)
    out, _ = slid(SPEED * np.arange(1200) / RATE, roughness=0.2, force=2.0)
    count = np.zeros(3)
    for stress, deflection, points in out:
        spikes = bus.publish(Subsurface(points=points, stress=stress, deflection=deflection))[0]
        count += np.bincount(fires.population.kind[spikes.unit], minlength=3)
    rates = count / np.bincount(fires.population.kind, minlength=3) / (1200 / RATE)
    assert np.all(rates > 5.0)
    others = FakeBus(Afferents(**UNITS, seed=4), rate=RATE)
    with pytest.raises(MessageError, match="at each of its 15 receptors"):
        others.publish(Subsurface(points=points, stress=stress, deflection=deflection))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"direction": (0.0, 0.0, 0.0)}, "'direction': found none"),
        ({"map": "friction"}, "'map': found a friction map"),
        ({"depths": (0.0, 1e-3, 1e-3)}, "'depths'"),
        ({"wavelength": 0.0, "spectrum": ((10.0, 1.0), (3000.0, 1.0))}, "of the shortest wavelengths in a period"),
    ],
)
def test_settings_that_do_not_fit_are_refused(given, message):
    with pytest.raises(SettingError, match=message):
        FakeBus(Relief(**(GRATING | given)))


def test_a_profile_keeps_its_heights(tmp_path):
    s = np.linspace(0.0, WAVE, 400)
    path = tmp_path / "profile.csv"
    path.write_text("s,height\n" + "\n".join(f"{a},{2e-4 * np.cos(2 * np.pi * a / WAVE)}" for a in s))
    node = Relief(profile=str(path), roughness=0.0, direction=(1.0, 0.0, 0.0), **UNITS)
    height, _ = relief.heights(*node.period(), node.finest)
    assert np.ptp(height) == approx(4e-4, rel=0.01)


def test_the_shipped_graph_joins_texture_and_afferents():
    made = find("texture").but(scene="grating")
    order = plan(made.load()).order
    assert order.index("stress") < order.index("relief") < order.index("afferents") and "texture" in order
    assert not {"stress", "relief", "afferents"} & set(plan(find("texture").load()).order)
    assert not any("different surfaces" in note for note in made.load().notes)
