"""The run of each level: sets the level and all other differences, and rejects indistinguishable stimuli."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.engine.faults import Faults, GraphError
from palpate.engine.graph import Graph
from palpate.launch.load.files import SCENES, find_file
from palpate.launch.load.launchfile import LaunchFile
from palpate.launch.load.launchfile import find as find_launch
from palpate.launch.load.organ_file import OrganFile
from palpate.launch.load.values.distributions import round_values
from palpate.launch.load.values.source import YamlSource
from palpate.nodes.base import settings
from palpate.studies.files import graph_of
from palpate.studies.psychophysics.file import ConstantBlock, Experiment, StaircaseBlock
from palpate.studies.sweeps.axes import GRIDS
from palpate.studies.sweeps.checks import path as full_path
from palpate.studies.sweeps.point import overrides
from palpate.units.quantity import UnitError, convert


class Stimuli:
    """The stimuli of an experiment.

    path       path of the level in the form of `--set`;  unit: its SI unit
    reference  value of the path in the reference; None: the reference differs elsewhere or does not exist
    launch     the run without the variations

    GraphError: lists all faults of paths and values, before anything runs.
    """

    def __init__(
        self, experiment: Experiment, source: YamlSource, file: Path, sets: Sequence[str] = (),
        organ: OrganFile | None = None,
    ) -> None:  # fmt: skip
        self.experiment, self._source, self.faults = experiment, source, Faults()
        scene: Any = experiment.scene
        if isinstance(scene, str):
            scene = find_file(scene, SCENES, file.parent, source.place("scene"), "scene")
        self.launch: LaunchFile = (
            find_launch(graph_of(file, experiment.graph))
            .but(scene=scene, overrides=[*overrides(experiment.set, "set"), *sets], organ=organ)
            .settle_organ()
        )
        base = self.launch.load()
        self.path = full_path(experiment.vary, base)
        given = experiment.reference
        self._other = dict(given) if isinstance(given, Mapping) else {} if given is None else {self.path: given}
        self._other = {full_path(path, base): value for path, value in self._other.items()}
        self.unit = self._unit(base)
        at = self._other.get(self.path)
        self.reference = None if at is None else self.number("reference", at)
        if self.reference is not None:
            self._other[self.path] = self.reference
        self.levels = {name: self._levels(name, block) for name, block in experiment.blocks.items()}
        self.faults.done()
        self._check()
        self.faults.done()

    @property
    def sign(self) -> int:
        """1 if a greater level is easier, -1 if a smaller one is. With a reference at the same path, levels farther
        from it are easier."""
        return 1 if self.reference is not None or self.experiment.harder == "lower" else -1

    def x(self, level: float) -> float:
        """Abscissa of an increasing psychometric function: the distance from the reference, or the level, negated if a
        higher level is harder."""
        return self.sign * level if self.reference is None else abs(level - self.reference)

    def two_sided(self, name: str) -> bool:
        """Whether a block has levels on both sides of the reference; the counted answer is then "judged greater"."""
        levels, constant = self.levels[name], isinstance(self.experiment.blocks[name], ConstantBlock)
        return constant and self.reference is not None and min(levels) < self.reference < max(levels)

    def run(self, block: str, level: float | None) -> LaunchFile:
        """The run of a level; None: the run of the reference."""
        values = {self.path: level} if level is not None else self._other
        chosen = overrides({**self.experiment.blocks[block].set}, f"block {block!r}, set")
        return self.launch.but(overrides=[*chosen, *overrides(values, "vary" if level is not None else "reference")])

    def number(self, key: str, value: Any) -> float:
        """SI value of a level given as a number or with a unit. A fault is noted and gives NaN."""
        try:
            if isinstance(value, bool) or not isinstance(value, int | float | str):
                raise UnitError(f"found {value!r}, expected a number")
            return convert(value, self.unit) if isinstance(value, str) else float(value)
        except UnitError as error:
            self.faults.add(f"{key} [{self.unit}]: {error}", "", self._source.place(*key.split(".")))
            return float("nan")

    def grid(self, key: str, given: Any) -> list[float]:
        """SI values of a list, or of {linspace: [low, high, number]}, {geomspace: ...}."""
        kind, how = next(iter(given.items())) if isinstance(given, Mapping) and len(given) == 1 else ("", given)
        if not isinstance(how, list) or not how or (kind and (kind not in GRIDS or len(how) != 3)):
            self.faults.add(f"{key}: found {given!r}, expected a list of values, or {{linspace: [low, high, number]}}",
                             "", self._source.place(*key.split(".")))  # fmt: skip
            return []
        if not kind:
            return [self.number(key, value) for value in how]
        if not isinstance(how[2], int) or not 1 <= how[2] <= 1000:
            self.faults.add(f"{key}: found {how[2]!r} values, expected 1 to 1000", "",
                             self._source.place(*key.split(".")))  # fmt: skip
            return []
        ends = [self.number(key, value) for value in how[:2]]
        return round_values(GRIDS[kind](*ends, how[2])).tolist()

    def _unit(self, base: Graph) -> str:
        """Unit of the setting at `path`. GraphError: the path does not exist."""
        head, _, name = self.path.rpartition(".")
        for spec in base.nodes.values() if head.startswith("scene") else filter(None, [base.nodes.get(head)]):
            if name in settings(spec.cls):
                return settings(spec.cls)[name].unit
        self.launch.but(overrides=overrides({self.path: self._other.get(self.path, 1.0)}, "vary")).load()
        return "1"

    def _levels(self, name: str, block: Any) -> list[float]:
        at = f"blocks.{name}."
        if isinstance(block, StaircaseBlock):
            starts = block.start if isinstance(block.start, list) else [block.start]
            return [self.number(f"{at}start", start) for start in starts]
        return self.grid(f"{at}levels", block.levels)

    def _check(self) -> None:
        """Check that each stimulus loads, and that the stimuli of each pair differ."""
        for name, levels in self.levels.items():
            if not levels:
                self.faults.add(f"block {name!r}: no levels", "", self._source.place("blocks", name))
                continue
            place = self._source.place("blocks", name)
            try:
                tried = {min(levels), max(levels), *(level for level in levels if level == self.reference)}
                known = {level: _determinants(self.run(name, level).load()) for level in sorted(tried)}
                other = None if self.experiment.reference is None else _determinants(self.run(name, None).load())
            except GraphError as error:
                self.faults.entries.extend(error.faults)
                continue
            same = [level for level, one in known.items() if one == other]
            if len(same) == len(known) or (same and not self.two_sided(name)):
                self.faults.add(f"block {name!r}: the stimuli of a pair are the same: {self.path} = {same[0]:g} "
                                 f"{self.unit} is the reference", "Take others.", place)  # fmt: skip
            elif len(known) > 1 and len({repr(one) for one in known.values()}) == 1:
                self.faults.add(f"block {name!r}: all levels give the same stimulus: nothing reads {self.path}", "",
                                place)  # fmt: skip
            if isinstance(self.experiment.blocks[name], ConstantBlock) and len(set(levels)) < len(levels):
                self.faults.add(f"block {name!r}: a level stands twice", "Use `repeats`.", place)
        if any(map(self.two_sided, self.levels)) and self.experiment.function == "weibull":
            self.faults.add("function: weibull begins at 0, but levels lie to both sides of the reference",
                             "Take normal or logistic.", self._source.place("function"))  # fmt: skip
        if self.sign < 0 and self.experiment.function == "weibull":
            self.faults.add("function: weibull rises with the level, but higher levels are harder here",
                             "Take normal or logistic.", self._source.place("function"))  # fmt: skip


def _determinants(graph: Graph) -> dict[str, Any]:
    """Everything that determines the stimulus: classes, settings and inputs of all nodes."""
    return {
        name: (spec.use, {key: np.asarray(value).tolist() if hasattr(value, "tolist") else value
                          for key, value in spec.settings.items()}, spec.edges, spec.off)
        for name, spec in graph.nodes.items()
    } | {"": graph.rate}  # fmt: skip
