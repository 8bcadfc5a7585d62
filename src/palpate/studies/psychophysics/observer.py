"""A simulated observer, the `observer:` of an experiment or a file: it measures the stimuli and answers.

feels: peak contact.force             # measured quantity, as in `keep` of a study; a ratio: two of them with " / "
noise: 0.08                           # standard deviation of the noise, independent for each interval
lapse: 0.02                           # share of answers, at either end, that do not depend on the stimulus

To get known thresholds, an observer can answer by the level itself:

threshold: 400                        # a, in the unit of the level, or of the distance from the reference
spread: 150                           # b
function: normal
"""

import os
import shutil
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from palpate.engine.faults import Faults
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.placement import FUSED
from palpate.launch.load.values.lines import fill, quantity
from palpate.launch.load.values.source import YamlSource
from palpate.launch.run.execute import execute
from palpate.physics.errors import ArgumentError, RunError
from palpate.studies.psychophysics.functions import proportion
from palpate.studies.psychophysics.schedule import Trial
from palpate.studies.psychophysics.session import Answer
from palpate.studies.psychophysics.stimuli import Stimuli
from palpate.studies.sweeps import lane
from palpate.studies.sweeps.keep import Kept, kept_results
from palpate.studies.sweeps.point import Point
from palpate.views.run import Run

_Number = Annotated[float, msgspec.Meta(description="a number")]
_Above = Annotated[float, msgspec.Meta(gt=0, description="a number above 0")]
_Share = Annotated[float, msgspec.Meta(ge=0, le=0.5, description="a number from 0 to 0.5")]


class ObserverSettings(msgspec.Struct, kw_only=True):
    """Content of a file. criterion: the answer is yes above it; gain, exponent: of a magnitude; duration: replaces the
    duration of the experiment."""

    feels: Annotated[str, msgspec.Meta(description="a text such as peak contact.force")] = ""
    noise: Annotated[float, msgspec.Meta(ge=0, description="a number from 0")] = 0.0
    lapse: _Share = 0.0
    criterion: _Number = 0.0
    gain: _Above = 10.0
    exponent: _Number = 1.0
    threshold: _Number | None = None
    spread: _Above | None = None
    guess: _Share = 0.0
    function: Literal["logistic", "normal", "weibull"] = "normal"
    seed: Annotated[int, msgspec.Meta(ge=0, description="a whole number from 0")] = 0
    duration: Annotated[float, quantity("s", 1e-3, 3600)] | None = None


def load(source: YamlSource) -> ObserverSettings:
    """The observer that a file, or the `observer:` of an experiment, describes. GraphError: lists its faults."""
    faults = Faults()
    if not isinstance(source.data, dict):
        faults.add("observer: expected a mapping with feels and noise, or threshold and spread", "", source.place())
        faults.done()
    given = fill(ObserverSettings, source, faults, "observer")
    if given is not None and bool(given.feels) == (given.threshold is not None and given.spread is not None):
        faults.add("observer: expected either `feels`, or `threshold` and `spread`", "", source.place())
    faults.done()
    assert given is not None
    return given


def _ignore(trial: Trial) -> None:
    pass


class SimulatedObserver:
    """Presenter without a participant; each stimulus is computed once.

    ArgumentError: the graph needs a device, or lacks the quantity that the observer measures, or the observer has no
    answer of the experiment's kind. Only `seat` depends on the session, so all faults are found before it is opened.
    """

    def __init__(self, stimuli: Stimuli, settings: ObserverSettings) -> None:
        self.stimuli, self.settings = stimuli, settings
        base = stimuli.launch.load()
        devices = [name for name, spec in base.nodes.items() if spec.cls.hardware]
        if devices or stimuli.launch.clock == "real":
            what = f"{devices[0]!r} drives a device" if devices else "clock: real"
            raise ArgumentError(f"{base.path.stem}: a simulated observer needs simulated time, but {what}")
        self._feels: tuple[Kept, ...] = kept_results(settings.feels.split(" / "), base) if settings.feels else ()
        if any(one.how == "curve" for one in self._feels):
            raise ArgumentError(f"feels: found {settings.feels!r}, expected a number, such as peak contact.force")
        if stimuli.experiment.response == "magnitude" and not self._feels:
            raise ArgumentError("an observer of magnitudes needs `feels`, not a threshold")
        self._prepare = lane.preparation(self._launch, self._feels, {})
        self._random = np.random.default_rng(settings.seed)
        self._done: Callable[[Trial], object] = _ignore
        self._known: dict[str, tuple[Path, float]] = {}
        self._felt: list[float] = []

    def seat(
        self, participant: str, session: int, begun: int, done: Callable[[Trial], object] = _ignore
    ) -> "SimulatedObserver":
        """Begin a session after `begun` stored trials; `done` is called after each trial. Returns this observer."""
        # A separate random stream: the schedule draws from the same participant and session.
        entropy = [zlib.crc32(b"observer"), self.settings.seed, zlib.crc32(participant.encode()), session, begun]
        self._random, self._done = np.random.default_rng(entropy), done
        return self

    def show(self, trial: Trial | None, title: str, text: str, pause: float = 0.0) -> None:
        pass

    def present(self, trial: Trial, interval: int, launch: LaunchFile) -> None:
        if interval == 1:
            self._felt = []
        level = trial.levels(self.stimuli.experiment.intervals)[interval - 1]
        key = f"{trial.block} {level}"
        assert launch.record is not None
        if key not in self._known:
            outcome = execute(self._simulated(launch))
            outcome.raise_signal()
            if not outcome.ok:
                raise RunError("; ".join(map(str, outcome.result.deaths)) or f"{launch.record} is not whole")
            self._known[key] = launch.record, self._feel({"block": trial.block, "level": level}, launch.record)
        else:
            _same_file(self._known[key][0], launch.record)
        self._felt.append(self._known[key][1])

    def _simulated(self, launch: LaunchFile) -> LaunchFile:
        duration = self.settings.duration or self.stimuli.experiment.duration
        return launch.but(place=FUSED, clock="simulated", duration=duration)

    def _launch(self, stimulus: Mapping[str, Any]) -> LaunchFile:
        return self._simulated(self.stimuli.run(**stimulus))

    def _feel(self, stimulus: dict[str, Any], file: Path) -> float:
        """The measured number of a stimulus: of a lane, as a point of a study. A recording of sources would have to be
        computed again to read it, so it is read only if the graph cannot run as a lane, or the lane fails."""
        if not self._feels:
            return 0.0
        point = Point(0, "", stimulus, {})
        found = [done for _, done in lane.compute(self._launch, self._prepare, self._feels, [point], lambda: None)]
        run = Run(file) if not found or found[0].error else None
        first, *others = (found[0].numbers[one.text] if run is None else one.number(run) for one in self._feels)
        for other in others:
            first /= other
        return first

    def ask(self, trial: Trial) -> Answer:
        self._done(trial)
        return Answer(self._by_level(trial) if self.settings.threshold is not None else self._by_feel(), 0.0)

    def _by_feel(self) -> str:
        kind, given, random = self.stimuli.experiment.response, self.settings, self._random
        felt = [value + given.noise * random.standard_normal() for value in self._felt]
        astray = random.random() < 2.0 * given.lapse
        if kind == "magnitude":
            return f"{given.gain * max(felt[0], 1e-9) ** given.exponent:.4g}"
        above = felt[-1] > (given.criterion if kind == "yes-no" else felt[0])
        if self.stimuli.experiment.asks == "less":
            above = not above
        if astray:
            above = random.random() < 0.5
        return ("yes" if above else "no") if kind == "yes-no" else ("second" if above else "first")

    def _by_level(self, trial: Trial) -> str:
        kind, given, stimuli = self.stimuli.experiment.response, self.settings, self.stimuli
        assert given.threshold is not None and given.spread is not None
        if stimuli.two_sided(trial.block) and trial.level is not None:
            chance = proportion(given.function, trial.level, given.threshold, given.spread, given.lapse, given.lapse)
            greater = bool(self._random.random() < chance)
            chosen = greater == (stimuli.experiment.asks == "greater")
            return "first" if (trial.interval == 1) == chosen else "second"
        guess = 0.5 if kind == "2afc" else given.guess
        a = given.threshold * (stimuli.sign if stimuli.reference is None else 1)
        x = -np.inf if trial.level is None else stimuli.x(trial.level)
        hit = self._random.random() < proportion(given.function, x, a, given.spread, guess, given.lapse)
        if kind == "yes-no":
            return "yes" if hit else "no"
        greater = trial.level is None or stimuli.reference is None or trial.level > stimuli.reference
        right = greater == (stimuli.experiment.asks == "greater") if stimuli.reference is not None else True
        return "first" if (trial.interval == 1) == (hit == right) else "second"


def _same_file(there: Path, new: Path) -> None:
    """Create a hard link to a file, or a copy if the file system has no hard links."""
    try:
        os.link(there, new)
    except FileExistsError:
        raise
    except OSError:
        shutil.copyfile(there, new)
