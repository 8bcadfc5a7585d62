"""Reads a recording: all messages of a run, stored or recomputed."""

import tempfile
from pathlib import Path

from palpate.physics.scratch import ScratchFolder
from palpate.records.differences import Report
from palpate.records.fill import explain_difference, fill
from palpate.records.stored import RecordingError, Stored

_FILLED = "all.mcap"


class Recording(Stored):
    """A recording on disk. The first read of a recording of sources recomputes the other messages.

    computed  streams that are recomputed; the file has only checks of them
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._filled: ScratchFolder | None = None
        self.temporary: ScratchFolder | None = None  # folder of the file, which is removed with this
        self.computed = self.as_whole()

    def compute(self, tolerance: float | None = None) -> Report:
        """Compute the missing messages of a recording of sources; returns the result of the checks. RecordingError."""
        filled = ScratchFolder("filled")  # lives with this object
        try:
            with open(Path(filled.name, _FILLED), "w+b") as file:
                report, _ = fill(self.path, file, tolerance)
        except OSError as error:
            raise RecordingError(f"{self.path}: computing its messages needs space in {tempfile.gettempdir()}: "
                                 f"{error.strerror}; TMPDIR names another folder").as_failure() from None  # fmt: skip
        self._filled = filled  # only when complete: an interrupted computation starts again
        return report

    def file(self) -> Path:
        """The file with all messages: the recording, or for a recording of sources a temporary file that lives as long
        as this object. RecordingError: the recomputed messages differ from the checks."""
        if not self.computed:
            return self.path
        if self._filled is None:
            report = self.compute()
            if report.first is not None:
                self._filled = None
                raise RecordingError(explain_difference(self.path, report, self.about)).as_failure()
        assert self._filled is not None
        return Path(self._filled.name, _FILLED)
