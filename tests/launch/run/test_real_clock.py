"""The loop on the real clock: waits for inputs and their limits, lost and expired inputs, and a death.

Rates are low and margins wide for busy machines, and each run continues until a node has made enough steps, even if the
machine stalls. The tests assert order, not speed.
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
    """A run that continues until the counters of these nodes have reached their values."""
    path = folder / "run.mcap"
    place = None if groups is None else write_place(folder, groups)
    graph = write_graph(folder, f"rate: {RATE}\n{text}")
    run = LaunchFile(graph=graph, record=path, clock="real", place=place)
    return execute(run, patience=30, watch=until_it_has(**counts)).result, Recording(path)


def slow(node: str, cls: str, text: str = GRAPH, **settings: object) -> str:
    given = "".join(f", {key}: {value}" for key, value in settings.items())
    return text.replace(f"nodes_for_runs.{node}", f"nodes_for_recording.{cls}{given}")


@pytest.mark.parametrize("groups", [None, [["source", "drag"], ["spring"], ["spread", "sum"]]])
def test_dt_is_the_time_since_the_previous_step(tmp_path, groups):
    """The first step has the nominal dt. A replay computes dt from the same times, so it cannot detect an error."""
    _, recording = live(tmp_path, slow("Drag", "SlowDrag"), groups, drag=("steps", 20))
    steps = list(recording.messages("drag"))
    printed = [message.bristle[1] for message in steps]
    times = [message.time for message in steps]
    assert printed[0] == 1 / RATE
    assert printed[1:] == [(b - a) * 1e-9 for a, b in pairwise(times)]
    assert any(dt != 1 / RATE for dt in printed[1:])


def test_a_node_waits_for_an_input_of_the_same_tick_up_to_the_end_of_the_period(tmp_path):
    """The spring takes 20 % of the period. Drag gets its pose earlier, and uses the force of the same tick."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=0.01), drag=("steps", 25))
    steps = list(recording.messages("drag"))
    assert result.ok and len(steps) > 15
    assert sum(message.used == (message.tick, message.tick) for message in steps) > len(steps) / 2


def test_a_node_does_not_wait_beyond_the_period(tmp_path):
    """The spring takes more than two periods for each force; drag also steps at the other ticks, with older forces."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=2.3 / RATE), drag=("steps", 35))
    ticks = {name: {message.tick for message in recording.messages(name)} for name in ("spring", "drag")}
    drag = list(recording.messages("drag"))
    assert result.ok and len(drag) >= 35
    assert len(ticks["drag"] - ticks["spring"]) > 2
    assert sum(message.used[1] < message.tick for message in drag) > len(drag) / 2


def test_driving_messages_skipped_by_a_busy_node_are_counted_as_lost(tmp_path):
    """Only the newest waiting message runs a step."""
    result, recording = live(tmp_path, slow("Spring", "Late", delay=3.2 / RATE), spring=("lost", 11))
    sent = len(list(recording.messages("source")))
    spring = result.health["spring"]
    assert spring["lost"] > 10
    assert 0 <= sent - spring["steps"] - spring["lost"] <= 5  # messages that arrived during its last step


def test_an_expired_input_is_absent(tmp_path):
    """Drag takes about 20 periods for one step: its previous friction is held for three periods, then it is absent.
    Periods in which no node stepped do not count."""
    groups = [["source"], ["spring", "spread", "sum"], ["drag"]]
    _, recording = live(tmp_path, slow("Drag", "Dozing", at=10, seconds=1.2), groups, drag=("steps", 15))
    before, dozed, after = [message.tick for message in recording.messages("drag")][8:11]
    used = [message.used[1] for message in recording.messages("spread") if dozed <= message.tick < after - 2]
    assert used[0] == before, "held"
    assert len(used) > 10 and set(used[6:]) == {-1}, used


def test_after_a_death_the_others_continue_until_the_device_is_notified(tmp_path):
    """The end of the process, not its silence, triggers the notification; the source then steps without a torque."""
    text = GRAPH.replace("nodes_for_runs.Spring,", "nodes_for_runs.Faulty, how: kill, at: 12,")
    result, recording = live(tmp_path, text, source=("steps", 30 * RATE))
    (death,) = result.deaths
    assert death.node == "spring"
    last = max(message.tick for message in recording.messages("spring"))
    after = [message for message in recording.messages("source") if message.tick > last]
    # Within 1 s of running time; silence would count after 30 s.
    assert any(message.position[2] for message in after[:RATE])
    assert len(after) < 3 * RATE


def test_a_stalled_loop_continues_without_a_jump(tmp_path):
    """All nodes of one process stall for 150 ms. The last message of the tissue does not expire for the contact, which
    stalled as well: without it, the contact would lose the indentation and apply all of it again in one tick."""
    loop = ["device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics"]
    path, place = tmp_path / "run.mcap", write_place(tmp_path, [loop])
    sets = (
        "scene.surface.vertices=1000", "tissue.use=nodes_for_recording.DozingTissue", "tissue.at=500",
        "scene.hand.begin=[0, 0, 0.111]", "scene.hand.path=[{to: [0, 0, 0.096], time: 0.3}]",
    )  # fmt: skip
    launch = find("kidney").but(record=path, clock="real", duration=None, place=place, overrides=sets)
    assert execute(launch, patience=30, watch=until_it_has(tissue=("steps", 1000))).result.ok
    contact = Recording(path).columns("contact")
    held = int(np.searchsorted(contact["time"], 0.5))  # the finger is down, also after stalls
    at = held + int(np.argmax(np.diff(contact["tick"][held:])))
    assert contact["tick"][at + 1] - contact["tick"][at] > 100
    before, after = contact["force"][at], contact["force"][at + 1 : at + 20]
    assert before > 1.0
    assert after[0] > 0.5 * before and after.max() < 10.0


def test_messages_of_a_fast_clock_are_recorded_once_and_in_order(tmp_path):
    """Above 2.5 kHz they are handed over in another pause between two ticks than they are sent."""
    path = tmp_path / "fast.mcap"
    launch = find("kidney").but(place="auto", clock="real", duration=0.5, overrides=("rate=5000",), record=path)
    result = execute(launch).result
    assert result.ok, result.deaths
    recording = Recording(path)
    counts = recording.counts
    assert all(count["lost"] == 0 for count in counts.values()) and len(counts) > 8
    for stream in counts:
        found = [message.tick for message in recording.messages(stream)]
        assert len(found) == result.health[stream]["steps"] > 500
        assert all(a < b for a, b in pairwise(found))
