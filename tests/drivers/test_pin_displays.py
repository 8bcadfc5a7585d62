"""Pin displays: their bytes, and their nodes against emulators at the other end of real serial lines."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pytest import approx

from palpate.drivers.emulate.faults import EmulatedFaults
from palpate.drivers.emulate.line import EmulatedLine
from palpate.drivers.errors import DeviceError
from palpate.drivers.pins import dotpad, inform
from palpate.launch.testing import FakeBus
from palpate.messages import Pins
from palpate.nodes.display import DotPad, InForm


def until(condition, seconds=10.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.01)
    raise AssertionError("it did not happen")


def pins(heights):
    return Pins(heights=np.asarray(heights, float), actuator=0.0, limited=False, valid=True)


def test_the_boards_lie_as_the_open_program_says():
    assert inform.place(0, 5) == (1, 0)  # its own example
    assert inform.place(0, 0) == (1, 5) and inform.place(1, 0)[0] == 9 and inform.place(2, 0)[0] == 5
    assert len(inform.PLACES) == 576
    assert [b for b in range(1, 13) if inform.inverted(b)] == [5, 6, 7, 8]
    assert [inform.line_of(b) for b in (1, 36, 37, 60, 61, 96)] == [2, 2, 1, 1, 0, 0]


def test_an_inform_message_byte_for_byte():
    assert inform.message(1, [50, 60, 70, 80, 90, 210]) == bytes((246, 1, 50, 60, 70, 80, 90, 210))
    assert inform.message(5, [50, 60, 70, 80, 90, 210], inform.ASK) == bytes((254, 5, 210, 200, 190, 180, 170, 50))


@given(st.floats(-1, 1, allow_nan=False))
def test_no_height_looks_like_a_message(height):
    assert inform.LOW <= inform.counts(height) <= inform.HIGH < inform.SEND
    assert inform.LOW <= inform.message(5, [inform.counts(height)] * 6)[2] <= inform.HIGH


def test_inform_shows_each_pin_where_it_belongs_and_reads_it_back():
    devices = [inform.EmulatedBoards(i) for i in range(3)]
    lines = [EmulatedLine(d, inform.BAUD, inform.NAME) for d in devices]
    driver = inform.InForm(lambda: [line.connect() for line in lines])
    driver.open()
    try:
        heights = np.linspace(0.0, 0.1, 576).reshape(24, 24)
        command = tuple(heights.ravel())
        driver.cycle(command)
        until(lambda: driver.cycle(command) and np.allclose(driver.measured, command, atol=0.1 / 160))
        board, pin = inform.place(17, 3)
        assert inform.inverted(board)
        assert devices[inform.line_of(board)].raw[board][pin] == 260 - inform.counts(heights[17, 3])
        assert sum(len(d.raw) for d in devices) == 96
    finally:
        driver.close()


def test_a_dot_pad_packet_byte_for_byte():
    asked = dotpad.pack(dotpad.Packet(0, dotpad.NAME_REQUEST, 0, b""))
    assert asked == bytes.fromhex("aa55 0005 00 0100 00 a4")
    assert dotpad.PacketReader().feed(asked) == [dotpad.Packet(0, 0x0100, 0, b"")]


@given(
    st.lists(st.tuples(st.integers(0, 255), st.integers(0, 0xFFFF), st.integers(0, 255), st.binary(max_size=40))),
    st.binary(max_size=20).filter(lambda b: b"\xaa" not in b),
    st.integers(1, 30),
)
def test_the_reader_finds_dot_pad_packets(given_packets, rubbish, piece):
    packets = [dotpad.Packet(*p) for p in given_packets]
    stream = b"".join(rubbish + dotpad.pack(p) for p in packets)
    reader, received = dotpad.PacketReader(), []
    for i in range(0, len(stream), piece):
        received += reader.feed(stream[i : i + piece])
    assert received == packets and reader.wrong == len(rubbish) * len(packets)


def test_cells_hold_two_columns_of_four_dots():
    dots = [False] * (8 * 4)
    dots[0 * 4 + 0] = dots[3 * 4 + 0] = dots[1 * 4 + 3] = True  # rows of four dots
    assert dotpad.cells(dots, 8, 4) == [bytes((0b00001001, 0b00100000)), bytes(2)]


def test_a_dot_pad_shows_a_picture_through_dropouts():
    device = dotpad.EmulatedDotPad()
    line = EmulatedLine(device, dotpad.BAUD, dotpad.NAME, EmulatedFaults(dropouts=0.1, garbled=0.1, seed=6))
    driver = dotpad.DotPad(line.connect)
    for _ in range(10):
        try:
            driver.open()
            break
        except DeviceError:
            driver.close()
    picture = np.zeros((40, 60))
    picture[10:30, 20:45] = 1.0
    want = dotpad.cells([bool(x) for x in picture.ravel()], 40, 60)
    try:
        until(lambda: driver.cycle(tuple(picture.ravel())) is not None and len(driver.shown) == 10)
        assert [device.dots[driver.first + i] for i in range(10)] == want
    finally:
        driver.close()


def test_another_size_of_dot_pad_is_told():
    driver = dotpad.DotPad(EmulatedLine(dotpad.EmulatedDotPad(8, 20), dotpad.BAUD, dotpad.NAME).connect)
    with pytest.raises(DeviceError, match=r"has 8 x 20 dots, expected 40 x 60\. Give these"):
        driver.open()
    driver.close()


def test_something_else_than_a_dot_pad_is_told():
    driver = dotpad.DotPad(EmulatedLine(inform.EmulatedBoards(0), 9600, "thing").connect)
    with pytest.raises(DeviceError, match="does not answer"):
        driver.open()
    driver.close()


@pytest.mark.parametrize("kind", [InForm, DotPad])
def test_a_display_node_shows_pins_in_the_middle(kind):
    node = kind(port="emulator")
    try:
        heights = np.zeros((6, 6))
        heights[2, 4] = 2e-3
        bus = FakeBus(node)
        bus.publish(pins(heights))
        driver = node.exchange.driver
        if kind is InForm:
            until(lambda: max(driver.measured) > 0.06 and min(driver.measured) > 0.04)
            shown = np.array(driver.measured).reshape(24, 24)
            assert shown[9 + 2, 9 + 4] == approx(0.05 + 10 * 2e-3, abs=1e-3)
            assert np.delete(shown.ravel(), 11 * 24 + 13) == approx(0.05, abs=1e-3)
        else:
            until(lambda: len(driver.shown) == 10 and any(any(line) for line in driver.shown.values()))
            dots = sum(int(byte).bit_count() for line in driver.shown.values() for byte in line)
            assert dots == 16
    finally:
        node.stop()
