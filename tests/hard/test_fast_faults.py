"""Faults at 5 and 10 kHz with a process for each node, where compiled code reads the sockets: losses, outages,
duplicates, reordering, delays, garbage, half frames, another protocol, readers that do not read, and nodes that stop.

The contact force is at most 1.2 times that of the same motion without the fault, the torque is zero within 20 ms of a
death, every message is recorded or counted as lost, and the run ends. A fault that fails is run again by
`python tests/support/bad_wires.py SEED`.
"""

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from bad_wires import NODES, RATES, WIRES, draw, run, undisturbed


@pytest.fixture(scope="module")
def base(tmp_path_factory) -> dict[float, float]:
    """Largest contact force [N] without faults, by rate."""
    folder = tmp_path_factory.mktemp("base")
    forces = {rate: undisturbed(rate, folder) for rate in RATES}
    assert min(forces.values()) > 0.5
    return forces


def check(seeds, base: dict[float, float]) -> None:
    failed = []
    for seed in seeds:
        fault = draw(seed)
        with TemporaryDirectory() as folder:
            wrong = run(fault, Path(folder), base[fault.rate])
        if wrong:
            failed.append(f"seed {seed}, {fault}: {'; '.join(wrong)}")
            print(failed[-1], flush=True)
    assert not failed, "\n".join(failed)


def test_a_node_that_stops_a_damaged_stream_and_lost_commands_do_no_harm(base):
    """Seeds 57, 5 and 11."""
    assert [draw(seed)[:3] for seed in (57, 5, 11)] == [
        ("stop", "tissue", 10_000.0), ("garbage", "friction", 5000.0), ("lose", "statics", 5000.0)
    ]  # fmt: skip
    check((57, 5, 11), base)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_hundreds_of_random_faults_do_no_harm(base):
    """As many as PALPATE_FAULTS says."""
    check(range(1000, 1000 + int(os.environ.get("PALPATE_FAULTS", "300"))), base)


def test_all_kinds_of_faults_are_drawn():
    drawn = [draw(seed) for seed in range(1000, 1300)]
    assert {fault.kind for fault in drawn} == {*NODES, *WIRES} and {fault.rate for fault in drawn} == {*RATES}
