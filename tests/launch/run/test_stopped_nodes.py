"""A node stops silently: the limits of input ages remove the torque from the device in time.

Each node of a graph runs by the rules of the real clock as in a separate process, but without processes and on a
constant clock: only tick numbers count, so that the result does not depend on the machine.
"""

from itertools import pairwise

import pytest
from graphs_for_runs import write_graph

from palpate.launch.load.launchfile import LaunchFile, find

LAST = 20  # [ticks of 1 ms] documented limit from the last message of a node to a device without torque


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("node", ["finger", "collision", "contact", "spread", "tissue", "controller", "statics"])
def test_the_device_loses_its_torque_in_time_after_any_node_stops(chain, node, late):
    """All nodes except friction, which is optional, also if each hop takes one tick."""
    run = chain(find("kidney"), late)
    run.run(700)
    assert run.torque() > 0.03
    silent = 0
    while run.torque() > 0.0:
        run.run(1, node)
        silent += 1
        assert silent < LAST


def test_the_contact_continues_without_friction(chain):
    run = chain(find("kidney"))
    run.run(700)
    run.run(100, "friction")
    assert run.torque() > 0.03


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("links", [1, 2, 3, 5])
def test_a_chain_of_held_inputs_shares_the_time_limit(chain, tmp_path, links, late):
    """Each held input is required, so the nodes stop one after another."""
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
