"""Textures on the test bus: spectrum, scaling with speed and force, bounds, energy, blocks, bad settings."""

import numpy as np
import pytest
from pytest import approx

from palpate.launch.testing import FakeBus
from palpate.messages import Contact, Friction, Proximity
from palpate.nodes import friction
from palpate.nodes.base import SettingError
from palpate.nodes.base.texture_file import Model, Texture
from palpate.nodes.texture import Autoregressive, Spectral
from palpate.physics.texture.surface import density, third_octaves

SPECTRUM = ((200.0, 1.0), (600.0, 1.0), (2000.0, 0.02))
PERIOD = 2**13 / 16 / 2000 * 2  # [m] of a random surface of this spectrum: 70/200 m, up to the next power of two


def press(force):
    return Contact(
        foot=(0, 0, 0), normal=(0, 0, 1), force=force,
        compression=0, indentation=0, compression_rate=0, indentation_rate=0,
    )  # fmt: skip


def near(speed, across=0.0, at=0.0):
    return Proximity(
        foot=(at, 0, 0), normal=(0, 0, 1), coordinates=(0, 0), element=0, gap=0, approach=0, slip=(speed, across, 0)
    )


def rubbed(force, mu=0.5, **more):
    return Friction(force=(mu * force, 0, 0), **({"bristle": (0, 0, 0), "stick": False} | more))


def stroke(node, speed, force, time, rate=50.0):
    """Samples [N] of a steady stroke after a first step."""
    bus = FakeBus(node, rate=rate, contact=press(force), proximity=near(speed))
    answers = bus.publish(*[rubbed(force)] * (1 + round(time * rate)))
    return np.concatenate([vibration.lateral for _, vibration in answers[1:]])


@pytest.mark.parametrize("force", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("speed", [0.02, 0.05, 0.1, 0.2, 0.3])
def test_the_rendered_spectrum_equals_the_target_in_every_third_octave(speed, force):
    """S_f(f) = f_n^2 S(f/v)/v, integrated over each band by a fine sum, over one period of the surface."""
    sampling, rms = 10e3, 0.05
    x = stroke(Spectral(spectrum=SPECTRUM, roughness=rms, seed=3), speed, force, PERIOD / speed)
    power = 2.0 * np.abs(np.fft.rfft(x)) ** 2 / len(x) ** 2
    at = np.fft.rfftfreq(len(x), 1.0 / sampling)
    fine = np.linspace(1.0, 2100.0 * speed, 200_000)
    wanted = (rms * force) ** 2 * density(np.array(SPECTRUM), fine / speed)
    wanted /= density(np.array(SPECTRUM), fine / speed).sum()
    centres = third_octaves(200.0 * speed, 2000.0 * speed)
    assert len(centres) >= 9
    for centre in centres:
        low, high = centre / 10**0.05, centre * 10**0.05
        found = power[(at >= low) & (at < high)].sum()
        assert 10.0 * np.log10(found / wanted[(fine >= low) & (fine < high)].sum()) == approx(0.0, abs=1.0), centre


def test_twice_the_speed_gives_every_second_sample():
    slow, fast = (stroke(Spectral(spectrum=SPECTRUM), speed, 1.0, 0.4) for speed in (0.05, 0.1))
    place = 2 * np.arange(200, 900) + 1 + 200  # the first 200 samples have half of the path
    assert slow[place] == approx(fast[200:900], abs=1e-10)


def test_a_grating_has_the_frequency_speed_over_wavelength():
    x = stroke(Spectral(wavelength=1e-3, roughness=0.1), 0.08, 2.0, 1.0)
    level = np.abs(np.fft.rfft(x)) * 2 / len(x)
    assert np.argmax(level) == 80 and level[80] == approx(0.1 * 2.0 * np.sqrt(2), rel=2e-3)


def test_the_fluctuation_scales_with_powers_of_force_and_speed():
    one = Spectral(wavelength=1e-3, force_exponent=0.5, speed_exponent=2.0)
    at = {key: stroke(one, *key, 0.5).std() for key in ((0.1, 1.0), (0.1, 4.0), (0.2, 1.0))}
    assert at[0.1, 1.0] == approx(0.05, rel=1e-2)
    assert at[0.1, 4.0] == approx(2 * at[0.1, 1.0], rel=1e-2) and at[0.2, 1.0] == approx(4 * at[0.1, 1.0], rel=1e-2)


def test_the_texture_is_silent_at_rest_in_the_air_and_while_sticking():
    bus = FakeBus(Spectral(roughness=1.0), contact=press(2.0), proximity=near(0.1))
    assert np.any(bus.publish(rubbed(2.0))[0][1].lateral)
    for held, friction_ in (
        ({"proximity": near(0.0)}, rubbed(2.0)),
        ({"contact": press(0.0)}, rubbed(0.0)),
        ({}, rubbed(2.0, stick=True)),
    ):
        for name, message in ({"contact": press(2.0), "proximity": near(0.1)} | held).items():
            bus.hold(name, message)
        passed, vibration = bus.publish(friction_)[0]
        assert passed.force == friction_.force
        assert not np.any(vibration.lateral) and vibration.speed == 0.0


def test_presliding_moves_the_bristles_and_not_the_surface():
    """A finger that moves only by the strain of its bristles does not slide."""
    bus = FakeBus(Spectral(roughness=1.0), contact=press(2.0), proximity=near(0.01))
    strained = [rubbed(2.0, bristle=(1e-5 * (i + 1), 0, 0), stored=(1e-9 * i,)) for i in range(5)]
    answers = [bus.publish(message)[0] for message in strained]
    assert all(vibration.speed == approx(0.0, abs=1e-12) for _, vibration in answers)


@pytest.mark.parametrize("law", ["LuGre", "ElastoPlastic", "Coulomb"])
@pytest.mark.parametrize("seed", [0, 1])
def test_friction_and_texture_never_generate_energy(law, seed):
    """D = W - V of both together never falls, under a random stroke, an oscillating load and an extreme roughness."""
    node = getattr(friction, law)()
    law_bus = FakeBus(node, contact=press(1.0), proximity=near(0.0))
    bus = FakeBus(Spectral(roughness=10.0, share=1.0, spectrum=SPECTRUM), contact=press(1.0), proximity=near(0.0))
    random = np.random.default_rng(seed)
    work = alone = stored = 0.0
    highest, base, force = 0.0, 0.0, 0.0
    v = np.zeros(2)
    for i in range(1500):
        v = 0.98 * v + 0.02 * random.normal(size=2) * 0.5
        v = np.zeros(2) if 600 < i < 700 else v
        force = max(1.0 + np.sin(0.01 * i), 0.0)
        contact, place = press(force), near(*v)
        law_bus.hold("proximity", place)
        (plain,) = law_bus.publish(contact)
        bus.hold("contact", contact)
        bus.hold("proximity", place)
        (answer, vibration) = bus.publish(plain)[0]
        work += np.dot(answer.force[:2], v) * 1e-3
        alone += np.dot(plain.force[:2], v) * 1e-3
        stored = plain.stored[0] if plain.stored else 0.0
        base = max(base, alone - stored)
        highest = max(highest, work - stored)
        # no more than friction alone
        assert highest - (work - stored) <= base - (alone - stored) + 1e-12
        assert np.abs(vibration.lateral).max(initial=0.0) <= np.hypot(*plain.force[:2]) + 1e-12
    assert work > 0.0


def test_the_fluctuation_is_bounded_by_the_share_of_friction():
    x = stroke(Spectral(roughness=5.0, share=0.4), 0.1, 2.0, 0.5)
    assert np.abs(x).max() == approx(0.4 * 0.5 * 2.0)


def test_friction_gets_the_mean_of_each_block_along_the_slip():
    bus = FakeBus(Spectral(normal=0.5), contact=press(2.0), proximity=near(0.0, 0.1))
    given = Friction(force=(0.0, 1.0, 0.0), bristle=(0, 0, 0), stick=False)
    passed, vibration = bus.publish(*[given] * 5)[-1]
    assert passed.force == approx((0.0, 1.0 + vibration.lateral.mean(), 0.0))
    assert vibration.normal == approx(0.5 * vibration.lateral) and len(vibration.lateral) == 10


@pytest.mark.parametrize("sampling", [10e3, 44.1e3, 1234.5])
def test_blocks_are_continuous_at_any_rate_of_the_graph(sampling):
    node = Spectral(wavelength=5e-3, sampling=sampling)
    quick, slow = (stroke(node, 0.1, 1.0, 1.0 - 1.0 / rate, rate) for rate in (1000.0, 100.0))
    assert len(quick) + 1e-3 * sampling == approx(sampling, abs=1.01)
    count = min(len(quick), len(slow)) - round(0.02 * sampling)
    shift = round(0.009 * sampling)
    if sampling == 10e3:
        assert quick[shift : shift + count - shift] == approx(slow[: count - shift], abs=1e-9)
    assert np.abs(np.diff(quick)).max() < 1.01 * np.abs(quick).max() * 2 * np.pi * 20.0 / sampling


def strokes(node, places, force=1.0, speed=0.1):
    """Lateral samples (n) [N] of a finger at these places [m] of its foot point, one per tick of 1 ms, in contact."""
    bus, samples = FakeBus(node, contact=press(force), proximity=near(0.0)), []
    before = places[0]
    for at in places:
        v = (at - before) * 1e3
        bus.hold("proximity", near(v, at=at))
        samples.append(bus.publish(rubbed(force, mu=0.5 * np.sign(v)))[0][1].lateral)
        before = at
    return np.concatenate(samples)


def forth_and_back(first=0.0, path=2e-3, step=1e-4):
    there = np.arange(first, first + path + 0.5 * step, step)
    return np.concatenate([there, there[-2::-1]])


def test_a_friction_map_is_met_again_on_the_way_back_and_opposes_the_motion_there_too():
    node = Spectral(spectrum=SPECTRUM, direction=(2.0, 0.0, 0.0), roughness=0.05)
    x = strokes(node, forth_and_back())[10:]
    assert x.std() > 0.01 and x[220:380] == approx(x[:200][::-1][21:181], abs=1e-9)


FLANKS = (4.5e-3, 5.5e-3)


def gauss(s):
    return np.exp(-0.5 * ((s - 5e-3) / 0.5e-3) ** 2)


def profile_file(tmp_path, column, size):
    """A bump of 0.5 mm standard deviation at 5 mm of a profile of 10 mm."""
    s = np.linspace(0.0, 10e-3, 2001)
    rows = np.column_stack([s, size * gauss(s)])
    np.savetxt(tmp_path / "bump.csv", rows, delimiter=",", header=f"s,{column}", comments="")
    return str(tmp_path / "bump.csv")


def over_the_bump(profile):
    """Mean force along x on the left and the right flank of the bump, of a stroke forth and one back."""
    node = Spectral(profile=profile, roughness=0.0, direction=(1, 0, 0), shortest=0.5e-3)
    places = forth_and_back(3e-3, 4e-3, 2e-5)
    direction = np.sign(np.diff(places, prepend=places[0]))
    along_x = strokes(node, places).reshape(len(places), -1).mean(axis=1) * direction
    middle = places - 1e-5 * direction  # of the path in a tick
    return [[along_x[(abs(middle - flank) < 0.2e-3) & (direction == way)].mean() for flank in FLANKS]
            for way in (1.0, -1.0)]  # fmt: skip


def near_flanks(values):
    """Mean of a function of the place [m] near each flank."""
    return [values(np.linspace(flank - 0.2e-3, flank + 0.2e-3, 401)).mean() for flank in FLANKS]


def test_a_bump_of_a_relief_is_a_bump_forth_and_back(tmp_path):
    """The force of the slope of h on the body is f_n h' along x for both directions of motion: a finger is pushed away
    from the top on both flanks."""
    forth, back = over_the_bump(profile_file(tmp_path, "height", 1e-4))
    slope = near_flanks(lambda s: -1e-4 * (s - 5e-3) / 0.5e-3**2 * gauss(s))
    assert slope[0] > 0.1 > -0.1 > slope[1]
    assert forth == approx(slope, rel=0.02) and back == approx(slope, rel=0.02)


def test_a_patch_of_higher_friction_resists_forth_and_back(tmp_path):
    forth, back = over_the_bump(profile_file(tmp_path, "friction", 0.2))
    mean = 0.2 * np.sqrt(2 * np.pi) * 0.5e-3 / 10e-3
    more = near_flanks(lambda s: 0.2 * gauss(s) - mean)
    assert forth == approx(more, rel=0.02) and back == approx([-each for each in more], rel=0.02)


def test_a_grating_with_the_map_relief_changes_its_share_of_friction_with_the_direction():
    """Along the slip a slope's force changes its sign, a fluctuation of friction does not."""
    places = forth_and_back(0.0, 4e-3)
    for kind, sign in (("friction", 1.0), ("relief", -1.0)):
        x = strokes(Spectral(wavelength=2e-3, map=kind, direction=(1, 0, 0), roughness=0.1), places)[10:]
        assert x[420:780] == approx(sign * x[:400][::-1][21:381], abs=1e-9), kind


@pytest.mark.parametrize("offset", [0.5e-3, 1.3e-3])
def test_with_a_direction_the_surface_stays_on_the_organ_after_a_lift(offset):
    """The finger lifts, and lands at an offset from its first place: the grating is where it was."""
    node = Spectral(wavelength=2e-3, roughness=0.1, direction=(1, 0, 0))
    bus, found = FakeBus(node, contact=press(1.0), proximity=near(0.0)), []
    for begin in (0.0, offset):
        samples = []
        for k in range(40):
            bus.hold("contact", press(1.0))
            bus.hold("proximity", near(0.1, at=begin + 1e-4 * k))
            samples.append(bus.publish(rubbed(1.0))[0][1].lateral)
        found.append(np.concatenate(samples))
        for _ in range(10):
            bus.hold("contact", press(0.0))
            bus.hold("proximity", near(0.3, at=7e-3))
            bus.publish(rubbed(0.0))
    shift = round(offset / 1e-5)
    assert found[1][50:250] == approx(found[0][50 + shift : 250 + shift], abs=1e-9)


def test_a_wrong_slip_velocity_does_not_move_the_surface_over_the_organ():
    """A velocity that is 5 % too high shifts the grating by at most 5 % of `LOCK`."""
    node = Spectral(wavelength=2e-3, roughness=0.1, direction=(1, 0, 0))
    bus = FakeBus(node, contact=press(1.0), proximity=near(0.0))
    for k in range(1000):
        bus.hold("proximity", near(0.105, at=1e-4 * k))
        bus.publish(rubbed(1.0))
    period = 2e-3
    apart = (float(node.own["place"]) - 999e-4 + period / 2) % period - period / 2
    assert abs(apart) < 1.1 * 0.05 * 2e-3


def test_a_profile_acts_by_its_slope(tmp_path):
    s = np.linspace(0.0, 0.05, 4001)
    rows = np.column_stack([s, 1e-5 * np.sin(2 * np.pi * s / 2e-3) + 0.01 * s])
    np.savetxt(tmp_path / "p.csv", rows, delimiter=",", header="s,height", comments="")
    node = Spectral(profile=str(tmp_path / "p.csv"), roughness=0.0, shortest=0.5e-3)
    x = stroke(node, 0.1, 1.0, 1.0)
    level = np.abs(np.fft.rfft(x)) * 2 / len(x)
    assert np.argmax(level) == 50 and level[50] == approx(1e-5 * 2 * np.pi / 2e-3, rel=0.02)


def test_a_seed_defines_a_surface():
    one, again, other = (stroke(Spectral(seed=seed), 0.1, 1.0, 0.1) for seed in (1, 1, 2))
    assert one.tobytes() == again.tobytes() and np.abs(one - other).max() > 0.01


@pytest.mark.parametrize(
    ("given", "reported"),
    [
        (
            {"speed": 5.0},
            r"it reaches 1e\+04 Hz, beyond half of 'sampling', 5000 Hz. The highest speed that fits is 2.5",
        ),
        ({"spectrum": ((10.0, 1.0),)}, "two or more pairs"),
        ({"spectrum": ((10.0, 1.0), (100.0, -1.0))}, "a power density > 0"),
        ({"spectrum": ((100.0, 1.0), (10.0, 1.0))}, "a rising spatial frequency"),
        ({"wavelength": 1e-3, "profile": "p.csv"}, "found both"),
    ],
)
def test_bad_settings_are_errors_with_a_remedy(given, reported):
    with pytest.raises(SettingError, match=reported):
        Spectral(**given)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("s,h\n0,0\n", "expected height too"),
        ("s,height\n0,0\n1,x\n", "row 3, column 'height': found 'x', expected a number"),
        ("s,height\n0,0\n1e-3,nan\n", "finite"),
        ("s,height\n0,0\n1e-3,1\n", "at least 4 rows"),
        ("s,height\n" + "".join(f"{i}0,1\n" for i in range(9)), "m long"),
        ("s,height\n" + "".join(f"{i}e-3,1\n" for i in range(9)), "flat"),
    ],
)
def test_a_bad_profile_is_an_error_with_the_reason(tmp_path, text, reported):
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(SettingError, match=reported):
        Spectral(profile=str(tmp_path / "p.csv")).start()
    with pytest.raises(SettingError, match="No such file"):
        Spectral(profile=str(tmp_path / "none.csv")).start()
    with pytest.raises(SettingError, match="times its lowest"):
        Spectral(spectrum=((1.0, 1.0), (1e4, 1.0))).start()


def test_a_finger_that_is_too_fast_is_reported_without_vibration():
    node = Spectral()
    bus = FakeBus(node, contact=press(1.0), proximity=near(3.0))
    passed, vibration = bus.publish(*[rubbed(1.0)] * 3)[-1]
    assert not np.any(vibration.lateral) and passed.force == (0.5, 0, 0)
    assert "faster than 2.5 m/s" in node.notes()[0] and not node.notes()


@pytest.fixture
def wood(tmp_path):
    import msgspec

    models = [
        Model(speed=v, force=f, rms=0.2 * f * v, lsf=(3.0 * v, 5.0 * v, 1.5, 2.5))
        for v in (0.05, 0.1, 0.2)
        for f in (0.5, 1.0, 2.0)
    ]
    path = tmp_path / "wood.json"
    path.write_bytes(msgspec.json.encode(Texture(sampling=5000.0, quantity="force", models=tuple(models))))
    return str(path)


def test_an_autoregressive_texture_has_the_rms_and_the_spectrum_of_its_model(wood):
    from palpate.physics.texture.autoregressive import spectrum

    for speed, force in ((0.05, 2.0), (0.2, 0.5)):
        x = stroke(Autoregressive(model=wood), speed, force, 20.0)
        rms = 0.02 * force * speed / 0.1
        assert x.std() == approx(rms, rel=0.05)
        blocks = x[: len(x) // 1000 * 1000].reshape(-1, 1000) * np.hanning(1000)
        found = np.mean(np.abs(np.fft.rfft(blocks, axis=1)) ** 2, axis=0) * 2 / 5000 / np.sum(np.hanning(1000) ** 2)
        at = np.fft.rfftfreq(1000, 1 / 5000)
        lsf = np.array((0.3 * speed / 0.1, 0.5 * speed / 0.1, 1.5, 2.5))
        wanted = spectrum(lsf, rms, 5000.0, at)
        for centre in third_octaves(60.0, 2000.0):
            inside = (at >= centre / 10**0.05) & (at < centre * 10**0.05)
            assert 10 * np.log10(found[inside].sum() / wanted[inside].sum()) == approx(0.0, abs=1.0)


def test_an_autoregressive_texture_is_silent_at_rest_and_ends_its_fluctuation_with_the_force(wood):
    bus = FakeBus(Autoregressive(model=wood), contact=press(1.0), proximity=near(0.1))
    assert np.any(bus.publish(*[rubbed(1.0)] * 2)[1][1].lateral)
    bus.hold("proximity", near(0.0))
    assert not np.any(bus.publish(rubbed(1.0))[0][1].lateral)
    light = [stroke(Autoregressive(model=wood), speed, force, 2.0).std() for speed, force in ((0.1, 0.5), (0.1, 0.05))]
    assert light[1] == approx(0.1 * light[0], rel=1e-6)


def test_a_sound_card_gets_the_vibration_at_its_rate():
    from palpate.messages.vibration import Vibration
    from palpate.nodes.actuator import SoundCard

    node = SoundCard(device="none", gain=1.0)
    bus = FakeBus(node)
    t = np.arange(1, 2001) / 10e3
    wave = np.sin(2 * np.pi * 50 * t)
    for block in wave[:1500].reshape(-1, 10):
        bus.publish(Vibration(lateral=block, normal=np.zeros(0), sampling=10e3, speed=0.1))
    assert node.written == approx(0.15 * 48e3, abs=6)
    out = np.zeros((node.written + 10, 1), np.float32)
    node.fill(out, len(out), None, None)
    start = np.arange(node.written) / 48e3
    assert out[: node.written, 0] == approx(np.sin(2 * np.pi * 50 * (start + 1e-4)), abs=0.01)
    assert not out[node.written :].any()


def test_the_buffer_of_an_unread_sound_card_does_not_grow():
    from palpate.messages.vibration import Vibration
    from palpate.nodes.actuator import SoundCard

    node = SoundCard(device="none")
    bus = FakeBus(node)
    for _ in range(500):
        bus.publish(Vibration(lateral=np.ones(10), normal=np.zeros(0), sampling=10e3, speed=0.1))
    assert node.written <= len(node.ring) and node.ring.max() == 1.0


def test_without_its_package_the_sound_card_names_the_package(monkeypatch):
    import sys

    from palpate.nodes.actuator import SoundCard

    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(SettingError, match=r"the package sounddevice is not installed; .*palpate\[feel\]"):
        SoundCard().start()


def test_a_sound_card_plays_through_its_stream_and_closes_it(monkeypatch):
    import sys
    from types import SimpleNamespace

    from palpate.nodes.actuator import SoundCard

    opened = []

    class Stream:
        def __init__(self, **given):
            if given["device"] == "broken":
                raise ValueError("No output device matching 'broken'")
            self.given, self.running = given, None
            opened.append(self)

        def start(self):
            self.running = True

        def close(self):
            self.running = False

    fake = SimpleNamespace(OutputStream=Stream, PortAudioError=RuntimeError)
    monkeypatch.setitem(sys.modules, "sounddevice", fake)
    node = SoundCard(device="3")
    node.start()
    assert opened[0].running and opened[0].given["device"] == 3 and opened[0].given["channels"] == 1
    node.stop()
    node.stop()
    assert opened[0].running is False
    with pytest.raises(SettingError, match=r"No output device matching 'broken'.*device: none plays nothing"):
        SoundCard(device="broken").start()
