"""The messages of a block as frames for observers, in one call for all streams: on the real clock the next tick waits
for it."""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import copy, pointer
from palpate.engine.compiled_tick import ENTRY_SIZE, entry_at
from palpate.engine.encode import byte
from palpate.launch.run.hop.table import COUNT, FRAME, MARK, STREAM
from palpate.nodes.base.block import MARGIN

stream_at, frame_at = pointer(STREAM), pointer(FRAME)
STREAM_SIZE, FRAME_SIZE = STREAM.itemsize, FRAME.itemsize


@kernel
def divide(entries, count, streams, longest, frames, most):
    """Assign the messages of the wanted streams to frames of at most `longest` bytes of messages; a longer message has
    its frame. Returns the number of frames; only the first `most` exist."""
    made = np.int64(0)
    for k in range(count):
        given = entry_at(entries + k * ENTRY_SIZE)
        stream = stream_at(streams + given.number * STREAM_SIZE)
        if stream.wanted == 0:
            continue
        length, last = given.end - given.begin, stream.open
        if last < 0 or frame_at(frames + last * FRAME_SIZE).size + length > longest:
            if made < most:
                frame = frame_at(frames + made * FRAME_SIZE)
                frame.next, frame.count, frame.size, frame.done = -1, 0, 0, 0
                if last < 0:
                    stream.first = made
                else:
                    frame_at(frames + last * FRAME_SIZE).next = made
                stream.open = made
            made += 1
        if made <= most:
            frame = frame_at(frames + stream.open * FRAME_SIZE)
            frame.count += 1
            frame.size += length
    return made


@kernel
def arrange(streams, number, frames, to, room):
    """Place the frames one after the other from address `to` on, so that their entries are aligned, and write their
    heads. Returns the number of bytes; beyond `room` nothing is written."""
    at = np.int64(0)
    for s in range(number):
        stream = stream_at(streams + s * STREAM_SIZE)
        stream.open = stream.first
        f = stream.first
        while f >= 0:
            frame = frame_at(frames + f * FRAME_SIZE)
            head = stream.skip + 1 + COUNT
            entry = (at + head + 7) // 8 * 8
            frame.begin, frame.entry, frame.data = entry - head, to + entry, 0
            at = entry + frame.count * (ENTRY_SIZE + MARGIN) + frame.size
            frame.end = at
            if at <= room:
                place = copy(to + frame.begin, stream.topic, stream.skip)
                byte(place).value = MARK
                for k in range(COUNT):
                    byte(place + 1 + k).value = frame.count >> 8 * k & 0xFF
            f = frame.next
    return at


@kernel
def pick(entries, count, memory, streams, number, longest, frames, most, to, room):
    """Copy messages to frames of their streams: each after its margin, without the messages between them.

    entries, count   address and number of their entries;  memory  address of their bytes
    streams, number  address and number of the `STREAM`s;  longest  [bytes] of the messages in a frame
    frames, most     address and number of the `FRAME`s
    to, room         address and size of the memory for the frames; aligned

    Returns the number of frames and of bytes; if either does not fit, nothing was copied.
    """
    for s in range(number):
        stream = stream_at(streams + s * STREAM_SIZE)
        stream.first = stream.open = -1
    made = divide(entries, count, streams, longest, frames, most)
    if made > most:
        return made, np.int64(0)
    size = arrange(streams, number, frames, to, room)
    if size > room:
        return made, size
    for k in range(count):
        given = entry_at(entries + k * ENTRY_SIZE)
        stream = stream_at(streams + given.number * STREAM_SIZE)
        if stream.wanted == 0:
            continue
        frame = frame_at(frames + stream.open * FRAME_SIZE)
        length, placed = given.end - given.begin, entry_at(frame.entry)
        placed.number, placed.tick, placed.time = 0, given.tick, given.time
        placed.begin, placed.end = frame.data + MARGIN, frame.data + MARGIN + length
        # The bytes of the first message follow the entries of all messages.
        data = frame.entry + (frame.count - frame.done) * ENTRY_SIZE + frame.data
        copy(data, memory + given.begin - MARGIN, MARGIN + length)
        frame.entry += ENTRY_SIZE
        frame.data += MARGIN + length
        frame.done += 1
        if frame.done == frame.count:
            stream.open = frame.next
    return made, size
