"""One tick of a segment, in compiled code.

The rules for messages between two nodes of the segment are those of `engine.schedule` and of the loops on both clocks
(launch/run/work). A host gathers messages from other senders and writes them into the table.
"""

import numpy as np

from palpate.compiler.kernel import kernel
from palpate.compiler.memory import copy, number, pointer, set_word, word
from palpate.compiler.records import call
from palpate.engine import schedule
from palpate.engine.encode import encode, encoded_size
from palpate.engine.schedule import FRESH, MISSED, OLD
from palpate.engine.table import CLOCK, FAULT, INFINITE, INPUT, LANE, OUTPUT, RAISED, ROW, TAP
from palpate.messages.record import HEAD
from palpate.nodes.base.block import ENTRY, MARGIN
from palpate.records.format import message_head
from palpate.records.format.message_head import HEAD_LENGTH, MESSAGE

row_at, input_at, output_at, entry_at = pointer(ROW), pointer(INPUT), pointer(OUTPUT), pointer(ENTRY)
lane_at, tap_at, margin_at = pointer(LANE), pointer(TAP), pointer(message_head.HEAD)
clock_at, head_at = pointer(CLOCK), pointer(np.dtype(HEAD, align=True))
ROW_SIZE, INPUT_SIZE, OUTPUT_SIZE, ENTRY_SIZE = (form.itemsize for form in (ROW, INPUT, OUTPUT, ENTRY))
LANE_SIZE, TAP_SIZE = LANE.itemsize, TAP.itemsize


needed, slept = kernel(schedule.needed_tick), kernel(schedule.slept)
standing, lacks = kernel(schedule.standing), kernel(schedule.lacks)
next_run, nanoseconds = kernel(schedule.next_run), kernel(schedule.nanoseconds)


@kernel
def stands(row, line, sent, now, rate):
    """How a step of a row takes a message of tick `sent` at an input, see `engine.schedule`."""
    need, age = needed(now, line.every, line.loop != 0), now - sent - slept(now, row.due, row.hardware)
    return standing(sent, need, line.drives, age, rate, line.permitted)


@kernel
def gather_inputs(row, now, at, clock):
    """Select the inputs of a step. Returns whether the required ones are available, a bit mask of the available ones,
    and the time of the step [ns]."""
    present, followed = 0, False
    for j in range(row.inputs):
        line = input_at(row.input + j * INPUT_SIZE)
        head = head_at(line.record)
        there = head.there and not line.dead
        if clock.real:
            if there:
                state = stands(row, line, head.tick, now, clock.rate)
                if state == MISSED:
                    return False, 0, at
                row.held += state != FRESH
                row.absent += state == OLD and line.optional
                there = state != OLD
            if not there and not line.optional:
                return False, 0, at
        set_word(line.put, line.record if there else line.absent)
        set_word(row.used + 8 * j, head.tick if there else -1)
        if there:
            present |= 1 << j
            if j < row.follows:
                at, followed = max(at, head.time) if followed else head.time, True
    return True, present, at


@kernel
def finite(row):
    """Whether all numbers of a node's outputs are finite."""
    total = 0.0
    for j in range(row.numbered):
        total += number(word(row.numbers + 8 * j)) * 0.0
    return total == 0.0


@kernel
def step_row(row, at):
    """Run one step of a node at time `at` [ns]. Returns 0, or the cause of the failure (`RAISED`, `FAULT`,
    `INFINITE`)."""
    if row.begun and at <= row.time:  # the driving message is a duplicate or late: the outputs stay
        return 0
    dt = (at - row.time) * 1e-9 if row.begun else row.nominal
    row.time = at
    raised = rests = False
    if row.idle != 0 and row.begun:
        raised, rests = call(row.idle, row.records, row.count, dt)
    if rests:
        row.asleep += 1
        return 0
    if not raised:
        raised, _ = call(row.compute, row.records, row.count, dt)
    row.steps += 1
    if raised:
        return RAISED
    if word(word(row.records)) != 0:
        return FAULT
    return 0 if finite(row) else INFINITE


@kernel
def journal_outputs(row, now, clock):
    """Write the outputs of a node that have listeners to the journal. False: they do not fit."""
    size = count = 0
    for j in range(row.outputs):
        line = output_at(row.output + j * OUTPUT_SIZE)
        if line.period != 0 and now % line.period == 0:
            size += encoded_size(line.steps, line.count, line.record, line.most) + MARGIN
            count += 1
    if clock.length + size > clock.room or clock.entries + count > clock.most:
        return False
    for j in range(row.outputs):
        line = output_at(row.output + j * OUTPUT_SIZE)
        if line.period != 0 and now % line.period == 0:
            clock.length += MARGIN
            begin = clock.journal + clock.length
            end = encode(line.steps, line.count, line.literals, line.record, row.used, row.inputs, begin)
            entry = entry_at(clock.entry + clock.entries * ENTRY_SIZE)
            entry.number, entry.tick, entry.begin = line.number, now, clock.length
            entry.time = head_at(line.record).time
            margin = margin_at(begin - MARGIN)
            margin.kind, margin.length, margin.tick = MESSAGE, HEAD_LENGTH + (end - begin), now
            margin.time = margin.at = max(entry.time, 0)
            clock.length += end - begin
            clock.entries, entry.end = clock.entries + 1, clock.length
    return True


@kernel
def run_table(rows, clock_address, tick, ticks):
    """Run the nodes of a table for `ticks` ticks, starting at `tick`.

    rows, clock_address  addresses of the `ROW`s and of the `CLOCK`
    """
    clock = clock_at(clock_address)
    clock.failed = -1
    for now in range(tick, tick + ticks):
        at = clock.at if clock.real else nanoseconds(now, clock.rate)
        begin = clock.first if clock.resume < 0 else clock.resume
        for i in range(begin, clock.last):
            row = row_at(rows + i * ROW_SIZE)
            if clock.resume < 0:
                row.stepped = False
                if now < row.due or row.blocked or row.skip:
                    continue
                complete, present, time = gather_inputs(row, now, at, clock)
                if not complete:
                    row.lost += now // row.every != row.missed
                    row.missed = now // row.every
                    continue
                why = step_row(row, time)
                if why != 0:
                    clock.failed, clock.why, clock.tick = i, why, now
                    return
                for j in range(row.outputs):
                    head = head_at(word(row.records + 8 * (row.count - row.outputs + j)))
                    head.there, head.tick, head.time, head.present = True, now, time, present
                row.begun, row.stepped, row.last, row.due = True, True, now, next_run(now, row.every)
            clock.resume = -1
            if row.stepped and not journal_outputs(row, now, clock):
                clock.resume, clock.tick = i, now
                return


@kernel(nogil=True)
def run_freely(rows, clock_address, tick, ticks):
    """`run_table` without the interpreter lock, so that other threads run meanwhile, such as that of a recording."""
    run_table(rows, clock_address, tick, ticks)


@kernel(nogil=True)
def run_lanes(lanes, count, ticks):
    """Run `ticks` ticks of each of `count` lanes, one lane after the other. A failed lane does not advance.

    lanes  address of the `LANE`s
    """
    for i in range(count):
        lane = lane_at(lanes + i * LANE_SIZE)
        clock = clock_at(lane.clock)
        for now in range(lane.tick, lane.tick + ticks):
            if clock.failed >= 0:
                break
            run_table(lane.rows, lane.clock, now, 1)
            if clock.failed >= 0:
                break
            lane.tick = now + 1
            if now % lane.every == 0:
                for j in range(lane.tapped):
                    tap = tap_at(lane.taps + j * TAP_SIZE)
                    copy(tap.column + now // lane.every % lane.room * tap.size, tap.source, tap.size)
