"""Opens what a fit of runs takes: a recording, or a table of motion and force."""

from collections.abc import Sequence
from pathlib import Path

from palpate.studies.inverse.measured import Measured, read_recording
from palpate.studies.inverse.table import ENDINGS, read_table_run


def read_run(
    path: Path, fields: Sequence[str], graph: str | None, scene: str | None, sets: Sequence[str], until: float | None
) -> Measured:
    """A recording, or a table by its ending; see `read_recording` and `read_table_run`."""
    read = read_table_run if path.suffix.lower() in ENDINGS else read_recording
    return read(path, fields, graph, scene, sets, until)
