"""A message that was sent and does not come: on the simulated clock its reader would wait for ever."""

import random_faults
from pytest import mark
from random_faults import Fault

from palpate.launch.running.job import Job, NodeJob
from palpate.launch.running.lost import lost
from palpate.launch.running.member import Member

SIGNS = 5


def member(name: str, awaits: tuple[str, int] | None, awaited: int = SIGNS) -> Member:
    node = NodeJob(name=name, cls="x.Y", settings={}, every=1, inputs=(), streams=(name,))
    return Member(Job(group=name, nodes=(node,)), state="running", awaits=awaits, awaited=awaited)


def told(*members: Member, **ticks: int) -> str | None:
    gone = lost(members, {name: {"tick": tick} for name, tick in ticks.items()}, SIGNS)
    return gone[0].names if gone else None


def test_the_sender_is_beyond_what_is_awaited():
    a, b = member("a", ("b", 8)), member("b", ("a", 7))
    assert told(a, b, a=7, b=7) == "a"  # a has sent its message of tick 7, and b has not got it
    assert told(a, b, a=6, b=7) is None


def test_a_sender_that_may_not_have_sent_yet_has_lost_nothing():
    """It stepped, and is held back by another reader: it waits for no message itself."""
    a, b = member("a", None), member("b", ("a", 7))
    assert told(a, b, a=7, b=6) is None
    assert told(a, b, a=8, b=6) == "a"


def test_a_reader_that_has_just_begun_to_wait_has_lost_nothing():
    a, b = member("a", ("b", 8)), member("b", ("a", 7), awaited=SIGNS - 1)
    assert told(a, b, a=7, b=7) is None


def test_what_is_awaited_anew_is_counted_anew():
    a = member("a", None, 0)
    for tick, count in ((4, 0), (4, 1), (4, 2), (5, 0), (5, 1)):
        a.waits(("b", tick))
        assert a.awaited == count
    a.waits(None)
    assert a.awaited == 0 and a.awaits is None


@mark.parametrize("what", ["loses a frame", "swaps two frames", "garbles a frame"])
@mark.parametrize("carrier", ["zmq", "local"])
def test_a_run_ends_and_names_the_sender(tmp_path, what, carrier):
    fault = Fault("wire", what, "spring", "simulated", carrier, "each", "loop", 40)
    assert random_faults.run(fault, tmp_path) == []


@mark.parametrize("what", ["sends a frame twice", "floods"])
def test_frames_that_come_again_are_dropped(tmp_path, what):
    fault = Fault("wire", what, "spring", "simulated", "zmq", "each", "loop", 40)
    assert random_faults.run(fault, tmp_path) == []
