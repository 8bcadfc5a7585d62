"""The Falcon's bytes, firmware load, homing and faults, tested with the emulator on a simulated clock."""

import numpy as np
import pytest
from falcon_arrays import forward, inverse
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.hand import Script
from palpate.drivers.errors import DeviceError
from palpate.drivers.falcon import firmware, frames
from palpate.drivers.falcon.driver import FalconDriver
from palpate.drivers.falcon.emulator import IMAGE, EmulatedFalcon, baud
from palpate.drivers.transport.ftdi import payload
from palpate.physics.device.falcon import HOME

INT16 = st.integers(-0x8000, 0x7FFF)
ZERO = (0.0, 0.0, 0.0)


class Time:
    """A clock that advances only by `sleep`."""

    def __init__(self):
        self.ns = 10**9

    def now(self):
        return self.ns

    def sleep(self, seconds):
        self.ns += max(0, round(seconds * 1e9))


def pair(faults=None, script=None, image=IMAGE, **more):
    time = Time()
    device = EmulatedFalcon(script, faults, now=time.now, sleep=time.sleep, **more)
    return FalconDriver(device.connect, None if image is None else lambda: image, time.now), device, time


def homed(driver, time):
    for _ in range(1000):
        sample = driver.cycle(ZERO)
        if sample is not None and sample.homed:
            return sample
    raise AssertionError(f"not homed after {time.ns} ns")


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, b"AAAA"), (-1, b"PPPP"), (1447, b"HKFA"), (-1447, b"JFKP"), (4095, b"PPPA"), (-4096, b"AAAP"),
     (32767, b"PPPH"), (-32768, b"AAAI")],
)  # fmt: skip
def test_words_equal_those_of_the_open_driver(value, text):
    assert frames.words((value, 0, 0))[:4] == text
    assert frames.numbers(text + b"AAAAAAAA")[0] == value


def test_commands_equal_those_of_the_open_driver():
    assert frames.command((0, 0, 0)) == b"<AAAAAAAAAAAAAA>"
    assert frames.command((1000, -1000, 4095), frames.BLUE) == b"<IODAIBMPPPPAEA>"


@given(INT16, INT16, INT16, st.integers(0, 15), st.tuples(st.booleans(), st.booleans(), st.booleans()))
def test_a_report_survives_a_round_trip(a, b, c, buttons, marks):
    assert frames.read(frames.report((a, b, c), buttons, marks)) == ((a, b, c), buttons, marks)


@given(st.lists(st.one_of(st.binary(max_size=20), st.tuples(INT16, INT16, INT16)), max_size=12), st.integers(1, 9))
def test_the_reader_finds_frames_among_random_bytes(parts, piece):
    """Random bytes invalidate at most the adjacent frame."""
    stream, whole = b"", []
    for part in parts:
        if isinstance(part, bytes):
            stream += part.replace(b"<", b"x")
        else:
            frame = frames.report(part, 0, (True, True, True))
            stream, whole = stream + frame, [*whole, frame]
    reader, received = frames.FalconFrameReader(), []
    for i in range(0, len(stream), piece):
        received += reader.feed(stream[i : i + piece])
    assert received == whole


@given(st.integers(0, 15), st.integers(0, 255))
def test_one_wrong_byte_invalidates_one_frame(at, byte):
    good = [frames.report((i, -i, 7 * i), 0, (True, True, True)) for i in range(4)]
    spoilt = good[1][:at] + bytes((byte,)) + good[1][at + 1 :]
    received = frames.FalconFrameReader().feed(good[0] + spoilt + good[2] + good[3])
    assert received[0] == good[0] and received[-2:] == good[2:]


@given(st.tuples(*[st.floats(-1e6, 1e6)] * 3))
def test_saturation_keeps_the_direction(torques):
    words = np.array(frames.motors(torques))
    assert np.abs(words).max() <= frames.LARGEST
    wanted = -1e4 * np.array(torques)
    wanted *= min(1.0, frames.LARGEST / max(np.abs(wanted).max(), 1.0))
    assert words == approx(wanted, abs=0.5)


def test_the_divisors_give_the_known_baud_rates():
    assert baud(firmware.SLOW) == approx(9600, rel=1e-3)
    assert baud(firmware.LOADING) == approx(142857, rel=1e-5)
    assert baud(firmware.RUNNING) == 1.5e6


@pytest.mark.parametrize("flaky", [0, 1, 2, 5])
def test_loading_the_firmware_is_retried(flaky):
    driver, device, time = pair(EmulatedFaults(flaky=flaky))
    driver.open()
    assert device.running and driver.attempts == flaky + 1
    # Image and echo are sent at 142 857 baud, block by block: the lower bound is twice ten bits per byte.
    assert time.ns - 10**9 > len(IMAGE) * 20 / 142857 * 1e9


def test_a_load_that_always_fails_is_an_error_with_a_remedy():
    driver, device, _ = pair(EmulatedFaults(flaky=99))
    with pytest.raises(DeviceError, match=r"10 attempts: the echo .* is wrong\. Switch the Falcon off"):
        driver.open()
    assert not device.running


def test_running_firmware_is_not_loaded_again():
    driver, device, _ = pair(loaded=True, image=None)
    driver.open()
    assert device.attempts == 0


def test_the_error_without_an_image_names_its_source():
    driver, _, _ = pair(image=None)
    with pytest.raises(DeviceError, match=r"no firmware runs.*nvent_firmware\.bin"):
        driver.open()


def test_a_wrong_image_is_an_error():
    driver, device, _ = pair(image=b"something else entirely")
    with pytest.raises(DeviceError, match="firmware of 23 bytes was loaded, but the Falcon sends no frames"):
        driver.open()
    assert device.attempts == 1


def test_a_missing_or_empty_image_is_an_error(tmp_path):
    with pytest.raises(DeviceError, match=r"none\.bin: No such file.*Give the image"):
        firmware.image(str(tmp_path / "none.bin"))
    (tmp_path / "empty.bin").write_bytes(b"")
    with pytest.raises(DeviceError, match="an empty file"):
        firmware.image(str(tmp_path / "empty.bin"))


def test_commands_and_angles_are_invalid_before_homing():
    driver, device, _ = pair(homing=0.1)
    driver.open()
    sample = driver.cycle(ZERO)
    assert not sample.homed and sample.joints == () and device.lights == frames.RED
    sample = homed(driver, device)
    driver.cycle(ZERO)
    assert device.lights == frames.GREEN
    assert sample.joints == approx(inverse(HOME)[0][:, 0], abs=6.4e-4 / 2)
    assert sample.position == approx(HOME, abs=6e-5)


def test_torques_move_the_hand():
    """0.6 N upwards on an arm of 300 N/m: 2 mm, within the encoder resolution."""
    from falcon_arrays import torque

    driver, device, time = pair(script=Script(stiffness=300.0, damping=12.0))
    driver.open()
    homed(driver, time)
    push = np.array([0.0, 0.0, 0.6])
    for _ in range(1500):
        place = device.hand.position.copy()
        sample = driver.cycle(tuple(torque(push, place)[0]))
    assert np.array(sample.position) - HOME == approx(push / 300.0, abs=7e-5)
    assert forward(sample.joints)[0] == approx(sample.position, abs=1e-7)


def test_an_answer_takes_about_the_latency_timer():
    driver, _, time = pair(loaded=True)
    driver.open()
    homed(driver, time)
    begun = time.ns
    for _ in range(100):
        assert driver.cycle(ZERO) is not None
    assert (time.ns - begun) / 100 == approx(1e6, rel=0.05)


def test_dropouts_and_wrong_bytes_only_invalidate_their_frames():
    driver, _, time = pair(EmulatedFaults(dropouts=0.05, garbled=0.05, seed=3), loaded=True)
    driver.open()
    homed(driver, time)
    samples = [driver.cycle(ZERO) for _ in range(2000)]
    lost = sum(s is None for s in samples)
    assert 0.05 * 2000 < lost < 0.13 * 2000  # some wrong bytes have no effect
    assert all(np.linalg.norm(np.subtract(s.position, HOME)) < 2e-3 for s in samples if s is not None and s.homed)


def test_glitches_are_rejected_and_a_real_jump_is_accepted():
    driver, device, time = pair(EmulatedFaults(glitches=0.05, noise=0.2, seed=5), loaded=True)
    driver.open()
    homed(driver, time)
    sample = driver.cycle(ZERO)
    for _ in range(500):
        glitches, last = driver.glitches, sample.time
        sample = driver.cycle(ZERO)
        assert sample.position == approx(HOME, abs=2e-4)
        assert (sample.time == last) == (driver.glitches > glitches), "the last place has the time of its frame"
    assert driver.glitches > 5
    device.hand.position[:] = (0.02, 0.0, 0.12)
    device.hand.points[:] = (0.02, 0.0, 0.12)
    for _ in range(30):
        sample = driver.cycle(ZERO)
    assert sample.position == approx((0.02, 0.0, 0.12), abs=3e-4)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize(("jump", "accepted"), [(0.2e-3, True), (-0.2e-3, True), (1.5e-3, False), (-1.5e-3, False)])
def test_a_grip_at_rest_does_not_jump_by_more_than_it_can_move_in_a_millisecond(axis, jump, accepted):
    """At the 0.4 mm of the documentation, a grip at rest would reach 0.4 m/s within 1 ms: 400 m/s². The path is that
    of the grip; the emulator's inverse kinematics make the counts of it."""
    driver, device, time = pair(loaded=True)
    driver.open()
    homed(driver, time)
    for _ in range(20):
        before = driver.cycle(ZERO)
    place = np.array(HOME)
    place[axis] += jump
    device.hand.position[:], device.hand.points[:] = place, place
    sample, begun = driver.cycle(ZERO), time.ns
    for _ in range(6):  # its answer arrives some cycles later
        if sample.position == before.position:
            sample = driver.cycle(ZERO) or sample
    seen = driver.glitches > 0
    assert seen is not accepted and time.ns - begun < 20e6
    if accepted:
        assert sample.position[axis] - HOME[axis] == approx(jump, abs=1e-4)


def test_angles_at_which_the_arms_do_not_meet_are_no_sample():
    """Each encoder within its range, but no point is reached by all three arms."""
    driver, device, time = pair(loaded=True)
    driver.open()
    homed(driver, time)
    device._count = lambda i, place, homed: (2804, 1095, 89)[i]
    samples = [driver.cycle(ZERO) for _ in range(20)]
    assert (
        not any(sample.homed for sample in samples[8:]) and driver.refused["with angles at which the arms do not meet"]
    )


def test_encoders_with_random_counts_are_no_sample():
    """They are never consistent: the last valid position must not stay."""
    driver, device, time = pair(loaded=True)
    driver.open()
    homed(driver, time)
    random = np.random.default_rng(4)
    device._count = lambda i, place, homed: int(random.integers(-4000, 4000))
    samples = [driver.cycle(ZERO) for _ in range(100)]
    assert sum(sample.homed for sample in samples[8:] if sample is not None) == 0
    assert driver.refused["with encoders that jump"] > 80


def test_a_silent_falcon_does_not_block_the_driver():
    driver, _, time = pair(EmulatedFaults(silent=0.5), loaded=True)
    driver.open()
    time.ns += 10**9
    begun = time.ns
    assert driver.cycle(ZERO) is None
    assert time.ns - begun < 6e6


def test_an_unplugged_falcon_is_an_error_until_it_is_plugged_in():
    driver, _, time = pair(EmulatedFaults(unplug=1.0, back=3.0), loaded=True)
    driver.open()
    time.ns += 1_100_000_000
    with pytest.raises(DeviceError, match="gone") as raised:
        driver.cycle(ZERO)
    assert raised.value.lost
    driver.close()
    with pytest.raises(DeviceError, match="unplugged"):
        driver.open()
    time.ns += 2 * 10**9
    driver.open()
    homed(driver, time)


def test_a_connection_does_not_survive_an_unnoticed_unplugging():
    """As on a machine that stalled meanwhile: connections opened before are lost."""
    driver, _, time = pair(EmulatedFaults(unplug=1.0, back=3.0), loaded=True)
    driver.open()
    time.ns += 4 * 10**9
    with pytest.raises(DeviceError, match="gone"):
        driver.cycle(ZERO)
    driver.close()
    driver.open()
    homed(driver, time)


def test_the_modem_bytes_of_each_packet_are_removed():
    assert payload(b"\x01\x60") == b""
    assert payload(b"\x01\x60abc") == b"abc"
    first, second = bytes(range(100, 162)), b"zz"
    assert payload(b"\x01\x60" + first + b"\x01\x60" + second) == first + second
