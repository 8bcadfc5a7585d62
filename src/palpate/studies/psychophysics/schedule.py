"""Order of trials, drawn from a seed: equal answers give equal trials.

A session resumes by replaying the stored answers to a new schedule.
"""

import zlib
from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from palpate.studies.psychophysics.procedures import Procedure, procedures
from palpate.studies.psychophysics.stimuli import Stimuli


@dataclass(frozen=True)
class Trial:
    """One trial.

    number    number of the trial, from 1
    block     name of the block;  first: whether it is the first trial of the block
    track     number of the interleaved staircase, from 1
    level     level of the comparison; None: no signal
    interval  number of the interval with the comparison, from 1
    total     maximum number of trials of all blocks; 0: unknown
    in_block  number in the block, from 1
    """

    number: int
    block: str
    track: int
    level: float | None
    interval: int
    total: int
    in_block: int

    def levels(self, intervals: int) -> list[float | None]:
        """Level of each interval; None: the reference."""
        return [self.level if number == self.interval else None for number in range(1, intervals + 1)]


Schedule = Generator[Trial, bool, None]  # Yields trials; receives whether the answer is a hit: right, or yes


def schedule(stimuli: Stimuli, participant: str, session: int) -> Schedule:
    """All trials of a session. Each session has another random order of blocks, trials and intervals."""
    experiment = stimuli.experiment
    random = np.random.default_rng([experiment.seed, zlib.crc32(participant.encode()), session])
    names = list(experiment.blocks)
    if experiment.order == "random":
        names = random.permutation(names).tolist()
    blocks = {name: procedures(name, experiment.blocks[name], stimuli, random) for name in names}
    most = [procedure.most for tracks in blocks.values() for procedure in tracks]
    total, number = sum(most) if all(most) else 0, 0
    for name in names:
        catch, in_block = experiment.blocks[name].catch, 0
        total = 0 if catch else total
        while running := [procedure for procedure in blocks[name] if procedure.level is not None]:
            procedure: Procedure = running[int(random.integers(len(running)))]
            level = None if catch and random.random() < catch else procedure.level
            number, in_block = number + 1, in_block + 1
            interval = 1 + int(random.integers(experiment.intervals))
            track = blocks[name].index(procedure) + 1
            hit = yield Trial(number, name, track, level, interval, total, in_block)
            if level is not None:
                procedure.take(hit)
