"""Many ticks of a worker in one call: receive, step, send.

Anything unusual ends the call within a tick. The caller completes that tick with the loops of `launch.run.work`, which
define what is right, and calls again.
"""

from typing import Any

import numpy as np
from numba import types

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import pointer, set_word, word
from palpate.engine.compiled_tick import ROW_SIZE, clock_at, row_at, run_table
from palpate.engine.health import LONGEST, TOTAL
from palpate.engine.segment import SAMPLE
from palpate.launch.run.hop.frames import deliver, message_arrived, port_at, segment_at
from palpate.launch.run.hop.table import DONE, FAILED, HOP, INPUT, JOURNAL, SEGMENT, TALLY

_INT, _LONG = types.int32, types.int64
clock_gettime: Any = types.ExternalFunction("clock_gettime", _INT(_INT, _LONG))
MONOTONIC = 1
ENOUGH = 100_000  # [bytes]
hop_at, tally_at = pointer(HOP), pointer(TALLY)
SEGMENT_SIZE, TALLY_SIZE = SEGMENT.itemsize, TALLY.itemsize


@kernel
def moment(hop):
    """The monotonic clock [ns]."""
    clock_gettime(np.int32(MONOTONIC), hop.scratch)
    return word(hop.scratch) * 1000000000 + word(hop.scratch + 8)


@kernel
def tally(words, duration):
    """Count a duration [ns] in the `Histogram` at this address."""
    place = words + 8 * TOTAL
    set_word(place, word(place) + duration)
    place = words + 8 * LONGEST
    set_word(place, max(word(place), duration))
    bits = np.int64(0)
    while duration >> bits != 0:
        bits += 1
    place = words + (8 * (8 * bits + (duration >> bits - 4)) if bits > 3 else 0)
    set_word(place, word(place) + 1)


@kernel
def run_rows(hop, segment, clock, tick):
    """Run the nodes of a segment; at some ticks one by one, with the duration of each step."""
    if tick % SAMPLE != 0:
        run_table(segment.rows, segment.clock, tick, 1)
    else:
        for i in range(segment.count):
            row = row_at(segment.rows + i * ROW_SIZE)
            clock.first, clock.last = i, i + 1
            before, begun = row.steps, moment(hop)
            run_table(segment.rows, segment.clock, tick, 1)
            if row.steps > before:
                row.steps = before
                tally(tally_at(hop.tallies + (segment.base + i) * TALLY_SIZE).step, moment(hop) - begun)
            if clock.failed >= 0 or clock.resume >= 0:
                break
        clock.first, clock.last = 0, segment.count
    if clock.failed >= 0:
        return FAILED
    return DONE if clock.resume < 0 else JOURNAL


@kernel
def run_segment(hop, segment, tick, at):
    """Run the nodes of a segment at a tick, and send their messages."""
    clock = clock_at(segment.clock)
    clock.at, segment.first = at, clock.entries
    why = run_rows(hop, segment, clock, tick)
    if why == DONE:
        why = deliver(hop, segment, clock)
    if why == DONE and segment.keeps == 0:
        clock.entries = clock.length = 0
    return why


@kernel
def journals_are_full(hop):
    """Whether a journal contains enough messages for a block, or is half full."""
    for s in range(hop.count):
        clock = clock_at(segment_at(hop.segments + s * SEGMENT_SIZE).clock)
        if clock.length > ENOUGH or 2 * clock.length > clock.room or 2 * clock.entries > clock.most:
            return True
    return False


@kernel(nogil=True)
def run_hop(hop_address, tick, until, deadline):
    """Run the ticks [tick, until) of the simulated clock, or until about `deadline` [ns]. Returns the next tick and
    `DONE`, or the interrupted tick and the reason; `HOP.at` is then the segment."""
    hop = hop_at(hop_address)
    for now in range(tick, until):
        for s in range(hop.count):
            segment = segment_at(hop.segments + s * SEGMENT_SIZE)
            hop.at = s
            for k in range(segment.ports):
                if not message_arrived(port_at(word(segment.port + 8 * k)), now):
                    return now, INPUT
            why = run_segment(hop, segment, now, 0)
            if why != DONE:
                return now, why
        if moment(hop) > deadline or journals_are_full(hop):
            return now + 1, DONE
    return until, DONE
