"""`palpate bench`: what the models and the loop can do, on this machine and with your device."""

from __future__ import annotations

import typer

from palpate.launch.commands.bench_accuracy import accuracy
from palpate.launch.commands.bench_stability import stability

bench = typer.Typer(no_args_is_help=True, help="What the models and the loop can do, and what they cost.")


@bench.callback()
def _bench() -> None:
    """What the models and the loop can do, and what they cost."""


bench.command()(accuracy)
bench.command()(stability)
