"""Tables of a motion and a force as recordings that a fit takes: time, x, y, z or indentation, and force."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from palpate.engine.graph import Graph
from palpate.launch.load.arguments import describe_run
from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import Contact
from palpate.models.fit.sessions import SessionError
from palpate.models.fit.tissue.table import NAMES, columns_of, numbers_of
from palpate.nodes.device.motion import PLACE, read_motion
from palpate.physics.errors import ArgumentError
from palpate.physics.scratch import ScratchFolder
from palpate.physics.table_file import read_table
from palpate.studies.inverse.measured import ROWS, Measured, driven, fingers
from palpate.units.header import split_unit

ENDINGS = (".csv", ".txt", ".tsv", ".xlsx")
REACH, SPEED = 0.06, 0.02  # [m], [m/s] of the motion that finds where a press begins


def read_table_run(
    path: Path, to: Sequence[str], graph: str | None, scene: str | None, sets: Sequence[str], until: float | None
) -> Measured:
    """A table with the columns time, force, and x, y, z of the finger's bone edge in the world frame, or indentation.

    An indentation is a press straight down from the start of the scene's hand, 0 where contact begins; a fit also
    searches this zero. The force is the field of `to`, which is one.

    SessionError, SettingError: the table cannot be read. ArgumentError: no graph, or several fields.
    """
    if graph is None:
        raise ArgumentError(f"{path}: a table has no graph; expected --graph, such as --graph kidney")
    if len(to) != 1:
        raise ArgumentError(f"{path}: a table has one force; expected one --to, found {', '.join(to)}")
    base = describe_run(graph, scene=scene, duration=None, sets=sets, nodes={})
    loaded, folder = base.load(), ScratchFolder("fit-run")
    moved = fingers(loaded)
    if len(moved) > 1:
        raise ArgumentError(f"{path}: {graph} has several fingers, {', '.join(moved)}; expected a graph with one")
    time, place, force, loose = _columns(path, base, loaded, moved[0], to[0], folder)
    file = Path(folder.name) / "motion.csv"
    np.savetxt(
        file, np.column_stack([time - time[0], place]), delimiter=",", header="t,x,y,z", comments="", fmt="%.12g"
    )
    length = float(time[-1] - time[0]) if until is None else min(until, float(time[-1] - time[0]))
    ticks = max(2, int(length * loaded.rate) + 1)
    rows = np.arange(0, ticks, -(-ticks // ROWS))
    values = [np.interp(rows / loaded.rate, time - time[0], force)[:, None]]
    grid = np.arange(ticks) / loaded.rate
    motion = np.column_stack([np.interp(grid, time - time[0], column) for column in place.T])
    run = driven(base, {moved[0]: (file, moved[0])}, to).but(duration=ticks / loaded.rate)
    return Measured(
        path.name, run, list(to), values, rows, ticks, loaded.rate, {moved[0]: motion}, base, None, folder, loose
    )


def _columns(
    path: Path, base: LaunchFile, graph: Graph, finger: str, field: str, folder: ScratchFolder
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Time [s] (n), place of the finger [m] (n, 3), force [N] (n), and what of the place is uncertain."""

    def score(cells: Sequence[str]) -> int:
        known = {split_unit(cell)[0].lower() for cell in cells}
        return sum(bool(known.intersection(names)) for names in NAMES.values()) + (set(PLACE) <= known)

    try:
        table = read_table(path, score, 3, "")
    except (OSError, ValueError) as error:
        raise SessionError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    placed = set(PLACE) <= {name.lower() for name in table.names}
    found = columns_of(path, table, {"indentation": ""} if placed else {})
    if "time" not in found:
        raise SessionError(f"{path}: no column of time; a fit of a run needs the time of each row")
    values, _, _ = numbers_of(path, table, found, {}, {})
    named = dict(zip(found, values.T, strict=True))
    time, force = named["time"], named["force"]
    if np.any(np.diff(time) <= 0.0):
        row = int(np.argmax(np.diff(time) <= 0.0)) + 2
        raise SessionError(f"{path}: the time of row {row} of the numbers does not increase")
    if placed:
        motion = read_motion(str(path))
        return time, motion.values, force, ()
    begin = np.array(graph.scene.get("hand", {}).get("begin", (0.0, 0.0, 0.0)), float)
    touch = _touch(base, finger, begin, field, folder)
    place = np.tile(touch, (len(time), 1))
    place[:, 2] -= named["indentation"]
    return time, place, force, (f"{finger}.offset[2]",)


def _touch(base: LaunchFile, finger: str, begin: np.ndarray, field: str, folder: ScratchFolder) -> np.ndarray:
    """The place [m] (3) straight below `begin` where contact begins. ArgumentError: no contact within `REACH`."""
    from palpate.launch.run.lane_runner import LaneKeep, LaneRunner
    from palpate.launch.run.lanes import columns_of as arrays_of
    from palpate.launch.run.lanes import prepare
    from palpate.launch.run.work.compiling import compiling

    file = Path(folder.name) / "approach.csv"
    ends = np.array([[0.0, *begin], [REACH / SPEED, begin[0], begin[1], begin[2] - REACH]])
    np.savetxt(file, ends, delimiter=",", header="t,x,y,z", comments="", fmt="%.12g")
    graph = base.load()
    contact = next((s for s, kind in graph.streams.items() if issubclass(kind, Contact)), field.rpartition(".")[0])
    run, keep = driven(base, {finger: (file, finger)}, [f"{contact}.force"]), [(contact, "force")]
    one, ticks = prepare(run, keep), round(REACH / SPEED * graph.rate)
    columns, runner = arrays_of(one, keep, 1, ticks), LaneRunner(LaneKeep(keep, ticks))
    try:
        with compiling(lambda number: None):
            runner.run(lambda row: one, columns)
    finally:
        runner.close()
    touched = np.flatnonzero(columns[0][0] > 0.0)
    if not len(touched):
        raise ArgumentError(f"a press straight down from scene.hand.begin touches nothing within {1e3 * REACH:g} mm; "
                            "expected a column x, y, z, or another --set scene.hand.begin")  # fmt: skip
    at, force = int(touched[0]), columns[0][0]
    rise = float(force[at + 1] - force[at]) if at + 1 < ticks else 0.0
    before = min(float(force[at]) / rise, 1.0) if rise > 0.0 else 0.0  # [1] of a tick: the force begins linearly
    return begin - np.array([0.0, 0.0, SPEED / graph.rate * (at - before)])
