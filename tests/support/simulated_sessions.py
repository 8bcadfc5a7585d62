"""Sessions of simulated observers that answer by the level, as in a real session, but without computing the stimuli."""

from palpate.studies.psychophysics.analysis import Outcome, outcome
from palpate.studies.psychophysics.file import find, load
from palpate.studies.psychophysics.fit import IntervalEstimate
from palpate.studies.psychophysics.observer import ObserverSettings, SimulatedObserver
from palpate.studies.psychophysics.schedule import schedule
from palpate.studies.psychophysics.session import judge_answer
from palpate.studies.psychophysics.stimuli import Stimuli

HEAD = """
graph: kidney
duration: 1 s
vary: tissue.stiffness
question: Which?
"""
STAIRCASE = f"""{HEAD}
reference: 3e3
response: 2afc
function: weibull
blocks:
  main: {{procedure: staircase, start: [5e3, 4e3], steps: [1.6, 1.3], scale: ratio, trials: 60}}
"""
CONSTANT = f"""{HEAD}
reference: 3e3
response: 2afc
blocks:
  main: {{procedure: constant, levels: {{linspace: [2e3, 4e3, 7]}}, repeats: 20}}
"""


def quest(trials: int, catch: float) -> str:
    """A yes-no experiment by QUEST+."""
    return f"""{HEAD}
reference: {{tissue.stiffness: 1e3}}
response: yes-no
blocks:
  main: {{procedure: quest+, levels: {{linspace: [1.2e3, 4e3, 15]}}, threshold: {{linspace: [300, 2.4e3, 22]}},
          spread: {{geomspace: [100, 1000, 8]}}, catch: {catch}, trials: {trials}}}
"""


LIBERAL = ObserverSettings(threshold=1100.0, spread=300.0, lapse=0.02, guess=0.1)
DESIGNS = {
    "kidney-stiffness": (
        "kidney-stiffness",
        ObserverSettings(threshold=32.0, spread=1.5, lapse=0.01, function="weibull"),
        "jnd",
    ),
    "kidney-stiffness, poor": (
        "kidney-stiffness",
        ObserverSettings(threshold=60.0, spread=2.5, lapse=0.03, function="weibull"),
        "jnd",
    ),
    "nodule-depth": ("nodule-depth", ObserverSettings(threshold=0.010, spread=0.003, lapse=0.01), "threshold"),
    "nodule-depth, poor": ("nodule-depth", ObserverSettings(threshold=0.008, spread=0.0015, lapse=0.03), "threshold"),
    "staircase": (STAIRCASE, ObserverSettings(threshold=600.0, spread=1.6, lapse=0.02, function="weibull"), "jnd"),
    "constant": (CONSTANT, ObserverSettings(threshold=3100.0, spread=400.0, lapse=0.02), "pse"),
    "quest+": (quest(100, 0.25), LIBERAL, "jnd"),
    "quest+ 60": (quest(60, 0.25), LIBERAL, "jnd"),
    "quest+ 30": (quest(30, 0.25), LIBERAL, "jnd"),
    "quest+ 60, no catch trials": (quest(60, 0.0), LIBERAL, "jnd"),
}
"""An experiment (a shipped name, or its text), an observer, and the number with the observer's threshold."""
QUICK = ("kidney-stiffness", "nodule-depth", "constant")


class Sessions:
    """The sessions of one design, each with separate observers and trials."""

    def __init__(self, design: str, write) -> None:
        text, self.settings, self.name = DESIGNS[design]
        file = write("experiment.yaml", text) if text.startswith("\n") else find(text)
        self.experiment, source = load(file)
        self.stimuli = Stimuli(self.experiment, source, file)

    def outcome(self, number: int) -> Outcome:
        observer = SimulatedObserver(self.stimuli, self.settings).seat("01", number, 0)
        order, rows = schedule(self.stimuli, "01", number), []
        trial = next(order)
        while True:
            answer = observer.ask(trial).value
            hit = judge_answer(self.stimuli, trial, answer)
            if not self.experiment.blocks[trial.block].practice:
                level, reference = (
                    "n/a" if one is None else repr(one) for one in (trial.level, self.stimuli.reference)
                )
                rows.append({"level": level, "reference": reference, "hit": str(int(hit))})
            try:
                trial = order.send(hit)
            except StopIteration:
                return outcome(self.experiment, "task", "sub-01", "main", rows, {"LongName": "level", "Units": "1"})

    def estimates(self, sessions: range) -> list[IntervalEstimate]:
        return [self.outcome(number).numbers[self.name] for number in sessions]

    def covered(self, found: list[IntervalEstimate]) -> int:
        """Number of intervals that contain the observer's threshold."""
        return sum(one.low <= self.settings.threshold <= one.high for one in found)
