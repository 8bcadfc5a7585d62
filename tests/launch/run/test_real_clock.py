"""The loop on the real clock: what a node waits for and for how long, what counts as lost or too old, and a death.

Rates are low and margins wide, so that a busy machine passes, and each run goes on until a node has stepped often
enough, however long the machine stood still meanwhile: what is asserted is order, not speed.
"""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from graphs_for_runs import GRAPH, until_it_has, write_graph, write_place

from palpate.launch.load.launchfile import LaunchFile, find
from palpate.launch.run.execute import execute
from palpate.launch.run.result import Result
from palpate.records.reader import Recording

RATE = 20  # [Hz]


def live(
    folder: Path, text: str, groups: list[list[str]] | None = None, **counts: tuple[str, int]
) -> tuple[Result, Recording]:
    """A run that goes on until these nodes have counted so far."""
    path = folder / "run.mcap"
    place = None if groups is None else write_place(folder, groups)
    graph = write_graph(folder, f"rate: {RATE}\n{text}")
    run = LaunchFile(graph=graph, record=path, clock="real", place=place)
    return execute(run, patience=30, watch=until_it_has(**counts)).result, Recording(path)


def slow(node: str, cls: str, text: str = GRAPH, **settings: object) -> str:
    given = "".join(f", {key}: {value}" for key, value in settings.items())
    return text.replace(f"nodes_for_runs.{node}", f"nodes_for_recording.{cls}{given}")


@pytest.mark.parametrize("groups", [None, [["source", "drag"], ["spring"], ["spread", "sum"]]])
def test_dt_is_the_time_since_the_step_before(tmp_path, groups):
    """Its first step has the nominal one. A replay takes dt from the same times, so it cannot tell."""
    _, recording = live(tmp_path, slow("Drag", "SlowDrag"), groups, drag=("steps", 20))
    steps = list(recording.messages("drag"))
    printed = [message.bristle[1] for message in steps]
    times = [message.time for message in steps]
    assert printed[0] == 1 / RATE
    assert printed[1:] == [(b - a) * 1e-9 for a, b in pairwise(times)]
    assert any(dt != 1 / RATE for dt in printed[1:])


def test_a_node_waits_for_an_input_of_the_same_tick_up_to_the_end_of_the_period(tmp_path):
    """The spring takes a fifth of the period. Drag has its pose long before, and uses the force of the same tick."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=0.01), drag=("steps", 25))
    steps = list(recording.messages("drag"))
    assert result.ok and len(steps) > 15
    assert sum(message.used == (message.tick, message.tick) for message in steps) > len(steps) / 2


def test_a_node_does_not_wait_beyond_the_period(tmp_path):
    """The spring takes over two periods for each force; drag answers also other ticks, by older forces."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=2.3 / RATE), drag=("steps", 35))
    ticks = {name: {message.tick for message in recording.messages(name)} for name in ("spring", "drag")}
    drag = list(recording.messages("drag"))
    assert result.ok and len(drag) >= 35
    assert len(ticks["drag"] - ticks["spring"]) > 2
    assert sum(message.used[1] < message.tick for message in drag) > len(drag) / 2


def test_driving_messages_that_came_while_a_node_was_busy_are_counted_as_lost(tmp_path):
    """Only the newest of those that wait is answered."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=3.2 / RATE), spring=("lost", 11))
    sent = len(list(recording.messages("source")))
    spring = result.health["spring"]
    assert spring["lost"] > 10
    assert 0 <= sent - spring["steps"] - spring["lost"] <= 5  # those that came in its last step


def test_an_input_that_is_too_old_is_absent(tmp_path):
    """Drag takes some twenty periods for one step: the friction before is held for three, then it is absent. Periods
    for which nobody stepped do not count."""
    groups = [["source"], ["spring", "spread", "sum"], ["drag"]]
    _, recording = live(tmp_path, slow("Drag", "Dozing", at=10, seconds=1.2), groups, drag=("steps", 15))
    before, dozed, after = [message.tick for message in recording.messages("drag")][8:11]
    used = [message.used[1] for message in recording.messages("spread") if dozed <= message.tick < after - 2]
    assert used[0] == before, "held"
    assert len(used) > 10 and set(used[6:]) == {-1}, used


def test_after_a_death_the_others_go_on_until_the_device_has_heard_of_it(tmp_path):
    """Told at once, by the end of its process and not by its silence; the source steps on without a torque."""
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: kill, at: 12,")
    result, recording = live(tmp_path, text, source=("steps", 30 * RATE))
    (death,) = result.deaths
    assert death.node == "spring"
    last = max(message.tick for message in recording.messages("spring"))
    after = [message for message in recording.messages("source") if message.tick > last]
    # Within a second of those in which it steps; silence would count after thirty.
    assert any(message.position[2] for message in after[:RATE])
    assert len(after) < 3 * RATE


def test_a_loop_that_stood_still_goes_on_where_it_was(tmp_path):
    """All in one process stand still for 150 ms. What the tissue had said before is not too old for the contact then,
    which stood still as well: without it the contact forgot the indentation, and met all of it anew in one tick."""
    loop = ["device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics"]
    path, place = tmp_path / "run.mcap", write_place(tmp_path, [loop])
    sets = (
        "scene.surface.vertices=1000", "tissue.use=nodes_for_recording.DozingTissue", "tissue.at=500",
        "scene.hand.begin=[0, 0, 0.111]", "scene.hand.path=[{to: [0, 0, 0.096], time: 0.3}]",
    )  # fmt: skip
    launch = find("kidney").but(record=path, clock="real", duration=None, place=place, overrides=sets)
    assert execute(launch, patience=30, watch=until_it_has(tissue=("steps", 1000))).result.ok
    contact = Recording(path).columns("contact")
    held = int(np.searchsorted(contact["time"], 0.5))  # the finger is down, whatever the machine did before
    at = held + int(np.argmax(np.diff(contact["tick"][held:])))
    assert contact["tick"][at + 1] - contact["tick"][at] > 100
    before, after = contact["force"][at], contact["force"][at + 1 : at + 20]
    assert before > 1.0
    assert after[0] > 0.5 * before and after.max() < 10.0
