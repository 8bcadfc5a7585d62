"""The table of a segment, which `compiled_tick` executes: a row for each node, a line for each of its inputs and
outputs."""

import numpy as np

ROW = np.dtype([
    ("compute", "<i8"), ("idle", "<i8"),  # addresses of machine code; idle 0: the node does not sleep
    ("records", "<i8"), ("count", "<i8"),  # address and length of the list of addresses of its records
    ("inputs", "<i8"), ("input", "<i8"), ("used", "<i8"),  # number of inputs, address of their lines and of their ticks
    ("outputs", "<i8"), ("output", "<i8"), ("numbers", "<i8"), ("numbered", "<i8"),
    ("every", "<i8"), ("due", "<i8"), ("missed", "<i8"), ("last", "<i8"),
    ("begun", "<i8"), ("time", "<i8"), ("nominal", "<f8"),
    ("follows", "<i8"), ("hardware", "?"), ("blocked", "?"), ("skip", "?"), ("stepped", "?"),
    ("steps", "<i8"), ("asleep", "<i8"), ("held", "<i8"), ("absent", "<i8"), ("lost", "<i8"),
], align=True)  # fmt: skip
"""
output   address of the lines of its outputs;  numbers, numbered  address and length of the list of addresses of the
         numbers that must be finite
every    divisor;  due, missed, last  first tick of its next step, number of the last run that lacked an input, tick of
         its last step
begun    whether it has stepped;  time [ns] of its last step;  nominal [s] dt of the first step
follows  number of the first inputs, its driving ones, whose newest time is that of a step; 0: it is that of the tick
hardware, blocked  as in a `Slot`;  skip  the host has no inputs for it;  stepped  in this tick
steps, asleep, held, absent, lost  counts since the last `CompiledSegment.count`
"""
INPUT = np.dtype([
    ("record", "<i8"), ("absent", "<i8"), ("put", "<i8"),
    ("every", "<i8"), ("loop", "<i8"), ("permitted", "<f8"),
    ("dead", "?"), ("optional", "?"), ("drives", "?"),
], align=True)  # fmt: skip
"""
record, absent  addresses of the sender's record, and of a record that means "no message"
put       address to which the address of the chosen record is written
every     divisor of the sender;  loop  1 for an edge that closes a loop
permitted [s] age up to which it is held on the real clock
"""
OUTPUT = np.dtype([(name, "<i8") for name in ("record", "steps", "count", "literals", "most", "period", "number")])
"""
record, steps, count, literals, most  for `engine.encode`
period   divisor of the ticks whose messages are written to the journal; 0: none
number   of the output in the journal
"""
CLOCK = np.dtype([
    ("rate", "<f8"), ("at", "<i8"), ("real", "?"), ("first", "<i8"), ("last", "<i8"), ("failed", "<i8"), ("why", "<i8"),
    ("tick", "<i8"), ("resume", "<i8"),
    ("journal", "<i8"), ("room", "<i8"), ("length", "<i8"), ("entry", "<i8"), ("entries", "<i8"), ("most", "<i8"),
], align=True)  # fmt: skip
"""
rate    [Hz];  at [ns] time of the tick on the real clock;  real  whether the clock is real
first, last  rows to run, the last one excluded
failed  row of the node that failed, -1 for none;  why  cause (`RAISED` ...)
resume  row at which the journal was full, -1 for none
tick    of the failure, or at which the journal was full
journal, room, length  address, size and used size of the bytes of the journal;  entry, most, entries  of its entries
         (`nodes.base.block`)
"""
LANE = np.dtype([(name, "<i8") for name in ("rows", "clock", "tick", "taps", "tapped", "every", "room")])
"""One of several runs: its table, its next tick, its `TAP`s and their number, the divisor of the ticks at which they
are kept, and the number of rows for them; later rows overwrite the first."""
TAP = np.dtype([(name, "<i8") for name in ("source", "size", "column")])
"""A message field to keep: its address, its size [bytes], and the address of the row of tick 0; other rows follow."""
RAISED, FAULT, INFINITE = 1, 2, 3
