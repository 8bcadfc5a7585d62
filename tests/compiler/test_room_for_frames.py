"""Room for frames: nested calls map no memory, and nothing else of a call changes."""

import resource
import subprocess
import sys
import threading

import pytest

from palpate.registry import with_room

DEPTH, CALLS = 400, 2000


def edge(depth, calls):
    """Calls a function often at the end of a chain of calls."""
    if depth:
        return edge(depth - 1, calls)
    before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
    for _ in range(calls):
        int.__add__(1, leaf(2))
    return resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before


def leaf(x):
    return x


def faults(around):
    """Page faults of many calls at each depth, in a new thread."""
    found = []
    thread = threading.Thread(target=lambda: found.extend(around(edge, depth, CALLS) for depth in range(DEPTH)))
    thread.start()
    thread.join()
    return found


def test_calls_at_every_depth_map_no_memory():
    bare = faults(lambda call, *given: call(*given))
    assert max(bare) >= CALLS  # what it is against: pieces end at some of the depths
    assert max(faults(with_room)) < CALLS / 20


def test_a_nested_call_and_an_exception():
    assert with_room(with_room, divmod, 7, 3) == (2, 1)
    assert with_room(dict, a=1) == {"a": 1}
    with pytest.raises(ZeroDivisionError):
        with_room(divmod, 1, 0)
    assert max(faults(with_room)) < CALLS / 20  # after the exception there is room again


def test_recursion_ends_as_usual():
    text = (
        "from palpate.registry import with_room\n"
        "def again(n): return again(n + 1)\n"
        "try: with_room(again, 0)\n"
        "except RecursionError: print('ended')"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=60)
    assert done.stdout == "ended\n", done.stderr
