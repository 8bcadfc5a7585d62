"""Frames in parcels: bounded, complete, in order, and nothing but whole frames when parcels are lost or damaged."""

import random

import pytest

from palpate.launch.run.wire.parcels import LONGEST, PART, SEVERAL, Packer, Unpacker

STREAMS = (b"a\0", b"tissue\0", b"a-long-name.Surface\0")
HEAD = 64  # [bytes] of marks and numbers, at most
ROOM = 40 * LONGEST


def frames(draw: random.Random, count: int) -> list[bytes]:
    lengths = (0, 1, 30, 300, LONGEST - 1, LONGEST, LONGEST + 1, 3 * LONGEST, 7 * LONGEST + 5)
    made = [draw.choice(STREAMS) + draw.randbytes(draw.choice(lengths)) for _ in range(count)]
    return [b"!health\0" + b"\x80" if draw.random() < 0.1 else frame for frame in made]


def by_stream(found: list[bytes]) -> dict[bytes, list[bytes]]:
    sorted_out: dict[bytes, list[bytes]] = {}
    for frame in found:
        sorted_out.setdefault(frame[: frame.index(b"\0")], []).append(frame)
    return sorted_out


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("seed", range(50))
def test_all_frames_arrive_in_bounded_parcels(seed, together):
    draw = random.Random(seed)
    packer, unpacker, sent, got = Packer(together), Unpacker(ROOM), [], []
    for number in range(5):
        burst = frames(draw, draw.randint(0, 12))
        sent += burst
        for parcel in packer.pack(burst, rest=number == 4 or draw.random() < 0.5):
            assert len(parcel) <= LONGEST + HEAD and parcel.startswith((*STREAMS, b"!health\0"))
            got += unpacker.unpack(parcel)
    assert by_stream(got) == by_stream(sent)
    if not together:
        assert got == sent


def test_short_frames_share_parcels():
    packer = Packer(together=True)
    burst = [b"a\0" + b"x" * 100, b"b\0" + b"y" * 100] * 50
    assert len(list(packer.pack(burst))) == 2


def test_short_frames_wait_for_others_of_their_stream_until_they_fill_a_parcel():
    """At 5 kHz a short frame of each stream every 2 ms filled the queue of a busy logger with parcels of 2 kB."""
    packer, sizes = Packer(together=True), [0]
    for _ in range(40):
        sizes += map(len, packer.pack([b"a\0" + b"x" * 2000, b"b\0" + b"y" * 20], rest=False))
    assert len(sizes) == 1 + 4 and min(sizes[1:]) > LONGEST - 2000
    rest = {parcel[:2]: Unpacker(ROOM).unpack(parcel) for parcel in packer.pack([], rest=True)}
    assert {topic: len(found) for topic, found in rest.items()} == {b"a\0": 8, b"b\0": 40}


def test_nothing_passes_a_frame_about_all_streams():
    """The health of nodes says how many messages were sent before it."""
    burst = [b"a\0one", b"b\0one", b"!health\0h", b"a\0two", b"!health\0h", b"b\0two"]
    packer, unpacker = Packer(together=True), Unpacker(ROOM)
    assert [frame for parcel in packer.pack(burst) for frame in unpacker.unpack(parcel)] == burst
    last = [b"!health\0h", b"!end\0"]
    packed = [packer.pack([frame], rest=False) for frame in burst[:2]]
    assert [list(parcels) for parcels in packed] == [[], []]
    assert [frame for parcel in packer.pack(last, rest=False) for frame in unpacker.unpack(parcel)] == burst[:2] + last


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize("seed", range(50))
def test_lost_parcels_lose_whole_frames_only(seed, together):
    draw = random.Random(seed)
    packer, unpacker, sent, got = Packer(together), Unpacker(ROOM), [], []
    for number in range(20):
        burst = [frame + number.to_bytes(2, "big") for frame in frames(draw, 6)]
        sent += burst
        for parcel in packer.pack(burst):
            if draw.random() > 0.2:
                got += unpacker.unpack(parcel)
    assert 0 < len(got) < len(sent)
    for stream, found in by_stream(got).items():
        rest = iter(by_stream(sent)[stream])
        assert all(any(frame == other for other in rest) for frame in found), "not a subsequence of what was sent"


@pytest.mark.parametrize("seed", range(200))
def test_foreign_parcels_take_bounded_memory_and_raise_nothing(seed):
    draw, unpacker = random.Random(seed), Unpacker(4 * LONGEST)
    for _ in range(50):
        mark = draw.choice((PART, SEVERAL, b""))
        head = draw.choice(
            (b"", draw.randbytes(16), (5).to_bytes(8, "little") + draw.randbytes(1) + b"\0\0\0\xff\0\0\0")
        )
        got = unpacker.unpack(draw.choice((*STREAMS, b"")) + mark + head + draw.randbytes(draw.randint(0, 100)))
        assert sum(map(len, got)) <= 2 * LONGEST
    held = sum(len(part) for _, _, parts in unpacker._open.values() for part in parts)
    assert held <= len(STREAMS) * 6 * LONGEST
    assert unpacker.unpack(b"a\0ok") == [b"a\0ok"]


@pytest.mark.parametrize("cut", [1, 3, 4, 50, 103])
def test_a_parcel_that_is_cut_contains_no_frame(cut):
    (parcel,) = Packer(together=True).pack([b"a\0" + b"x" * 100, b"a\0" + b"y" * 100])
    assert len(Unpacker(ROOM).unpack(parcel)) == 2
    assert Unpacker(ROOM).unpack(parcel[:-cut]) == []


def test_a_parcel_of_many_empty_frames_is_bounded():
    assert Unpacker(ROOM).unpack(b"a\0" + SEVERAL + bytes(1 << 20)) == []
