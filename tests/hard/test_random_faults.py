"""Random faults in whole runs: every process ends, no file or process remains, the faulty node is reported, the
recording can be read, and it contains no force beyond the limit.

One that fails is run again by `python tests/support/random_faults.py SEED`.
"""

import os
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from random_faults import Fault, draw, run

from palpate.launch.load.launchfile import find
from palpate.launch.run.execute import execute


@pytest.fixture(scope="module", autouse=True)
def compiled():
    """Compile the kernels first, because compilation would shift the time of a fault within a run."""
    sets = ("scene.surface.vertices=1000",)
    assert execute(replace(find("kidney").but(place="fused", duration=0.01, overrides=sets), record=None)).result.ok


def tried(seed: int) -> tuple[int, Fault, list[str]]:
    with TemporaryDirectory() as folder:
        return seed, draw(seed), run(draw(seed), Path(folder))


def check(seeds: Sequence[int]) -> None:
    with ThreadPoolExecutor(2) as pool:
        outcomes = []
        for outcome in pool.map(tried, seeds):
            outcomes.append(outcome)
            if outcome[2]:
                print(f"seed {outcome[0]}, the {len(outcomes)}th: {'; '.join(outcome[2])}", flush=True)
    kinds = Counter(f"{fault.kind}: {fault.what}" for _, fault, _ in outcomes)
    failed = [f"seed {seed}, {fault}: {'; '.join(wrong)}" for seed, fault, wrong in outcomes if wrong]
    print(f"{len(outcomes)} faults of {len(kinds)} kinds, {len(failed)} failures")
    assert not failed, "\n".join(failed)


FIRST = ((0, 2, 4, 5), (7, 8, 12, 13), (17, 18, 21, 23))
"""Seeds of faults that no other test puts into a run."""


@pytest.mark.parametrize(
    "seeds",
    [
        FIRST[0],
        *(pytest.param(seeds, marks=pytest.mark.long) for seeds in FIRST[1:]),
        pytest.param(sorted({*range(24)} - {*sum(FIRST, ())}), marks=pytest.mark.long),
    ],
)
def test_two_dozen_random_faults_do_no_harm(seeds):
    check(seeds)


@pytest.mark.long
@pytest.mark.timeout(4 * 3600)
def test_a_thousand_random_faults_do_no_harm():
    """As many as PALPATE_FAULTS says."""
    check(range(10_000, 10_000 + int(os.environ.get("PALPATE_FAULTS", "1000"))))


def test_each_seed_is_one_fault_and_all_kinds_occur():
    drawn = [draw(seed) for seed in range(10_000, 11_000)]
    assert drawn == [draw(seed) for seed in range(10_000, 11_000)]
    assert len({(f.kind, f.what) for f in drawn}) >= 30
    assert {f.whom for f in drawn if f.kind == "signal"} == {"launcher", "fork server", "one"}
