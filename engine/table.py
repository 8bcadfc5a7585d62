"""The table by which compiled code runs the nodes of a segment: a row for each node, a line for each of its inputs
and outputs. `compiled_tick` reads it."""

import numpy as np

ROW = np.dtype([
    ("compute", "<i8"), ("idle", "<i8"),  # addresses of machine code; idle 0: the node does not sleep
    ("records", "<i8"), ("count", "<i8"),  # address of the table of its records' addresses, and how many
    ("inputs", "<i8"), ("input", "<i8"), ("used", "<i8"),  # number of inputs, address of their lines and of their ticks
    ("outputs", "<i8"), ("output", "<i8"), ("numbers", "<i8"), ("numbered", "<i8"),
    ("every", "<i8"), ("due", "<i8"), ("missed", "<i8"), ("last", "<i8"),
    ("begun", "<i8"), ("time", "<i8"), ("nominal", "<f8"),
    ("follows", "?"), ("hardware", "?"), ("blocked", "?"), ("skip", "?"), ("stepped", "?"),
    ("steps", "<i8"), ("asleep", "<i8"), ("held", "<i8"), ("lost", "<i8"),
], align=True)  # fmt: skip
"""
output   address of the lines of its outputs;  numbers, numbered  addresses of those that have to be finite, how many
every    divisor;  due, missed, last  as in a `Slot`: the first tick of its next step, the number of the last run that
         lacked an input, the tick of its last step
begun    whether it has stepped;  time [ns] of its last step;  nominal [s] dt of the first
follows  the time of a step is that of its driving message
hardware, blocked  as in a `Slot`;  skip  a host found no inputs for it;  stepped  in this tick
steps, asleep, held, lost  what was counted since somebody asked
"""
INPUT = np.dtype([
    ("record", "<i8"), ("absent", "<i8"), ("put", "<i8"),
    ("every", "<i8"), ("loop", "<i8"), ("permitted", "<f8"),
    ("given", "?"), ("dead", "?"), ("optional", "?"), ("drives", "?"),
], align=True)  # fmt: skip
"""
record, absent  addresses of the sender's record, and of one for "no message"
put       where the address of the one that is used goes
every     divisor of the sender;  loop  1 for an edge that closes a loop
permitted [s] age up to which it is held on the real clock
given     a host has filled the record
"""
OUTPUT = np.dtype([(name, "<i8") for name in ("record", "steps", "count", "literals", "most", "period", "number")])
"""
record, steps, count, literals, most  for `engine.encode`
period   its messages of the ticks that this divides are taken down; 0: none
number   of it in the journal
"""
ENTRY = np.dtype([(name, "<i8") for name in ("number", "tick", "begin", "end")])
"""A message in the journal: of which output, and where its bytes are."""
CLOCK = np.dtype([
    ("rate", "<f8"), ("at", "<i8"), ("real", "?"), ("first", "<i8"), ("last", "<i8"), ("failed", "<i8"), ("why", "<i8"),
    ("tick", "<i8"), ("resume", "<i8"),
    ("journal", "<i8"), ("room", "<i8"), ("length", "<i8"), ("entry", "<i8"), ("entries", "<i8"), ("most", "<i8"),
], align=True)  # fmt: skip
"""
rate    [Hz];  at [ns] of the tick on the real clock;  real  which clock
first, last  rows to run, the last one not included
failed  row of the node that failed, -1 for none;  why (`RAISED` ...);  tick  at which
resume  row at which the journal was full, -1 for none;  tick  at which
journal, room, length  address, size and used part of the bytes of the journal;  entry, most, entries  of its `ENTRY`s
"""
LANE = np.dtype([(name, "<i8") for name in ("rows", "clock", "tick", "taps", "tapped", "every", "room")])
"""One of several runs side by side: its table, its next tick, its `TAP`s and how many, the divisor of the ticks at
which they are taken down, and how many of these have room; later ones overwrite the first."""
TAP = np.dtype([(name, "<i8") for name in ("source", "size", "column")])
"""A field of a message that is kept: where it is, its bytes, and where those of tick 0 go; the others follow."""
RAISED, FAULT, INFINITE = 1, 2, 3
