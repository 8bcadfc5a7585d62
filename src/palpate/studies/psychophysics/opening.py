"""Decisions before the first trial: participant, session, and whether to resume it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from palpate.launch.load.organ_file import OrganFile
from palpate.launch.load.values.source import YamlSource, read
from palpate.physics.errors import ArgumentError
from palpate.studies.files import refuse
from palpate.studies.psychophysics import observer as simulated
from palpate.studies.psychophysics.file import LABEL, Experiment, find, load
from palpate.studies.psychophysics.schedule import Trial
from palpate.studies.psychophysics.session import resume_schedule, run
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.studies.psychophysics.store import Table, begin, parse, read_content, sessions, table_path

if TYPE_CHECKING:
    from palpate.studies.psychophysics.page import ExperimentPage

Sure = Callable[[str], bool | None]  # Asks the user; None: no terminal
OF_EXPERIMENT: Literal["observer"] = "observer"
"""The `observer:` of the experiment, where another one is a file."""


class Sitting:
    """An open session."""

    def __init__(
        self, stimuli: Stimuli, observer: simulated.SimulatedObserver | None, folder: Path, table: Table,
        participant: str, session: int,
    ) -> None:  # fmt: skip
        self.stimuli, self.observer, self.folder, self.table = stimuli, observer, folder, table
        self.participant, self.session = participant, session
        self.order, self.trial = resume_schedule(stimuli, table.rows, table.path, participant, session)
        self.ended = self.trial is None
        kept = f"{len(table.rows)} whole trials are kept; as it was: {table.recovered}"
        self.notes = [f"{table.path} was broken: {kept}"] if table.recovered is not None else []

    def run(self, presenter: Any) -> None:
        run(self.stimuli, self.table, self.order, self.trial, presenter)
        self.ended = True

    def simulate(self, done: Callable[[Trial], object]) -> None:
        """Run the session with the simulated observer with which it was opened."""
        assert self.observer is not None
        self.run(self.observer.seat(self.participant, self.session, len(self.table.rows), done))

    def page(self) -> ExperimentPage:
        """The page that runs the session with a participant. PageError."""
        from palpate.studies.psychophysics.page import ExperimentPage

        return ExperimentPage(self.stimuli, self.run)


@contextmanager
def open_sitting(
    name: str, out: Path | None, participant: str | None, session: int | None, sets: list[str], resume: bool,
    sure: Sure, simulate: Path | Literal["observer"] | None = None, organ: OrganFile | None = None,
) -> Iterator[Sitting]:  # fmt: skip
    """Open a new session of an experiment, or resume one.

    simulate  a simulated observer: of a file, or `OF_EXPERIMENT`; None: a participant on a page
    organ     mesh file instead of the organ of the scene

    GraphError, ArgumentError: it cannot be opened. Nothing is written before the experiment, its observer and its first
    trial have been checked.
    """
    path = find(name)
    experiment, source = load(path)
    stimuli = Stimuli(experiment, source, path, sets, organ)
    observer = _observer(stimuli, source, simulate)
    folder = out or Path("runs", "experiments", path.stem)
    refuse(folder, "study.json", "the results of a study")
    who, number = _choose_session(stimuli, folder, participant, session, resume, sure)
    resume_schedule(stimuli, [], path, who, number)
    begin(folder, experiment.task, path.read_bytes(), who, _listed_participants(experiment).get(who) or {})
    table = Table(folder, experiment.task, who, number)
    try:
        units = {"Units": stimuli.unit}
        table.describe({"level": {"LongName": stimuli.path, **units}, "reference": units})
        yield Sitting(stimuli, observer, folder, table, who, number)
    finally:
        table.close()


def _observer(
    stimuli: Stimuli, source: YamlSource, simulate: Path | Literal["observer"] | None
) -> simulated.SimulatedObserver | None:
    """The simulated observer of a file or of the experiment; checks that of the experiment in any case, because it is
    stored with the first trial. ArgumentError, GraphError."""
    settings = None if stimuli.experiment.observer is None else simulated.load(source.sub("observer"))
    if isinstance(simulate, Path):
        settings = simulated.load(read(simulate))
    if simulate is None:
        return None
    if settings is None:
        raise ArgumentError("the experiment has no `observer:`; expected one, or --observer FILE")
    return simulated.SimulatedObserver(stimuli, settings)


def _choose_session(
    stimuli: Stimuli, folder: Path, participant: str | None, session: int | None, resume: bool, sure: Sure
) -> tuple[str, int]:
    """Participant and session. ArgumentError: the session exists, and neither `resume` nor the user continues it."""
    experiment = stimuli.experiment
    who = participant or _next_participant(stimuli, folder)
    known = _listed_participants(experiment)
    if not LABEL.fullmatch(who) or (known and who not in known):
        expected = f"one of {', '.join(known)}" if known else "letters and digits"
        raise ArgumentError(f"--participant: found {who!r}, expected {expected}")
    there = sessions(folder, experiment.task, who)
    number = session or (there[-1] if there else 1)
    if number not in there:
        return who, number
    done, over = _state(stimuli, folder, who, number)
    text = f"sub-{who} has done session {number}" if over else f"sub-{who} has done {done} trials of session {number}"
    if not over and (resume or not done or sure(f"{text}. Continue it?")):
        return who, number
    if over and session is None and sure(f"{text}. Begin session {number + 1}?"):
        return who, number + 1
    cures = f"--session {there[-1] + 1} begins another one, --participant LABEL takes another participant"
    raise ArgumentError(f"{text} in {folder}; nothing is overwritten. {'' if over else '--resume continues, '}{cures}.")


def _state(stimuli: Stimuli, folder: Path, who: str, number: int) -> tuple[int, bool]:
    """Number of stored trials of a session, and whether it is complete."""
    file = table_path(folder, stimuli.experiment.task, who, number)
    rows, _ = parse(read_content(file))
    return len(rows), resume_schedule(stimuli, rows, file, who, number)[1] is None


def _listed_participants(experiment: Experiment) -> dict[str, dict[str, Any] | None]:
    """The participants that the experiment lists, with their attributes."""
    given = experiment.participants
    return {f"{n:02d}": None for n in range(1, given + 1)} if isinstance(given, int) else given or {}


def _next_participant(stimuli: Stimuli, folder: Path) -> str:
    """The first participant without a session, or with an incomplete last one. ArgumentError: all are complete."""
    task, known = stimuli.experiment.task, _listed_participants(stimuli.experiment)
    for who in known or (f"{n:02d}" for n in range(1, 10_000)):
        there = sessions(folder, task, who)
        if not there or not _state(stimuli, folder, who, there[-1])[1]:
            return who
    raise ArgumentError(f"all participants have done this experiment in {folder}; choose one to repeat it by "
                        "--participant and --session")  # fmt: skip
