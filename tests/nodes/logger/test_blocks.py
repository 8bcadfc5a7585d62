"""Blocks of messages give the same file as single messages, and a slow disk never stops a live run."""

import random
import threading
from collections import Counter

import numpy as np
import pytest

from palpate.engine.slot import Output
from palpate.launch.run.hop import blocks
from palpate.launch.run.wire.parcels import Packer, Unpacker
from palpate.messages import DeviceState, Health, pack
from palpate.nodes.base import Block, Observer, Stream
from palpate.nodes.base.block import ENTRY, MARGIN
from palpate.nodes.logger import Mcap
from palpate.nodes.logger.mcap import RecordedStream
from palpate.records.format.mcap_writer import CHUNK_SIZE, IN_FLIGHT
from palpate.records.format.message_head import HEAD, HEAD_LENGTH, MESSAGE
from palpate.records.stored import Stored

STREAMS = {"fast": 1, "slow": 3, "thinned": 1, "left": 1}
PLAN = {"plan": {"rate": 10.0}}


def logger(path, clock: str, **settings) -> Mcap:
    node = Mcap(path=str(path), within=60.0, **settings)
    streams = tuple(Stream(name, DeviceState, name, every) for name, every in STREAMS.items())
    node.listen(streams, {"clock": clock} | PLAN)
    node.start()
    return node


def block(ticks: range, gone: set[int], size: int = 0) -> Block:
    """The messages of these ticks without those of `gone`, which only `fast` lacks."""
    memory, entries = bytearray(), []
    for tick in ticks:
        for number, (name, every) in enumerate(STREAMS.items()):
            if tick % every or (name == "fast" and tick in gone):
                continue
            payload = pack(DeviceState(tick=tick, time=1000 * tick, source=name + size * "x"))
            begin = len(memory) + MARGIN
            head = np.array((MESSAGE, HEAD_LENGTH + len(payload), 0, tick, 1000 * tick, 1000 * tick), HEAD)
            memory += head.tobytes() + payload
            entries.append((number, tick, 1000 * tick, begin, len(memory)))
    return Block(list(STREAMS), np.array(entries, ENTRY), np.frombuffer(memory, np.uint8))


@pytest.mark.parametrize("settings", [{"thin": {"thinned": 4}}, {"sources": ("fast",)}], ids=["thin", "sources"])
@pytest.mark.parametrize("clock", ["simulated", "real"])
def test_a_block_is_recorded_like_its_single_messages(tmp_path, clock, settings):
    draw = random.Random(2)
    gone = {tick for tick in range(300) if draw.random() < 0.1}
    files = {}
    for take in (Mcap.observe_block, Observer.observe_block):
        node = logger(tmp_path / f"{take.__qualname__}.mcap", clock, leave_out=("left",), **settings)
        for begin, end in ((0, 1), (1, 7), (7, 150), (150, 300)):
            take(node, block(range(begin, end), gone))
        node.stop()
        stored = Stored(node.path)
        files[take] = list(stored.raw()), stored.counts
        assert stored.complete
    assert files[Mcap.observe_block] == files[Observer.observe_block]
    rows, counts = files[Mcap.observe_block]
    assert len(rows) > 60 and counts["fast"]["lost"] == len(gone) and "left" not in counts


@pytest.mark.parametrize("claimed", [False, True])
def test_of_a_block_with_messages_for_others_only_those_of_its_streams_are_recorded(tmp_path, claimed):
    """As with two observers of different streams: the memory of a block contains the messages of both."""
    whole, node = block(range(90), set()), logger(tmp_path / "part.mcap", "simulated")
    memory = whole.memory.copy()
    entries = whole.entries[np.isin(whole.entries["number"], (0, 2))]
    node.observe_block(whole._replace(entries=entries, memory=memory, claim=lambda: claimed))
    node.stop()
    stored = Stored(node.path)
    found = [(name, tick, bytes(payload)) for name, tick, _, payload in stored.raw()]
    assert stored.complete
    assert found == [message for message in whole.messages() if message[0] in ("fast", "thinned")]


@pytest.mark.parametrize("longest", [1, 400, 1 << 16])
def test_a_block_is_sent_in_frames_of_bounded_length(monkeypatch, longest):
    """Their number limits the memory of a queue. A message that is longer has a frame of its length."""
    monkeypatch.setattr(blocks, "LONGEST", longest)
    given = block(range(50), {3, 7}, size=30)
    single = max(len(payload) for _, _, payload in given.messages())
    outputs = [Output(name, DeviceState, external=False) for name in STREAMS]
    framer = blocks.Framer(outputs)
    for observed in (STREAMS.keys(), {"slow", "left"}, {"fast"}, set[str]()):
        for output in outputs:
            output.observed = output.stream in observed
        received: dict[str, list] = {name: [] for name in observed}
        counts = Counter[str]()
        for frame in framer.frames(given):
            topic, _, payload = frame.partition(b"\0")
            name = topic.decode()
            found = blocks.block_of(name, payload)
            assert found is not None
            lengths = found.entries["end"] - found.entries["begin"]
            assert lengths.sum() <= max(longest, single)
            received[name] += found.messages()
            counts[name] += 1
        assert received == {n: [message for message in given.messages() if message[0] == n] for n in observed}
        assert all((count > 1) == (longest < 1 << 16) for count in counts.values())


def frames_of(streams: set[str], *given: Block) -> dict[str, list[bytes]]:
    """The frames of some streams of blocks, by stream."""
    outputs = [Output(name, DeviceState, external=False) for name in STREAMS]
    for output in outputs:
        output.observed = output.stream in streams
    framer = blocks.Framer(outputs)
    frames: dict[str, list[bytes]] = {}
    for frame in (frame for each in given for frame in framer.frames(each)):
        frames.setdefault(frame.partition(b"\0")[0].decode(), []).append(frame)
    return frames


def messages_of(frames: list[bytes]) -> list[tuple[str, int, bytes]]:
    topics = [frame.partition(b"\0") for frame in frames]
    found = [blocks.block_of(topic.decode(), payload) for topic, _, payload in topics]
    assert None not in found
    return [message for one in found for message in one.messages()]


def test_the_short_blocks_of_a_parcel_are_one_block():
    """At 5 kHz a block has 8 ticks, for which an observer took as long as for 48."""
    bursts = [block(range(begin, begin + 8), {3, 17}) for begin in range(0, 48, 8)]
    for name, sent in frames_of({"fast", "slow"}, *bursts).items():
        assert len(sent) == 6
        [parcel] = Packer(together=True).pack(sent)
        joined = blocks.join_blocks(Unpacker(1 << 20).unpack(parcel))
        assert len(joined) == 1 and messages_of(joined) == messages_of(sent), name
        assert blocks.join_blocks(joined) == joined
    assert blocks.join_blocks([]) == []


def test_frames_that_are_no_ascending_blocks_are_not_joined():
    """Those of a restarted node begin again, and a node in Python sends single messages."""
    sent = frames_of({"fast"}, block(range(8), set()), block(range(6, 12), set()))["fast"]
    assert blocks.join_blocks(sent) == sent
    single = b"fast\0" + pack(DeviceState(tick=20))
    cut = sent[1][: len(b"fast\0") + 1 + 4 + 40]
    for other in (single, cut, b"fast\0", b"fast\0" + bytes([0xC1])):
        for mixed in ([sent[0], other], [other, sent[0]]):
            assert blocks.join_blocks(mixed) == mixed


def test_a_damaged_block_among_joined_ones_is_no_block():
    sent = frames_of({"fast"}, *(block(range(begin, begin + 8), set()) for begin in range(0, 24, 8)))["fast"]
    for at in range(len(b"fast\0") + 1 + 4, len(b"fast\0") + 1 + 4 + ENTRY.itemsize):
        damaged = bytearray(sent[1])
        damaged[at] ^= 0x40
        joined = blocks.join_blocks([sent[0], bytes(damaged), sent[2]])
        found = [blocks.block_of("fast", frame.partition(b"\0")[2]) for frame in joined]
        entry, _ = divmod(at - len(b"fast\0") - 5, 8)
        of_memory = ENTRY.names[entry] in ("number", "begin", "end")
        assert (None in found) == of_memory, ENTRY.names[entry]


def test_all_streams_are_framed_in_one_call_of_compiled_code_in_the_same_memory(monkeypatch):
    """At 5 kHz the next tick waits for it. One call per stream and 10 of numpy took longer than the period."""
    framer = blocks.Framer([Output(name, DeviceState, external=False) for name in STREAMS])
    for output in framer._outputs:
        output.observed = True
    pick, calls = blocks.picker(), list[tuple[int, ...]]()

    def counted(*given: int) -> tuple[int, int]:
        calls.append(given[3:])
        return pick(*given)

    monkeypatch.setattr(blocks, "picker", lambda: counted)
    for _ in range(3):
        assert len(framer.frames(block(range(30), set()))) == len(STREAMS)
    assert len(calls) == 3 and len(set(calls)) == 1
    large = block(range(600), set(), size=1000)
    for _ in range(3):
        calls.clear()
        assert sum(map(len, framer.frames(large))) > blocks.ROOM
    assert len(calls) == 1  # the memory has grown in the first of them


def test_a_slow_disk_loses_messages_of_a_live_run_and_never_stops_it(tmp_path, monkeypatch):
    node = logger(tmp_path / "live.mcap", "real")
    writes, write = threading.Event(), node._writer._write_chunk

    def slow(*given):
        writes.wait(60.0)
        write(*given)

    monkeypatch.setattr(node._writer, "_write_chunk", slow)
    many = block(range(8), set(), CHUNK_SIZE // 8)
    for _ in range(3 * IN_FLIGHT):  # returns although the disk writes nothing
        node.observe_block(many)
        node.observe("fast", 8, pack(DeviceState(tick=8, time=8000)))
    writes.set()
    for name in STREAMS:
        node.health(Health(
            source=name, since=0, steps=1000, state="", late=0, lost=0, held=0, median=0.0, p99=0.0, longest=0.0,
            age=0.0,
        ))  # fmt: skip
    node.stop()
    stored = Stored(node.path)
    kept = sum(1 for name, *_ in stored.raw() if name == "fast")
    assert stored.complete and 8 <= kept < 8 * 2 * IN_FLIGHT
    assert stored.counts["fast"] == {"count": kept, "lost": 1000 - kept}
    assert any("lacks messages" in note and "fast" in note for note in node.notes())


@pytest.mark.parametrize(
    ("every", "thin", "simulated"), [(1, 1, True), (1, 1, False), (5, 1, True), (1, 4, False), (3, 4, True)]
)
def test_a_block_of_ticks_is_counted_as_its_messages_are(every, thin, simulated):
    rng = np.random.default_rng(every + thin)
    one, other = (RecordedStream(0, every, thin, simulated, False) for _ in range(2))
    at, received = 0, list[int]()
    for _ in range(60):
        steps = rng.choice([1, 1, 1, 2, 7], size=rng.integers(1, 30)) if rng.random() < 0.3 else np.ones(20, np.int64)
        ticks = every * (at + np.cumsum(steps))
        at = int(ticks[-1]) // every
        received += [tick for tick in ticks.tolist() if not (simulated and tick % one.skip)]
        kept = one.take_all(ticks)
        assert np.array_equal(np.broadcast_to(kept, len(ticks)), [other.take(tick) for tick in ticks.tolist()])
    for name in RecordedStream.__slots__:
        assert getattr(one, name) == getattr(other, name), name
    assert one.gaps > 0 and one.count > 0
    for tick in range(one.first + 1, one.next + 2):  # how many came before a restart
        assert one.count_before(tick) == sum(before < tick for before in received), tick
    assert one.count_before(one.first) is None
