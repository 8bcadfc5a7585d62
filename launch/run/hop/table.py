"""The table of a hop, which `tick` and `frames` execute: its segments, the wires that it reads, the ports that these
fill, and its readers; and the frames for observers, which `pick` fills."""

import numpy as np

WIRE = np.dtype([(n, "<i8") for n in ("fd", "buffer", "room", "end", "topic", "skip", "port", "need")])
"""The connection over which one stream arrives.

fd            file descriptor, -1: no connection
buffer, room  address and size of the memory for received bytes;  end  number of bytes in it
topic, skip   address and length of the topic at the beginning of each frame
port          address of its first `PORT`
need          [bytes] size of a frame for which the buffer was too small
"""
PORT = np.dtype([
    ("wire", "<i8"), ("next", "<i8"), ("begin", "<i8"), ("ahead", "<i8"), ("row", "<i8"), ("line", "<i8"),
    ("form", "<i8"), ("record", "<i8"), ("arena", "<i8"), ("spare", "<i8"), ("other", "<i8"), ("space", "<i8"),
    ("need", "<i8"), ("waits", "<i8"),
])  # fmt: skip
"""An input of a node, filled from a wire.

wire, row, line, form  addresses of its `WIRE`, its node's `ROW`, its `INPUT` and its `FORM`
next     address of the next port of the same wire; 0: none
begin    offset of the first byte in the buffer that it has not read
ahead    offset of the first byte after the next message, which has been decoded; 0: it has not
record, arena  addresses of the record of its message and of the memory for its arrays
spare, other   the same of the next message; both pairs are exchanged when its turn has come
space    [bytes] size of each memory for arrays;  need  size of a message for which it was too small
waits    on the real clock: whether a step waits for it
"""
READER = np.dtype([(n, "<i8") for n in ("number", "fd", "topic", "skip", "worker", "blocks", "queued", "dropped")])
"""A connection to a reader of one stream.

number       of the output in the journal;  fd  file descriptor
topic, skip  address and length of the stream's name and a zero byte; `HEADER` free bytes precede the topic
worker       whether it is a worker of the run
blocks       whether the sender waits for it;  queued  whether earlier bytes for it are queued
dropped      number of messages that did not fit into its buffer
"""
SEGMENT = np.dtype(
    [(n, "<i8") for n in ("rows", "count", "clock", "port", "ports", "reader", "readers", "keeps", "base", "first")]
)
"""A segment of compiled nodes (`engine.segment`).

rows, count    address and number of its `ROW`s;  clock  address of its `CLOCK`
port, ports    address and number of the addresses of its `PORT`s;  reader, readers  address and number of its `READER`s
keeps          whether an observer takes its messages, so that they stay in the journal
base           number of its first node in the worker;  first  entry of the journal at which a tick's messages begin
"""
TALLY = np.dtype([(n, "<i8") for n in ("step", "age", "overdue")])
"""Counters of a node.

step, age  addresses of the `engine.health.Histogram.words` of measured steps, and of ages of outputs on the real clock
overdue    number of outputs older than a period
"""
HOP = np.dtype([
    ("exact", "<f8"), *((n, "<i8") for n in (
        "segments", "count", "at", "entry", "reader", "sent", "scratch", "tallies",
        "origin", "period", "last", "end", "lead", "port", "late", "lost", "now", "time", "begun", "done",
        "wakes", "spread", "held",
    ))
])  # fmt: skip
"""State of a hop.

segments, count  address and number of its `SEGMENT`s
at               segment at which it was interrupted;  entry, reader, sent  the message, the reader and the number of
                 bytes sent, if a reader's buffer is full
scratch          address of memory for system calls (`SCRATCH` numbers)
tallies          address of the `TALLY` of each node

On the real clock:

exact, period    [ns] between ticks, and rounded;  origin  [ns] time of tick 0
last, end        last tick that has run, last tick of the run;  done  number of ticks that have run in this call
lead, port       address of the `ROW` of the node that leads, and of the `PORT` that drives it, 0: the clock drives it
late, lost       counts of the leading node since the last call
now, time, begun the present tick, its time [ns], and when its nodes began [ns of the monotonic clock]
held             [ns] after `begun` for which the driving message is waited for; 0: as long as it takes
wakes, spread    [ns] by how much later than asked a sleep ends, and the mean deviation from it; running means
"""
STREAM = np.dtype([(n, "<i8") for n in ("topic", "skip", "wanted", "first", "open")])
"""A stream of a block whose messages become frames.

topic, skip  address and length of the stream's name and a zero byte
wanted       whether to make frames of it
first, open  numbers of its first frame and of the one to which the next message belongs; -1: none
"""
FRAME = np.dtype([(n, "<i8") for n in ("begin", "end", "next", "count", "size", "done", "entry", "data")])
"""A frame of the messages of one stream.

begin, end  of its bytes;  next  number of the next frame of the stream; -1: none
count, size number of its messages, and [bytes] of them without margins;  done  number of copied messages
entry, data address of the entry and, from the first one on, offset of the bytes of the next message
"""
MARK, COUNT = 0xC1, 4
"""The first byte after the topic of a frame, which begins no msgpack value, and the bytes of its number of messages."""
HEADER, SCRATCH = 9, 32
DONE, INPUT, OUTPUT, JOURNAL, FAILED, BETWEEN = range(6)
"""Why a call returned: all ticks have run; an input is missing or has another form; a reader needs attention; the
journal is full; a node failed; the next tick of the real clock does not begin soon."""
