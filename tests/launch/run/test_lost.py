"""A lost message is detected: on the simulated clock its reader would wait forever."""

import random_faults
from pytest import mark, param
from random_faults import Fault

from palpate.engine.job import Job, NodeJob
from palpate.launch.run.member import WorkerHandle, find_loss

SIGNS = 5


def member(name: str, awaits: tuple[str, int] | None) -> WorkerHandle:
    node = NodeJob(name=name, cls="x.Y", settings={}, every=1, inputs=(), streams=(name,))
    return WorkerHandle(Job(group=name, nodes=(node,)), state="running", awaits=awaits)


def loser(*members: WorkerHandle, signs: int = SIGNS, **ticks: int) -> str | None:
    """The worker whose message counts as lost after this number of heartbeats without progress."""
    gone = None
    for _ in range(signs + 1):
        gone = gone or find_loss(members, {name: {"tick": tick} for name, tick in ticks.items()}, SIGNS)
        for given in members:
            given.waits(given.awaits)
    return gone[0].names if gone else None


def test_a_message_is_lost_if_its_sender_is_beyond_it():
    def pair() -> tuple[WorkerHandle, WorkerHandle]:
        return member("a", ("b", 8)), member("b", ("a", 7))

    assert loser(*pair(), a=7, b=7) == "a"  # a has sent its message of tick 7, and b has not received it
    assert loser(*pair(), a=6, b=7) is None
    assert loser(*pair(), signs=SIGNS - 1, a=7, b=7) is None


def test_a_sender_that_may_not_have_sent_has_lost_nothing():
    """It has stepped, and another reader blocks it: it does not wait for a message."""
    a, b = member("a", None), member("b", ("a", 7))
    assert loser(a, b, a=7, b=6) is None
    assert loser(a, b, a=8, b=6) == "a"


def test_a_long_wait_for_a_slow_sender_is_not_a_loss():
    """The report that the message was sent arrives before the report that the reader continues."""
    a, b = member("a", None), member("b", ("a", 7))
    assert loser(a, b, signs=10 * SIGNS, a=6, b=6) is None
    a.waits(("b", 8))
    assert loser(a, b, signs=SIGNS - 1, a=7, b=6) is None
    b.waits(("a", 8))
    assert loser(a, b, signs=10 * SIGNS, a=7, b=7) is None


@mark.parametrize("what", ["loses a frame", "swaps two frames", "garbles a frame"])
def test_a_run_ends_and_names_the_sender(tmp_path, what):
    fault = Fault("wire", what, "spring", "simulated", "each", "loop", 40)
    assert random_faults.run(fault, tmp_path) == []
    if what == "garbles a frame":  # reported as an invalid message, not as a lost one
        printed = " ".join((tmp_path / "output").read_text().split())
        assert "node 'spring', stream 'spring': MessageError" in printed, printed


@mark.parametrize("what", ["sends a frame twice", param("floods", marks=mark.long)])
def test_duplicate_frames_are_dropped(tmp_path, what):
    fault = Fault("wire", what, "spring", "simulated", "each", "loop", 40)
    assert random_faults.run(fault, tmp_path) == []
