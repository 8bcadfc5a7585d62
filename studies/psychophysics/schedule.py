"""The order of trials, all of it drawn from a seed: the same answers give the same trials.

A session is thus resumed by telling a new schedule the answers that are stored.
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

    number    from 1
    block     its name; first: whether it is the first one of its block
    track     number from 1 of the staircase, of those that are interleaved
    level     of the comparison; None: there is no signal
    interval  number of the interval with the comparison, from 1
    total     trials of all blocks at most; 0: unknown
    in_block  number in its block, from 1
    """

    number: int
    block: str
    track: int
    level: float | None
    interval: int
    total: int
    in_block: int

    def levels(self, intervals: int) -> list[float | None]:
        """What each interval has; None: the reference."""
        return [self.level if number == self.interval else None for number in range(1, intervals + 1)]


Schedule = Generator[Trial, bool, None]  # Yields trials; is sent whether the answer was a hit: right, or yes


def schedule(stimuli: Stimuli, participant: str, session: int) -> Schedule:
    """All trials of a session. The order of blocks, of trials and of intervals is drawn anew for each session."""
    experiment = stimuli.experiment
    random = np.random.default_rng([experiment.seed, zlib.crc32(participant.encode()), session])
    names = list(experiment.blocks)
    if experiment.order == "random":
        names = random.permutation(names).tolist()
    blocks = {name: procedures(name, experiment.blocks[name], stimuli, random) for name in names}
    most = [procedure.most for own in blocks.values() for procedure in own]
    total, number = sum(most) if all(most) else 0, 0
    for name in names:
        catch, in_block = experiment.blocks[name].catch, 0
        total = 0 if catch else total
        while running := [own for own in blocks[name] if own.level is not None]:
            own: Procedure = running[int(random.integers(len(running)))]
            level = None if catch and random.random() < catch else own.level
            number, in_block = number + 1, in_block + 1
            interval = 1 + int(random.integers(experiment.intervals))
            track = blocks[name].index(own) + 1
            hit = yield Trial(number, name, track, level, interval, total, in_block)
            if level is not None:
                own.take(hit)
