"""Placement never changes the messages: random graphs of small nodes with divisors, optional inputs, several outputs,
loops, and messages of earlier ticks from nodes that run before, in Python and compiled, in random groupings, compared
with the same graph in one process."""

import random
from pathlib import Path

import pytest

from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.run.execute import execute
from palpate.records.reader import Recording

TICKS = 60


def graph(rng: random.Random, compiled: float) -> tuple[str, list[str]]:
    """A random graph as text, and its nodes. A node reads earlier nodes, and any node with its third input. The second
    paced node reads a message of an earlier tick from a node that runs before it.

    compiled  share of compiled nodes
    """

    def form() -> str:
        return "Compiled" if rng.random() < compiled else ""

    names = [f"n{i}" for i in range(1, rng.randint(4, 7))]
    kinds = {name: rng.choice(["One", "Two"]) for name in names}
    torques, forces = ["n0"], [f"{name}.Force" for name in names if kinds[name] == "Two"]
    lines = []
    for name in names:
        wires = [f"first: {rng.choice(torques)}"]
        if rng.random() < 0.6:
            sender = rng.choice(torques)
            wires.append(f"second: {{from: {sender}, loop: true}}" if rng.random() < 0.3 else f"second: {sender}")
        if forces and rng.random() < 0.6:
            wires.append(f"third: {rng.choice(forces)}")
        every = rng.choice([1, 1, 1, 2, 3, 7])
        use = f"nodes_for_placement.{form()}{kinds[name]}"
        lines.append(f"  {name}: {{use: {use}, every: {every}, in: {{{', '.join(wires)}}}}}")
        torques.append(f"{name}.Torque" if kinds[name] == "Two" else name)
    head = f"nodes:\n  n0: {{use: nodes_for_placement.{form()}Clock, in: {{back: {torques[-1]}}}}}\n"
    lines.append(f"  m0: {{use: nodes_for_placement.{form()}Clock, in: {{back: {rng.choice(torques)}}}}}")
    return head + "\n".join(lines) + "\n  log: {use: logger.Mcap, in: all}\n", ["n0", *names, "m0"]


def run(folder: Path, place: Path | str | None) -> dict[str, list[bytes]]:
    record = folder / "run.mcap"
    launch = LaunchFile(graph=folder / "g.yaml", duration=TICKS / 1000, record=record, place=place)
    outcome = execute(launch)
    assert outcome.result.ok, outcome.result.deaths
    payloads: dict[str, list[bytes]] = {}
    for stream, _, payload in Recording(record).payloads():
        payloads.setdefault(stream, []).append(payload)
    return payloads


@pytest.mark.parametrize("compiled", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(s, marks=pytest.mark.long) for s in range(3, 24))])
def test_a_random_graph_sends_the_same_bytes_in_any_grouping(tmp_path, seed, compiled):
    rng = random.Random(seed)
    text, names = graph(rng, compiled)
    (tmp_path / "g.yaml").write_text(text)
    alone = run(tmp_path, "fused")
    assert len(alone["n0"]) == TICKS
    groups: dict[int, list[str]] = {}
    for name in rng.sample(names, len(names)):
        groups.setdefault(rng.randint(0, 2), []).append(name)
    place = tmp_path / "place.yaml"
    place.write_text("\n".join(f"g{i}: {{nodes: [{', '.join(group)}]}}" for i, group in groups.items()))
    assert run(tmp_path, place) == alone
    assert run(tmp_path, None) == alone
