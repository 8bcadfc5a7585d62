"""One session: present each trial, ask for the answer and store it before the next trial."""

import datetime
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from palpate.launch.load.launchfile import SOURCES, LaunchFile
from palpate.physics.errors import ArgumentError, PalpateError
from palpate.studies.psychophysics.file import stored_answer
from palpate.studies.psychophysics.schedule import Schedule, Trial, schedule
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.studies.psychophysics.store import NONE, Row, Table

READY = "Continue when you are ready."


class DisturbedError(PalpateError):
    """An interval failed, for example because the device was unplugged; the trial is repeated."""


@dataclass(frozen=True)
class Answer:
    """The name of an answer or a number, and the response time [s]."""

    value: str
    seconds: float


class Presenter(Protocol):
    """Interface to the page or a simulated observer: shows stimuli and asks for answers."""

    def show(self, trial: Trial | None, title: str, text: str, pause: float = 0.0) -> None:
        """Show a text until the participant continues, for at least `pause` [s]; a title without a text only briefly.
        `trial` None: end of the session."""

    def present(self, trial: Trial, interval: int, launch: LaunchFile) -> None:
        """Run one interval. DisturbedError: it failed."""

    def ask(self, trial: Trial) -> Answer:
        """The answer to the experiment's question."""


def resume_schedule(
    stimuli: Stimuli, rows: list[Row], file: Path, participant: str, session: int
) -> tuple[Schedule, Trial | None]:
    """The schedule of a session after the stored trials of a file, and the next trial; None: the session is complete.

    ArgumentError: the stored trials are not of this experiment, or a procedure is invalid. GraphError.
    """
    order = schedule(stimuli, participant, session)
    trial: Trial | None = next(order)
    for row in rows:
        if trial is None or (row["block"], row["level"], row["interval"]) != (
            trial.block, _text(trial.level), str(trial.interval)
        ):  # fmt: skip
            raise ArgumentError(
                f"{file}: trial {row['trial']} differs from that of the experiment: its seed, its blocks or the values "
                "of its graph have changed. Use another folder (--out)."
            )
        trial = _next(order, row)
    return order, trial


def run(stimuli: Stimuli, table: Table, order: Schedule, trial: Trial | None, presenter: Presenter) -> None:
    """Run all trials from this one on. OSError: a row cannot be stored."""
    experiment, first = stimuli.experiment, True
    while trial is not None:
        if first:
            presenter.show(trial, "Welcome" if trial.number == 1 else "Welcome back", experiment.instructions or READY)
        _begin(stimuli, trial, presenter, first)
        row, first = _trial(stimuli, table, trial, presenter), False
        if experiment.blocks[trial.block].feedback and row["hit"] != NONE:
            presenter.show(trial, "Right" if row["hit"] == "1" else "Wrong", "")
        trial = _next(order, row)
    presenter.show(None, "The end", experiment.closing)


def _next(order: Schedule, row: Row) -> Trial | None:
    try:
        return order.send(row["hit"] == "1")
    except StopIteration:
        return None


def _begin(stimuli: Stimuli, trial: Trial, presenter: Presenter, first: bool) -> None:
    """Show the instructions of the block, or a pause, before a trial."""
    block = stimuli.experiment.blocks[trial.block]
    if block.instructions and (trial.in_block == 1 or first):
        presenter.show(trial, trial.block, block.instructions)
    elif block.pause_every and trial.in_block > 1 and (trial.in_block - 1) % block.pause_every == 0 and not first:
        presenter.show(trial, "Pause", READY, block.pause)


def _trial(stimuli: Stimuli, table: Table, trial: Trial, presenter: Presenter) -> Row:
    experiment = stimuli.experiment
    while True:
        repeat, files = table.count_attempts(trial.number), list[Path]()
        try:
            for interval, level in enumerate(trial.levels(experiment.intervals), 1):
                files.append(table.recording(trial.number, interval, repeat))
                launch = stimuli.run(trial.block, level).but(
                    record=files[-1],
                    duration=experiment.duration,
                    only=SOURCES if experiment.record == SOURCES else None,
                )
                presenter.present(trial, interval, launch)
            answer = presenter.ask(trial)
            break
        except DisturbedError as error:
            presenter.show(trial, f"Trial {trial.number} is repeated", str(error))
    response = stored_answer(experiment.response, answer.value)
    hit = judge_answer(stimuli, trial, response)
    names = [str(file.relative_to(table.folder)) for file in files]
    table.add(
        {
            "trial": trial.number, "block": trial.block, "track": trial.track, "level": _text(trial.level),
            "reference": _text(stimuli.reference), "interval": trial.interval, "response": response,
            "hit": None if hit is None else int(hit), "response_time": f"{answer.seconds:.3f}", "repeats": repeat,
            "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds"),
            **dict(zip(("recording_1", "recording_2"), names, strict=False)),
        }
    )  # fmt: skip
    return table.rows[-1]


def judge_answer(stimuli: Stimuli, trial: Trial, answer: str) -> bool | None:
    """Whether an answer is right or yes; None for a number."""
    if stimuli.experiment.response == "magnitude":
        return None
    if stimuli.experiment.response == "yes-no":
        return answer == "yes"
    chosen = (answer == "first") == (trial.interval == 1)
    if stimuli.reference is None or trial.level is None:
        return chosen
    return chosen == ((trial.level > stimuli.reference) == (stimuli.experiment.asks == "greater"))


def _text(level: float | None) -> str:
    return NONE if level is None else repr(float(level))
