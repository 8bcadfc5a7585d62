"""Chooses one task for each pause between two ticks, because two of them take longer than a tick at 5 kHz."""

from enum import Enum

from palpate.engine.job import Job

BURST = 16  # ticks between two bursts to the observers
FAST = 2500.0  # [Hz] rate of the real clock above which bursts are shorter: one of 16 ticks would delay the next tick

Task = Enum("Task", ["WAIT", "SIGN", "SEND", "NONE"])
"""Tasks of a worker in a pause. WAIT: none, as the hop has handed messages over in this pause. SIGN: send a part of a
heartbeat. SEND: send the messages of a burst. NONE: the burst is not complete."""


class Pauses:
    """The pauses between the ticks of a worker.

    handed  whether the hop has handed messages over in this pause that no node awaits
    unsent  whether those of an earlier pause have not been sent
    """

    __slots__ = ("_fast", "_signed", "_ticks", "_ticks_per_burst", "handed", "unsent")

    def __init__(self, job: Job) -> None:
        self._fast = job.clock == "real" and job.rate > FAST
        self._ticks_per_burst = max(1, round(BURST * FAST / job.rate)) if self._fast else BURST
        self._ticks = job.phase % self._ticks_per_burst  # since the last burst
        self._signed = False  # whether the last pause was used for a part of a heartbeat
        self.handed = self.unsent = False

    def choose(self, ticks: int, signs: bool) -> Task:
        """The task of the pause after some ticks; `signs`: whether parts of a heartbeat wait."""
        self._ticks += ticks
        handed, self.handed = self.handed, False
        full = self._ticks >= self._ticks_per_burst
        if handed and full and self._fast and not self.unsent:
            self.unsent = True
            return Task.WAIT
        self._signed = signs and not self._signed
        if self._signed:
            return Task.SIGN
        return Task.SEND if full else Task.NONE

    def begin_burst(self) -> None:
        """Count the ticks of the next burst from here."""
        self._ticks = 0
