"""ZMTP frames in compiled code: received from a Unix socket into a port's record, and sent from the journal.

Only whole frames of the form that `outlet` sends are read here. Everything else stays in the buffer for `zmtp`.
"""

from typing import Any

import numpy as np
from numba import types

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import big, pointer, set_big, set_word
from palpate.engine.compiled_tick import ENTRY_SIZE, entry_at, head_at, input_at, needed, row_at
from palpate.engine.encode import byte
from palpate.launch.run.hop.decode import decode, memcmp
from palpate.launch.run.hop.table import DONE, OUTPUT, PORT, READER, SEGMENT, WIRE
from palpate.launch.run.wire.inlet import LONGEST_MESSAGE

_INT, _LONG = types.int32, types.int64
recv: Any = types.ExternalFunction("recv", _LONG(_INT, _LONG, _LONG, _INT))
sendmsg: Any = types.ExternalFunction("sendmsg", _LONG(_INT, _LONG, _INT))
memmove: Any = types.ExternalFunction("memmove", _LONG(_LONG, _LONG, _LONG))
error_place: Any = types.ExternalFunction("__errno_location", _LONG())
DONTWAIT, NOSIGNAL, AGAIN = 0x40, 0x4000, 11  # of Linux

wire_at, port_at, reader_at, segment_at = pointer(WIRE), pointer(PORT), pointer(READER), pointer(SEGMENT)
READER_SIZE, PORT_SIZE = READER.itemsize, PORT.itemsize
WHOLE, CUT, ODD = 1, 0, -1  # the next frame: whole, not yet received, or not for compiled code


@kernel
def next_frame(wire, begin):
    """State of the frame at offset `begin` of the buffer, and addresses of begin and end of its message."""
    at, left = wire.buffer + begin, wire.end - begin
    zero = np.int64(0)
    if left < 2:
        return CUT, zero, zero
    flags = byte(at).value
    if flags == 0:
        length, head = np.int64(byte(at + 1).value), 2
    elif flags == 2:
        if left < 9:
            return CUT, zero, zero
        length, head = big(at + 1), 9
    else:
        return ODD, zero, zero
    if length < wire.skip or length > wire.room - head:
        wire.need = length + head
        return ODD, zero, zero
    if left - head < length:
        return CUT, zero, zero
    if memcmp(at + head, wire.topic, wire.skip) != 0:
        return ODD, zero, zero
    return WHOLE, at + head + wire.skip, at + head + length


@kernel
def fill(wire, flags):
    """Receive into the buffer; returns the result of `recv`, or -1 without a connection or without room."""
    low, port = wire.end, wire.port
    while port != 0:
        low, port = min(low, port_at(port).begin), port_at(port).next
    if low > 0 and (low == wire.end or wire.end > wire.room // 2):
        memmove(wire.buffer, wire.buffer + low, wire.end - low)
        wire.end -= low
        port = wire.port
        while port != 0:
            line = port_at(port)
            line.begin -= low
            line.ahead -= low if line.ahead != 0 else 0
            port = line.next
    if wire.fd < 0:
        return -1
    if wire.end >= wire.room:
        wire.need = 2 * wire.room
        return -1
    got = recv(np.int32(wire.fd), wire.buffer + wire.end, wire.room - wire.end, np.int32(flags))
    if got > 0:
        wire.end += got
    return got


@kernel
def peek(port):
    """Decode the next message into the spare record. Returns the state of its frame, `ODD` also for another form."""
    if port.ahead != 0:
        return WHOLE
    wire = wire_at(port.wire)
    state, begin, end = next_frame(wire, port.begin)
    if state == WHOLE and not decode(port.form, port.spare, begin, end, port.other, port.space):
        port.need = end - begin
        return ODD
    if state == WHOLE:
        port.ahead = end - wire.buffer
    return state


@kernel
def take(port):
    """Make the message in the spare record the message of the port."""
    port.record, port.spare = port.spare, port.record
    port.arena, port.other = port.other, port.arena
    input_at(port.line).record = port.record
    port.begin, port.ahead = port.ahead, 0


@kernel
def drop(port):
    """Skip the message in the spare record."""
    port.begin, port.ahead = port.ahead, 0


@kernel
def newest(port, limit, due, every):
    """Read the messages up to tick `limit`; duplicates and messages older than the last one are dropped.

    Returns the state of the frame after them (`CUT` also if it is of a later tick), their number, and the number of
    runs of divisor `every`, from tick `due` on, to which they belong.
    """
    count = runs = np.int64(0)
    run = np.int64(-1)
    while True:
        state = peek(port)
        if state != WHOLE:
            return state, count, runs
        tick = head_at(port.spare).tick
        if tick > limit:
            return CUT, count, runs
        head = head_at(port.record)
        if head.there and tick <= head.tick:
            drop(port)
            continue
        take(port)
        count += 1
        if tick >= due and tick // every != run:
            runs += 1
            run = tick // every


@kernel
def exactly(port, need):
    """Wait until the message of tick `need` has arrived, on the simulated clock. False: it does not arrive within the
    timeout of the socket, it is lost, or its form is unusual."""
    wire = wire_at(port.wire)
    while True:
        head = head_at(port.record)
        if head.there and head.tick >= need:
            return head.tick == need
        state = peek(port)
        if state == ODD or (state == CUT and fill(wire, 0) <= 0):
            return False
        if state == WHOLE:
            tick = head_at(port.spare).tick
            if tick > need:
                return False
            if tick == need:
                take(port)
            else:
                drop(port)


@kernel
def message_arrived(port, tick):
    """Whether the message that a node needs at a tick of the simulated clock has arrived, or none is needed."""
    row, line = row_at(port.row), input_at(port.line)
    need = needed(tick, line.every, line.loop != 0)
    return tick < row.due or row.blocked or line.dead or need < 0 or exactly(port, need)


@kernel
def send(reader, begin, size, scratch):
    """Send a message; returns the result of `sendmsg`."""
    length = reader.skip + size
    head = reader.topic
    if length < 256:
        head -= 2
        byte(head).value = 0
        byte(head + 1).value = length
    else:
        head -= 9
        byte(head).value = 2
        set_big(head + 1, length)
    # struct iovec [2], and struct msghdr with the address and the number of these
    set_word(scratch, head)
    set_word(scratch + 8, reader.topic + reader.skip - head)
    set_word(scratch + 16, begin)
    set_word(scratch + 24, size)
    for i in range(7):
        set_word(scratch + 32 + 8 * i, 0)
    set_word(scratch + 48, scratch)
    set_word(scratch + 56, 2)
    sent = sendmsg(np.int32(reader.fd), scratch + 32, np.int32(DONTWAIT | NOSIGNAL))
    return sent - (reader.topic + reader.skip + size - head) if sent >= 0 else np.int64(1)


@kernel
def buffer_is_full():
    """Whether the last system call failed because a buffer is full. It reads 4 bytes."""
    place = error_place()
    return np.int64(byte(place).value) | np.int64(byte(place + 1).value) << 8 == AGAIN


@kernel
def deliver(hop, segment, clock):
    """Send the messages of a tick to the readers. A reader for which the sender does not wait loses a message that does
    not fit. `OUTPUT`: anything else, for Python."""
    for k in range(segment.first, clock.entries):
        entry = entry_at(clock.entry + k * ENTRY_SIZE)
        size = entry.end - entry.begin
        for j in range(segment.readers):
            reader = reader_at(segment.reader + j * READER_SIZE)
            if reader.number != entry.number:
                continue
            hop.entry, hop.reader, hop.sent = k, j, 0
            if size > LONGEST_MESSAGE:
                return OUTPUT
            if reader.queued != 0:
                if reader.blocks != 0:
                    return OUTPUT
                reader.dropped += 1
                continue
            lacking = send(reader, clock.journal + entry.begin, size, hop.scratch)
            if lacking == 0:
                continue
            if lacking > 0 and reader.blocks == 0 and buffer_is_full():
                reader.dropped += 1
                continue
            if lacking < 0:
                length = reader.skip + size
                hop.sent = (2 if length < 256 else 9) + length + lacking
            return OUTPUT
    return DONE
