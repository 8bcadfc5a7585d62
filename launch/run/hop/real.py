"""Many ticks on the real clock in one call: wait for the tick, read the inputs, step, send.

The rules are those of `launch.run.work.real`, which completes an interrupted tick.
"""

from typing import Any

import numpy as np
from numba import types

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import set_word, word
from palpate.engine import schedule
from palpate.engine.clock import SPIN
from palpate.engine.compiled_tick import ROW_SIZE, clock_at, lacks, needed, row_at, stands
from palpate.engine.schedule import OLD
from palpate.launch.run.hop.frames import (
    DONTWAIT,
    ODD,
    READER_SIZE,
    WHOLE,
    fill,
    head_at,
    input_at,
    newest,
    peek,
    port_at,
    reader_at,
    segment_at,
    wire_at,
)
from palpate.launch.run.hop.table import BETWEEN, DONE, INPUT
from palpate.launch.run.hop.tick import (
    MONOTONIC,
    SEGMENT_SIZE,
    TALLY_SIZE,
    hop_at,
    journals_are_full,
    moment,
    run_segment,
    tally,
    tally_at,
)

_INT, _LONG = types.int32, types.int64
ppoll: Any = types.ExternalFunction("ppoll", _INT(_LONG, _LONG, _LONG, _LONG))
clock_nanosleep: Any = types.ExternalFunction("clock_nanosleep", _INT(_INT, _INT, _LONG, _LONG))
ABSOLUTE, READABLE = 1, 1  # of Linux
FAR = 1 << 62  # a tick after all others
LONGEST_WAIT = 20_000_000  # [ns] in compiled code, since orders and Ctrl-C take effect after it
DEVIATIONS = 6  # a sleep ends early by its usual delay and this many mean deviations
LATEST = 16  # the last delay has the weight 1 / LATEST in the running means
SETTLED = 0.5  # share of the period after which the force path of a tick has usually ended
left_out, unread, stopped = kernel(schedule.left_out), kernel(schedule.unread), kernel(schedule.sender_stopped)
begin_of = kernel(schedule.begin_of)


@kernel
def sleep(hop, until):
    """Sleep until a time [ns] of the monotonic clock."""
    set_word(hop.scratch, until // 1000000000)
    set_word(hop.scratch + 8, until % 1000000000)
    clock_nanosleep(np.int32(MONOTONIC), np.int32(ABSOLUTE), hop.scratch, 0)


@kernel
def await_tick(hop):
    """Wait for the next tick of the clock: whether it is soon, its number and its time [ns]. Ticks whose whole period
    has passed are left out, except the last one of the run."""
    now = hop.last + 1
    due = hop.origin + begin_of(now, hop.exact)
    left = due - moment(hop)
    if left > LONGEST_WAIT:
        return False, now, np.int64(0)
    if left > 0:
        wake = due - min(SPIN, left // 4, hop.wakes + DEVIATIONS * hop.spread)
        sleep(hop, wake)
        delay = moment(hop) - wake
        hop.spread += (abs(delay - hop.wakes) - hop.spread) // LATEST
        hop.wakes += (delay - hop.wakes) // LATEST
        left = due - moment(hop)
        while left > 0:
            left = due - moment(hop)
    skipped = left_out(-left, hop.exact, now, hop.end)
    hop.late += skipped if hop.last >= 0 else 0
    return True, now + skipped, moment(hop) - hop.origin


@kernel
def follow_driver(hop):
    """Wait for the next driving message and use the newest: whether one has arrived, its tick and its time [ns].
    Skipped messages for a run of the node's divisor count as lost. If other inputs may drive the node, the loop in
    Python chooses one when this one is late."""
    port, row = port_at(hop.port), row_at(hop.lead)
    wire, received = wire_at(port.wire), False
    zero = np.int64(0)
    count = runs = zero
    while not (input_at(port.line).dead or row.blocked):
        state, more, found = newest(port, FAR, row.due, row.every)
        count, runs = count + more, runs + found
        if count > 0 and (received or state == ODD or fill(wire, DONTWAIT) <= 0):
            head = head_at(port.record)
            hop.lost += unread(runs, head.tick, row.due, hop.last)
            if head.tick > hop.last:
                return True, head.tick, head.time
            count = runs = zero
        elif count == 0 and (state == ODD or not arrives(hop, wire) or fill(wire, 0) <= 0):
            break
        else:
            received = True
    return False, zero, zero


@kernel
def await_wire(hop, wire, until):
    """Whether a wire becomes readable before `until` [ns]; -1: Python has to look, 0: no."""
    left = until - moment(hop)
    if left <= 0:
        return 0
    if wire.fd < 0 or left > LONGEST_WAIT:
        return -1
    set_word(hop.scratch, np.int64(wire.fd) | (np.int64(READABLE) << 32))
    set_word(hop.scratch + 8, left // 1000000000)
    set_word(hop.scratch + 16, left % 1000000000)
    return ppoll(hop.scratch, 1, hop.scratch + 8, 0)


@kernel
def arrives(hop, wire):
    """Whether data arrive while the driving message is waited for."""
    return hop.held == 0 or await_wire(hop, wire, hop.begun + hop.held) > 0


@kernel
def collect_newest(hop, port, now, waits, until):
    """Read the newest message of an input up to the tick; wait until `until` [ns] for that of this tick. Returns
    `DONE` or `INPUT`."""
    line, wire = input_at(port.line), wire_at(port.wire)
    limit, need = now - line.loop, needed(now, line.every, line.loop != 0)
    tried = False
    while True:
        state, _, _ = newest(port, limit, 0, 1)
        head = head_at(port.record)
        if head.there and head.tick >= need:
            return DONE
        if state == ODD:
            return INPUT
        if tried:
            # A later message has arrived, so this one is lost.
            if not waits or peek(port) == WHOLE:
                return DONE
            ready = await_wire(hop, wire, until)
            if ready <= 0:
                return DONE if ready == 0 else INPUT
        tried = True
        if wire.fd >= 0 and fill(wire, DONTWAIT) == 0:
            return INPUT


@kernel
def state_of(port, now, rate):
    """How a step takes the message of a port, see `engine.schedule`; a missing one is `OLD`."""
    line, head = input_at(port.line), head_at(port.record)
    return stands(row_at(port.row), line, head.tick, now, rate) if head.there else OLD


@kernel
def gather(hop, segment, now, rate):
    """Read the inputs of a segment for a tick. Returns `DONE` or `INPUT`."""
    without = np.int64(0)  # row that lacks a required message
    until = hop.begun + hop.period
    for k in range(segment.ports):
        port = port_at(word(segment.port + 8 * k))
        row, line = row_at(port.row), input_at(port.line)
        if now < row.due or row.blocked or line.dead:
            continue
        leads = word(segment.port + 8 * k) == hop.port
        waits = (port.waits != 0 or line.drives) and not leads and port.row != without
        silent = head_at(port.record).there and stopped(state_of(port, now, rate), line.optional)
        if collect_newest(hop, port, now, waits and not silent, until) != DONE:
            return INPUT
        if lacks(state_of(port, now, rate), line.optional):
            without = port.row
    return DONE


@kernel
def needed_elsewhere(hop):
    """Whether another worker of the run reads messages of this one."""
    for s in range(hop.count):
        segment = segment_at(hop.segments + s * SEGMENT_SIZE)
        for j in range(segment.readers):
            if reader_at(segment.reader + j * READER_SIZE).worker:
                return True
    return False


@kernel(nogil=True)
def run_real_hop(hop_address, most, deadline):
    """Run up to `most` ticks, or until about `deadline` [ns]. Returns why it ended; `BETWEEN`: the next tick has not
    begun. `HOP` has the tick and its time."""
    hop = hop_at(hop_address)
    hop.done = 0
    while hop.done < most and hop.last < hop.end:
        if hop.port == 0:
            ready, now, at = await_tick(hop)
        else:
            ready, now, at = follow_driver(hop)
        if not ready:
            return BETWEEN
        hop.now, hop.time, hop.begun = now, at, moment(hop)
        for s in range(hop.count):
            segment = segment_at(hop.segments + s * SEGMENT_SIZE)
            hop.at = s
            if gather(hop, segment, now, clock_at(segment.clock).rate) != DONE:
                return INPUT
            why = run_segment(hop, segment, now, at)
            if why != DONE:
                return why
            age = max(0, moment(hop) - hop.origin - at)
            for i in range(segment.count):
                if row_at(segment.rows + i * ROW_SIZE).stepped:
                    counts = tally_at(hop.tallies + (segment.base + i) * TALLY_SIZE)
                    counts.overdue += age > hop.period
                    tally(counts.age, age)
        hop.last = now
        hop.done += 1
        if moment(hop) > deadline or journals_are_full(hop):
            break
    # The caller's work waits until the nodes that need these messages have run, since they share the core.
    settled = hop.origin + np.int64((hop.last + SETTLED) * hop.exact)
    if settled > moment(hop) and needed_elsewhere(hop):
        sleep(hop, min(settled, moment(hop) + LONGEST_WAIT))
    return DONE
