"""The tables of a run and of `palpate top` in terminals of any width: no number is cut."""

import pytest
from rich.console import Console

from palpate.cli.commands.running.top import Row, _table
from palpate.launch.run.result import Result
from palpate.launch.run.screen import table
from palpate.messages import Health

NAMES = ["device", "finger", "collision", "contact", "friction", "spread", "tissue", "controller", "statics", "log"]
STEP = {"p50": 34.8e-6, "p99": 127e-6, "longest": 27165.5e-6}
COUNTS = {"steps": 1276380, "late": 127638, "lost": 4321, "held": 12, "asleep": 127639}


def run():
    return table(Result(health={name: {"step": STEP, **COUNTS} for name in NAMES}, wall=1276.0))


def top():
    rows = {}
    for name in NAMES:
        rows[name] = Row()
        rows[name].last = Health(since=0, state="ready", tick=1276379, source=name, median=34.8e-6, p99=127e-6,
                                 longest=27165.5e-6, age=80e-6, **COUNTS)  # fmt: skip
        rows[name].rate = 1000.0
    return _table("17-kidney", rows)


def shown(what, width):
    console = Console(width=width, file=None)
    with console.capture() as capture:
        console.print(what)
    return capture.get().splitlines()


@pytest.mark.parametrize("what", [run, top])
@pytest.mark.parametrize("width", [60, 80, 120])
def test_names_and_important_numbers_are_complete_at_any_width(what, width):
    lines = shown(what(), width)
    assert max(map(len, lines)) <= width and "…" not in "".join(lines)
    for name in NAMES:
        cells = next(line.split() for line in lines if line.startswith(name))
        assert {"1000", "127.0", "127638", "4321"} <= set(cells)


@pytest.mark.parametrize("what", [run, top])
def test_dropped_columns_are_named(what):
    narrow, wide = shown(what(), 60), shown(what(), 120)
    assert "a wider terminal also shows" in narrow[-1]
    assert "wider" not in wide[-1] and "127639" in wide[-1]
