"""A node that stops without a word: the rule for the age of inputs takes the torque from the device in time.

Each node of a graph runs by the rules of the real clock as in a process of its own, without processes and on a clock
that stands: only the numbers of the ticks count, so that the answer does not depend on the machine.
"""

from itertools import pairwise

import pytest
from graphs_for_runs import write_graph

from palpate.launch.load.launchfile import LaunchFile, find

LAST = 20  # [ticks of 1 ms] promised between the last message of a node and a device without torque


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("node", ["finger", "collision", "contact", "spread", "tissue", "controller", "statics"])
def test_the_device_is_without_torque_soon_after_any_node_has_stopped(chain, node, late):
    """Whatever stops, and even where each hop takes a tick; only friction is done without."""
    run = chain(find("kidney"), late)
    run.run(700)
    assert run.torque() > 0.03
    silent = 0
    while run.torque() > 0.0:
        run.run(1, node)
        silent += 1
        assert silent < LAST


def test_without_friction_the_contact_goes_on(chain):
    run = chain(find("kidney"))
    run.run(700)
    run.run(100, "friction")
    assert run.torque() > 0.03


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("links", [1, 2, 3, 5])
def test_nodes_that_hold_one_another_s_messages_share_the_time(chain, tmp_path, links, late):
    """Each of them needs what it holds, so one falls silent after the other."""
    names = ["first", *(f"n{i}" for i in range(links))]
    held = "".join(
        f"  {name}: {{use: nodes_for_runs.Hold, in: {{pose: source, force: {before}}}}}\n"
        for before, name in pairwise(names)
    )
    graph = write_graph(
        tmp_path,
        "nodes:\n  source: {use: nodes_for_runs.Source, in: {torque: end}}\n"
        "  first: {use: nodes_for_runs.Spring, in: {pose: source}}\n"
        f"{held}  end: {{use: nodes_for_runs.Turn, in: {{force: n{links - 1}}}}}\n",
    )
    run = chain(LaunchFile(graph=graph), late)
    run.run(50)
    assert run.torque() == 1.0
    silent = 0
    while run.torque() > 0.0:
        run.run(1, "first")
        silent += 1
        assert silent < LAST
