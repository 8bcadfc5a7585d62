"""Experiments as YAML files.

graph: kidney                       # or a launch file or graph; `scene` and `set` as there
vary: tissue.stiffness              # the setting that gets the level of a stimulus
reference: 3e3                      # the other stimulus of a pair
response: 2afc
question: Which kidney was stiffer?
blocks:
  main: {procedure: staircase, start: 4.5e3, steps: [1.5, 1.25], scale: ratio, rule: 2-down-1-up, reversals: 8}
"""

import math
import re
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from palpate.engine.faults import Faults, choices
from palpate.launch.load.files import GRAPHS
from palpate.launch.load.values.lines import fill, quantity
from palpate.launch.load.values.source import YamlSource, read
from palpate.physics.errors import ArgumentError
from palpate.studies.files import Text, Whole, fill_struct, locate_file
from palpate.studies.psychophysics.cells import misfit

EXPERIMENTS = GRAPHS / "experiments"
ANSWERS: dict[str, dict[str, str]] = {
    "2afc": {"first": "1", "second": "2"},
    "yes-no": {"yes": "y", "no": "n"},
    "magnitude": {},
}
"""Possible answers of each kind of response, with their keys."""
LABEL = re.compile(r"[A-Za-z0-9]+")  # A label of BIDS
_Values = Annotated[dict[str, Any], msgspec.Meta(description="a mapping such as {tissue.damping: 4}")]
_Count = Annotated[int, msgspec.Meta(ge=1, le=100_000, description="a whole number from 1")]
_Share = Annotated[float, msgspec.Meta(ge=0, le=0.9, description="a number from 0 to 0.9")]
_Grid = Annotated[
    list[Any] | dict[str, Any], msgspec.Meta(description="a list of values or {linspace: [low, high, number]}")
]
_Quantity = Annotated[float | str, msgspec.Meta(description="a number, or one with its unit")]


class TrialBlock(msgspec.Struct, kw_only=True):
    """Keys of all blocks. `set` applies to this block only; `catch` is the share of trials without signal; blocks of
    `practice` are not analysed."""

    procedure: Text
    instructions: Text = ""
    set: _Values = {}
    pause_every: Whole = 0
    pause: Annotated[float, quantity("s", 0, 3600)] = 0.0
    feedback: bool = False
    practice: bool = False
    catch: _Share = 0.0


class ConstantBlock(TrialBlock):
    """Constant stimuli: each level is repeated, in random order."""

    levels: _Grid
    repeats: _Count = 10


class StaircaseBlock(TrialBlock):
    """An up-down staircase, or several interleaved ones, one for each start."""

    start: _Quantity | list[float | str]
    steps: Annotated[list[float | str] | float | str, msgspec.Meta(description="a number, or a list of numbers")]
    scale: Literal["linear", "ratio"] = "linear"
    rule: Text = "2-down-1-up"
    reversals: Whole = 0
    trials: Whole = 0
    least: _Quantity | None = None
    most: _Quantity | None = None


class QuestBlock(TrialBlock):
    """QUEST+ over the levels, with grids of threshold, spread and lapse rate."""

    levels: _Grid
    threshold: _Grid
    spread: _Grid
    lapse: list[_Share] = msgspec.field(default_factory=lambda: [0.0, 0.02, 0.05])
    function: Literal["logistic", "normal", "weibull"] = "normal"
    trials: _Count = 40


PROCEDURES: dict[str, type[TrialBlock]] = {"constant": ConstantBlock, "staircase": StaircaseBlock, "quest+": QuestBlock}


class Experiment(msgspec.Struct, kw_only=True):
    """Content of a file; `load` fills in `task` and converts `blocks`."""

    graph: Text
    vary: Text
    response: Literal["2afc", "yes-no", "magnitude"]
    question: Text
    duration: Annotated[float, quantity("s", 0.05, 3600)]
    blocks: Annotated[dict[str, Any], msgspec.Meta(description="a mapping of names to blocks")]
    task: Text = ""
    scene: Text | dict[str, Any] | None = None
    set: _Values = {}
    reference: _Quantity | dict[str, Any] | None = None
    asks: Literal["greater", "less"] = "greater"
    harder: Literal["lower", "higher"] = "lower"
    function: Literal["logistic", "normal", "weibull"] = "normal"
    answers: Annotated[dict[str, _Quantity], msgspec.Meta(description="a mapping of answers to keys")] = {}
    end_key: Text | None = None
    gap: Annotated[float, quantity("s", 0, 60)] = 0.5
    instructions: Text = ""
    closing: Text = "Thank you."
    participants: _Count | dict[str, dict[str, Any] | None] | None = None
    order: Literal["given", "random"] = "given"
    seed: Whole = 0
    show: list[Literal["deformation", "force"]] = msgspec.field(default_factory=lambda: ["deformation", "force"])
    record: Literal["sources", "all"] = "sources"
    observer: _Values | None = None

    @property
    def keys(self) -> dict[str, str]:
        return ANSWERS[self.response] | {name: str(key) for name, key in self.answers.items()}

    @property
    def intervals(self) -> int:
        return 2 if self.response == "2afc" else 1


def find(name: str) -> Path:
    """The file of a shipped experiment, or at a path. GraphError: it does not exist."""
    return locate_file(name, EXPERIMENTS, "experiment")


def load(path: Path) -> tuple[Experiment, YamlSource]:
    """The experiment of a file, and the positions of its entries. GraphError: lists all faults."""
    source = read(path)
    given = fill_struct(Experiment, source, "graph, vary, response, question, duration and blocks")
    faults = Faults()
    given.task = given.task or re.sub(r"[^A-Za-z0-9]", "", path.stem)
    if not LABEL.fullmatch(given.task):
        faults.add(f"task: found {given.task!r}, expected letters and digits", "", source.place("task"))
    if not given.blocks:
        faults.add("blocks: found none, expected at least one", "", source.place("blocks"))
    given.blocks = {str(name): _block(str(name), source.sub("blocks", name), faults) for name in given.blocks}
    _participants(given, source, faults)
    _answers(given, source, faults)
    _fits(given, source, faults)
    faults.done()
    return given, source


def stored_answer(response: str, text: str) -> str:
    """An answer in the form in which the table stores it and reads it back.

    ArgumentError: it is none of the answers of this kind of response; a magnitude is a finite number above 0.
    """
    if ANSWERS[response]:
        if text in ANSWERS[response]:
            return text
        raise ArgumentError(f"found {text!r}, expected one of {', '.join(ANSWERS[response])}")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if 0.0 < number < math.inf:
        return repr(number).removesuffix(".0")
    raise ArgumentError(f"found {text!r}, expected a number above 0")


def _participants(given: Experiment, source: YamlSource, faults: Faults) -> None:
    """Check labels and attributes of the participants, which are the cells of a table."""
    for name, about in given.participants.items() if isinstance(given.participants, dict) else ():
        place = source.place("participants", name)
        if not LABEL.fullmatch(name):
            faults.add(f"participants: found {name!r}, expected letters and digits", "", place)
        for text in [str(part) for pair in (about or {}).items() for part in pair]:
            if why := misfit(text) or ("it is the column of the labels" if text == "participant_id" else ""):
                faults.add(f"participants: found {text!r}, expected a text for a table: {why}", "", place)


def _block(name: str, source: YamlSource, faults: Faults) -> TrialBlock | None:
    data, within = source.data, f"block {name!r}"
    if why := misfit(name):
        faults.add(f"{within}: a name is stored in a table: {why}", "", source.place())
    word = data.get("procedure") if isinstance(data, dict) else None
    if not isinstance(word, str) or word not in PROCEDURES:
        faults.add(f"{within}, procedure: found {word!r}", choices("Procedures", str(word), PROCEDURES), source.place())
        return None
    block = fill(PROCEDURES[word], source, faults, within)
    if isinstance(block, StaircaseBlock) and not (block.reversals or block.trials):
        faults.add(f"{within}: it would never end", "Say `reversals: 8`, `trials: 60`, or both.", source.place())
    return block


def _answers(given: Experiment, source: YamlSource, faults: Faults) -> None:
    place = source.place("answers")
    for name in given.answers:
        if name not in ANSWERS[given.response]:
            cure = choices("Answers", name, ANSWERS[given.response])
            faults.add(f"answers: {given.response} has no answer {name!r}", cure, place)
    keys = [key.lower() for key in given.keys.values()]
    twice = {key for key in keys if keys.count(key) > 1}
    if twice:
        names = [name for name, key in given.keys.items() if key.lower() in twice]
        faults.add(f"answers: the key {min(twice)!r} means {' and '.join(names)}", "Give each answer one key.", place)
    if given.end_key is not None and given.end_key.lower() in keys:
        faults.add(f"end_key: {given.end_key!r} is the key of an answer, too", "Take another, such as Enter.",
                   source.place("end_key"))  # fmt: skip


def _fits(given: Experiment, source: YamlSource, faults: Faults) -> None:
    """Check that response, reference and procedures fit together."""
    if given.response == "2afc" and given.reference is None:
        faults.add("reference: missing; 2afc compares two stimuli", "Say what the other one is: `reference: 257`, or "
                   "`reference: {nodule.nodule_ratio: 1}`.", source.place("response"))  # fmt: skip
    for name, block in given.blocks.items():
        place = source.place("blocks", name)
        if block is None:
            continue
        if given.response == "magnitude" and not isinstance(block, ConstantBlock):
            faults.add(f"block {name!r}: {block.procedure} needs answers that are right or wrong, magnitude has none",
                       "Take `procedure: constant`.", place)  # fmt: skip
        if block.catch and (given.response != "yes-no" or given.reference is None):
            faults.add(f"block {name!r}: catch needs `response: yes-no`, and a `reference` to present instead", "",
                       place)  # fmt: skip
