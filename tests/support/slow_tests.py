"""Leaves the slow tests out of runs of the whole suite: those that cost more than `LIMIT` of processor time.

`tests/slow.txt` lists them, one test or one case of a test per line. A run of named files or tests runs all tests of
these files; so do `tests/mutation.py`, which names the files, and `./check.sh --all`. Of folders and of the whole suite
the listed ones are left out, also where a run names a file as well; with `--quick`, as by `./check.sh --fast`, of
named files as well.

    ./check.sh --all --measure [FILE]...     writes the list again, for all files or for these
    ./check.sh --measure                     adds what has become slow, without a run of those that are listed

Measured is what tests cost in a fresh copy with compiled kernels: stored surfaces and bases are computed again.

In each file one of the listed tests stays, the cheapest, so that no file that ends in a whole run is without one.
"""

import os
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import pytest

LIST = Path(__file__).parents[1] / "slow.txt"
LIMIT = 0.3
"""Processor time of a test and the processes below it, with its share of the fixtures that others use as well [s]."""
STAYS = 2.0
"""The cheapest slow test of a file stays below this processor time [s]."""
ALWAYS = ("tests/test_", "tests/compiler/test_reproducible.py::test_python_code_on_the_way")
"""Begins of the names of checks of the whole source, which any change may break: they always run."""
HEADER = f"""\
# Tests that cost more than {LIMIT:g} s of processor time. `./check.sh` leaves them out, `./check.sh --all` and a run of
# a named file do not. Written by `./check.sh --all --measure` (tests/support/slow_tests.py).
"""
COST = "processor time"


class SlowTests:
    """The plugin: which tests run, and what each costs."""

    def __init__(self, config: pytest.Config) -> None:
        self.measures = config.getoption("measure")
        self.costs: dict[str, float] = {}
        self.fixtures: Counter[str] = Counter()
        self.uses: dict[str, list[str]] = {}
        self.within = 0.0
        """Processor time of the shared fixtures that this test, or this fixture, has set up [s]."""
        self.made: Counter[str] = Counter()
        if self.measures and not hasattr(config, "workerinput"):
            self.empty = tempfile.TemporaryDirectory(prefix="palpate-measure-")
            os.environ["XDG_CACHE_HOME"] = self.empty.name  # kernels have a separate setting (tests/conftest.py)

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        if config.getoption("all_tests"):
            return
        listed, named = read(), set[Path]() if config.getoption("quick") else _named_files(config)
        left_out = {
            item
            for item in items
            if {item.nodeid, item.nodeid.split("[")[0]} & listed
            and item.path not in named
            and not item.get_closest_marker("long")
        }
        if left_out:
            config.hook.pytest_deselected(items=list(left_out))
            items[:] = [item for item in items if item not in left_out]

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Iterator[Any]:
        if fixturedef.scope == "function":
            return (yield)
        outer, self.within = self.within, 0.0
        begun = processor_time()
        try:
            return (yield)
        finally:
            cost = processor_time() - begun
            self.made[_name(fixturedef)] += cost - self.within
            self.within = outer + cost

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[Any]:
        self.within = 0.0
        self.made.clear()
        self.begun = processor_time()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Function, call: pytest.CallInfo[None]) -> Iterator[Any]:
        report = yield
        if self.measures and call.when == "teardown":
            used = [_name(d[-1]) for d in item._fixtureinfo.name2fixturedefs.values() if d[-1].scope != "function"]
            cost = processor_time() - self.begun - self.within
            report.user_properties.append((COST, {"alone": cost, "made": dict(self.made), "uses": used}))
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        for name, value in report.user_properties:
            if name == COST:
                self.costs[report.nodeid] = value["alone"]
                self.fixtures.update(value["made"])
                self.uses[report.nodeid] = value["uses"]

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.measures and not hasattr(session.config, "workerinput"):
            known = self.costs.keys() | {test.split("[")[0] for test in self.costs}
            # a name of a file that has run as a whole, and has not run itself, is that of no test
            everything, named = session.config.getoption("all_tests"), _named_files(session.config)
            files = {
                file for file in {test.split("::")[0] for test in self.costs} if everything or _file(file) in named
            }
            known |= {test for test in read() if test.split("::")[0] in files}
            others = {test for test in read() if test not in known and _file(test.split("::")[0]).exists()}
            listed = others.union(choose(self.costs, self.fixtures, self.uses))
            LIST.write_text(HEADER + "".join(f"{name}\n" for name in sorted(listed)), "utf-8")


def _named_files(config: pytest.Config) -> set[Path]:
    """The files that a run names; of its folders it leaves the listed tests out."""
    names = (name.split("::")[0] for name in config.args)
    return {(config.invocation_params.dir / name).resolve() for name in names if name.endswith(".py")}


def _file(name: str) -> Path:
    return LIST.parents[1] / name


def _name(fixturedef: Any) -> str:
    return f"{fixturedef.baseid}::{fixturedef.argname}"


def processor_time() -> float:
    """Of this process and of those below it that have ended [s]."""
    return sum(os.times()[:4])


def read() -> set[str]:
    """The listed tests."""
    lines = LIST.read_text(encoding="utf-8").splitlines() if LIST.exists() else []
    return {line for line in lines if line and not line.startswith("#")}


def choose(costs: Mapping[str, float], fixtures: Mapping[str, float], uses: Mapping[str, list[str]]) -> list[str]:
    """Of these tests those to list: a test whose cases are all slow by its name, others case by case.

    A fixture is set up in a run if one of its tests is in it: those that stay share its cost.

    costs     processor time by test without shared fixtures [s]
    fixtures  processor time by shared fixture [s]
    uses      shared fixtures by test
    """
    cases, slow, stays = defaultdict(set), set[str](), dict(costs)
    for test in costs:
        cases[test.split("[")[0]].add(test)
    while more := _slow({test: cost for test, cost in _with_shares(stays, fixtures, uses)}):
        slow |= more
        stays = {test: cost for test, cost in stays.items() if test not in more}
    return list({name if cases[name] <= slow else test for test in slow for name in [test.split("[")[0]]})


def _with_shares(
    costs: Mapping[str, float], fixtures: Mapping[str, float], uses: Mapping[str, list[str]]
) -> Iterator[tuple[str, float]]:
    """Each test with its cost and its share of its fixtures [s]."""
    users = Counter(chain.from_iterable(uses.get(test, ()) for test in costs))
    for test, cost in costs.items():
        yield test, cost + sum(fixtures[name] / users[name] for name in uses.get(test, ()))


def _slow(costs: Mapping[str, float]) -> set[str]:
    """The slow tests of each file, without the cheapest of them if it may stay."""
    files = defaultdict(list)
    for test, cost in costs.items():
        if cost > LIMIT and not test.startswith(ALWAYS):
            files[test.split("::")[0]].append((cost, test))
    return {test for found in files.values() for cost, test in found if (cost, test) != min(found) or cost > STAYS}
