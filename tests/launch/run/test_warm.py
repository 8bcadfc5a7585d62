"""The runner warms nodes up: no step of a run compiles a kernel or loads one from the cache."""

import json
import subprocess
import sys
from typing import Annotated

import numpy as np
import pytest
from numba import njit

from palpate.launch.testing import FakeBus
from palpate.messages import Floats, Force, Ints, Message, Pose, Vector
from palpate.messages.docs import message_types
from palpate.nodes.base import Node

GRAPHS = (
    ("kidney", "0.4"),
    ("kidney", "0.4", "tissue.use=deformation.BeamBundle", "collision.use=collision.Mesh"),
    ("fingertip-slide", "0.05"),
    ("pinch", "0.5"),
    ("pinch", "0.5", "tissue.use=deformation.ReducedFE"),
)
OTHERS = (  # graphs whose kernels are all in GRAPHS
    ("kidney", "0.4", "tissue.use=deformation.ReducedFE"),
)
RUNS = """
import json
import os
import sys
from numba.core.dispatcher import Dispatcher
from palpate.launch.load.launchfile import find
from palpate.launch.run import forkserver
from palpate.launch.run.execute import execute
from palpate.launch.run.work.worker import Worker

forkserver.load()  # imports that are independent of the graph, once for all
late, start, compiled = [], Worker.start, Dispatcher.compile

def started(self):  # named as in the method: the watchdog looks for it
    start(self)
    Dispatcher.compile = lambda kernel, types: (late.append(kernel.py_func.__name__), compiled(kernel, types))[1]

Worker.start = started
for name, duration, *overrides in json.loads(sys.argv[1]):
    child = os.fork()
    if child == 0:
        launch = find(name).but(place="fused", clock="simulated", duration=float(duration), overrides=tuple(overrides))
        result = execute(launch).result
        print(name, *overrides, result.ok, result.deaths, late, flush=True)
        os._exit(not result.ok or bool(late))
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "graphs", [GRAPHS, pytest.param(OTHERS, marks=pytest.mark.long)], ids=["each kernel", "others"]
)
def test_graphs_compile_nothing_after_their_start(tmp_path, graphs):
    """Each graph runs until after the first touch in a separate process, because kernels compiled by an earlier test or
    graph would hide a late compilation."""
    command = [sys.executable, "-c", RUNS, json.dumps(graphs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)  # for their recordings
    codes = [line for line in done.stdout.splitlines() if line.lstrip("-").isdigit()]
    assert codes == ["0"] * len(graphs), done.stdout + done.stderr


class Net(Message):
    """A custom message.

    edges   [1] (e,2)  vertices of each
    pull    [N] (e)    of each
    gains   [1] (g)    of the display
    tight   [1] ()     whether one is at its limit
    """

    edges: Annotated[Ints, "1", ("e", 2)]
    pull: Annotated[Floats, "N", ("e",)]
    gains: Annotated[Vector, "1", ("g",)]
    tight: Annotated[bool, "1"]


def total(pull, edges, gain):
    return gain * pull.sum() + 0.0 * edges.sum()


class Pull(Node):
    """A custom node with a kernel, without code for warm-up."""

    begins: Annotated[int, "1"] = 0

    def start(self):
        self.kernel = KERNEL
        self.steps = 0

    def step(self, net: Net, pose: Pose | None, *, dt: float) -> Force:
        self.steps += 1
        force = self.kernel(net.pull, net.edges, net.gains[0]) if len(net.gains) else 0.0
        return Force(force=(force, float(self.steps), dt), state="free", energy=0.0)


KERNEL = njit(total)


def test_a_custom_kernel_is_compiled_before_the_first_step():
    bus = FakeBus(Pull())
    before = list(KERNEL.signatures)
    assert len(before) == 1
    net = Net(edges=[[0, 1], [1, 2]], pull=[1.0, 2.0], gains=(2.0,), tight=False)
    (force,) = bus.publish(net)
    assert KERNEL.signatures == before
    assert force.force == (6.0, 1.0, 1e-3)  # and the state is the initial one


class Sink(Pull):
    sink = True


class Device(Pull):
    hardware = True


class Refuses(Pull):
    def step(self, net: Net, pose: Pose | None, *, dt: float) -> Force:
        if len(net.pull) != 3:
            raise SystemExit("expected three")
        return super().step(net, pose, dt=dt)


@pytest.mark.parametrize("kind", [Sink, Device])
def test_a_node_with_external_effects_is_not_stepped_before_the_run(kind):
    calls = []
    node = kind()
    node.step = lambda *messages, dt: calls.append(messages)
    node.start = lambda: calls.append("start")
    FakeBus(node)
    assert calls == ["start"]


def test_an_example_that_a_node_rejects_is_ignored():
    net = Net(edges=np.zeros((3, 2)), pull=np.ones(3), gains=(2.0,), tight=False)
    assert FakeBus(Refuses()).publish(net)[0].force == (6.0, 1.0, 1e-3)


@pytest.mark.parametrize("kind", message_types().values(), ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("loaded", [False, True])
def test_every_message_has_an_example_that_can_be_sent(kind, loaded):
    assert type(kind.example(loaded)) is kind
