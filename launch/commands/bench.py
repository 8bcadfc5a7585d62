"""`palpate bench`: accuracy and speed of the models, and stability of the loop with your device."""

from __future__ import annotations

import typer

from palpate.launch.commands.bench_accuracy import accuracy
from palpate.launch.commands.bench_stability import stability

bench = typer.Typer(no_args_is_help=True, help="Benchmark the models and the haptic loop.")


@bench.callback()
def _bench() -> None:
    """Benchmark the models and the haptic loop."""


bench.command()(accuracy)
bench.command()(stability)
