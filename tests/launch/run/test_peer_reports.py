"""What a launcher believes of a worker's report: a peer with the key may send any, in the name of any group."""

import random

import pytest
import zmq
from test_start_barrier import NODES, READY, free_port

from palpate.engine.health import Counters
from palpate.launch.run import reports
from palpate.launch.run.launcher import Launcher
from palpate.launch.run.result import NodeFault
from palpate.launch.run.wire.addresses import endpoint, is_tcp
from palpate.launch.run.wire.printable import LONGEST
from palpate.launch.run.wire.wires import wrong_endpoint

ESCAPE = "\x1b]52;c;ZXZpbA==\x07"
GOOD = ["tcp://127.0.0.1:1", "tcp://lab-2.example.org:65535", "tcp://[fe80::1%eth0]:5555", "tcp://10.0.0.2:5556"]
BAD = [
    "ipc:///tmp/palpate-0/1/a.force", "ipc://@abstract", "inproc://a", "pgm://10.0.0.1;239.0.0.1:5555", "udp://a:1",
    "tcp://*:5555", "tcp://10.0.0.2:*", "tcp://10.0.0.2:0", "tcp://10.0.0.2:65536", "tcp://10.0.0.2", "tcp://:5555",
    "tcp://eth0;10.0.0.2:5555", "tcp://10.0.0.2:5555\n", "tcp://10.0.0.2:5555/x", " tcp://10.0.0.2:5555", "",
    "tcp://a b:1", "TCP://10.0.0.2:5555", "tcp://10.0.0.2:٣", f"tcp://{'a' * 254}:1",
]  # fmt: skip
SEARCHED = 2000


def test_only_one_host_and_port_of_tcp_is_an_address_of_another_machine():
    assert [address for address in GOOD if not is_tcp(address)] == []
    assert [address for address in BAD if is_tcp(address)] == []


def test_changed_addresses_name_no_local_socket():
    """Random insertions and other transports: libzmq connects to an accepted address by TCP, or refuses it."""
    draw, accepted, added = random.Random(3), 0, ["", "/", "@", ";", ":", "*", "ipc://", "\x00", "9"]
    with zmq.Context() as context:
        for _ in range(SEARCHED):
            address = draw.choice(GOOD + BAD)
            for _ in range(draw.randint(0, 2)):
                at = draw.randint(0, len(address))
                address = address[:at] + draw.choice(added) + address[at:]
            if is_tcp(address):
                accepted += 1
                assert address.startswith("tcp://") and ";" not in address and "/" not in address[6:]
                with context.socket(zmq.SUB) as socket:
                    socket.set(zmq.LINGER, 0)
                    try:
                        socket.connect(address)
                    except zmq.ZMQError:
                        continue
                    assert socket.get(zmq.LAST_ENDPOINT).startswith(b"tcp://")
    assert 50 < accepted < SEARCHED


def test_a_worker_here_may_also_name_its_sockets_and_no_others():
    mine = {outlet: [endpoint("run", "a", name)] for outlet, name in (("force", "force"), ("observers", "members"))}
    theirs = {outlet: [address.replace("a.", "b.")] for outlet, (address,) in mine.items()}
    assert wrong_endpoint("run", "a", False, mine) == "" and wrong_endpoint("run", "a", False, READY.endpoints) == ""
    assert "expected tcp://" in wrong_endpoint("run", "a", True, mine)
    assert " or tcp://" in wrong_endpoint("run", "a", False, theirs)
    assert " or tcp://" in wrong_endpoint("run", "a", False, {**mine, "observers": mine["force"]})
    for lacking in ({}, {"force": GOOD}, {**mine, "force": []}):
        assert "no address of its outlet" in wrong_endpoint("run", "a", False, lacking)


@pytest.fixture
def launcher():
    made = Launcher((NODES,), joined=frozenset(("a",)), address=f"tcp://127.0.0.1:{free_port()}")
    yield made
    made._control.sockets.close(0)
    made.forkserver.close()


@pytest.mark.parametrize("wrong", [{"force": ["ipc:///tmp/x"], "observers": GOOD[:1]}, {}], ids=["local", "none"])
def test_a_peer_that_names_a_local_socket_or_no_outlet_ends_the_run(launcher, wrong):
    launcher._take(launcher.members["a"], reports.Ready(wrong))
    (death,) = launcher.result.deaths
    assert death.node == "source" and "address" in death.text and launcher.members["a"].state == "gone"
    assert launcher.members["a"].endpoints == {}


def test_text_of_a_peer_is_one_printable_line_about_its_nodes(launcher):
    printed = []
    launcher.printed = printed.append
    member = launcher.members["a"]
    launcher._take(member, reports.Note(f"a\r\nrecording saved{ESCAPE}{'x' * 3 * LONGEST}", f"sum{ESCAPE}"))
    launcher._take(member, reports.Starting(f"source{ESCAPE}"))
    assert launcher.busy.get("a", "") == ""
    launcher._take(member, reports.Ready(READY.endpoints, [f"no priority{ESCAPE}\n"]))
    counters = Counters(0, 1, 0, 0, 0, 0, "ready", {}, {})
    launcher._take(member, reports.Alive({f"other{ESCAPE}": counters, "source": counters}))
    assert list(launcher.result.health) == ["source"]
    launcher._take(member, NodeFault(f"other{ESCAPE}", f"step{ESCAPE}", f"x{ESCAPE}", f"line 1\n\tline 2\r{ESCAPE}"))
    (death,) = launcher.result.deaths
    assert (death.node, death.where) == ("source", "step␛]52;c;ZXZpbA==␇") and death.trace.count("\n") == 1
    note, refused = launcher.result.notes
    assert note.startswith("a recording saved␛]52") and note.node == "" and len(note) < LONGEST + 10
    texts = [*printed, note, refused, death.text, death.trace, *launcher.result.health]
    assert refused.startswith("no priority␛") and not any(c in text for text in texts for c in "\x1b\x07\r")
