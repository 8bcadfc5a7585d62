"""Sessions of simulated observers that answer by the level, as in a real session, but without computing the stimuli."""

from palpate.studies.psychophysics.analysis import Outcome, outcome
from palpate.studies.psychophysics.file import load
from palpate.studies.psychophysics.observer import ObserverSettings, SimulatedObserver
from palpate.studies.psychophysics.schedule import schedule
from palpate.studies.psychophysics.session import judged
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
QUEST = f"""{HEAD}
reference: {{tissue.stiffness: 1e3}}
response: yes-no
blocks:
  main: {{procedure: quest+, levels: {{linspace: [1.2e3, 4e3, 15]}}, threshold: {{linspace: [300, 2.4e3, 22]}},
          spread: {{geomspace: [100, 1000, 8]}}, catch: 0.25, trials: 100}}
"""
DESIGNS = {
    "staircase": (STAIRCASE, ObserverSettings(threshold=600.0, spread=1.6, lapse=0.02, function="weibull"), "jnd"),
    "constant": (CONSTANT, ObserverSettings(threshold=3100.0, spread=400.0, lapse=0.02), "pse"),
    "quest+": (QUEST, ObserverSettings(threshold=1100.0, spread=300.0, lapse=0.02, guess=0.1), "jnd"),
}
"""An experiment, an observer, and the expected threshold of the observer."""


class Sessions:
    """The sessions of one design, each with separate observers and trials."""

    def __init__(self, design: str, write) -> None:
        text, self.settings, self.name = DESIGNS[design]
        file = write(f"{design.replace('+', '')}.yaml", text)
        self.experiment, source = load(file)
        self.stimuli = Stimuli(self.experiment, source, file)

    def outcome(self, number: int) -> Outcome:
        observer = SimulatedObserver(self.stimuli, self.settings, "01", number, 0)
        order, rows = schedule(self.stimuli, "01", number), []
        trial = next(order)
        while True:
            answer = observer.ask(trial).value
            hit = judged(self.stimuli, trial, answer)
            level = "n/a" if trial.level is None else repr(trial.level)
            rows.append({"level": level, "reference": repr(self.stimuli.reference), "hit": str(int(hit))})
            try:
                trial = order.send(hit)
            except StopIteration:
                return outcome(self.experiment, "task", "sub-01", "main", rows, {"LongName": "level", "Units": "1"})

    def covered(self, sessions: int) -> int:
        """Number of sessions, of this number, whose interval contains the observer's threshold."""
        found = [self.outcome(number).numbers[self.name] for number in range(1, sessions + 1)]
        return sum(one.low <= self.settings.threshold <= one.high for one in found)
