"""Reading a recording: all messages of a run, stored or computed again."""

import tempfile
from pathlib import Path
from typing import IO

from palpate.records.differences import Report
from palpate.records.fill import explained, fill
from palpate.records.stored import RecordingError, Stored


class Recording(Stored):
    """A recording on disk. One that holds its sources only computes the rest when it is first read.

    computed  streams that the file holds only checks of
    """

    def __init__(self, path: str | Path) -> None:
        super().__init__(path)
        self._filled: IO[bytes] | None = None
        self.computed = self.as_whole()

    def compute(self, tolerance: float | None = None) -> Report:
        """Compute what a recording of sources does not hold; how its checks came out. RecordingError: it cannot be."""
        filled = tempfile.NamedTemporaryFile(prefix="palpate-", suffix=".mcap")  # noqa: SIM115 - as long as this
        try:
            report, _ = fill(self.path, filled, tolerance)
        except OSError as error:
            raise RecordingError(f"{self.path}: computing its messages takes room in {tempfile.gettempdir()}: "
                                 f"{error.strerror}; TMPDIR names another folder").failed() from None  # fmt: skip
        self._filled = filled  # not before it is whole: whoever was interrupted begins again
        return report

    def file(self) -> Path:
        """The file with all messages: that on disk, or of a recording of sources one that is computed for the time
        that this object lives. RecordingError: it does not come out as it was recorded."""
        if not self.computed:
            return self.path
        if self._filled is None:
            report = self.compute()
            if report.first is not None:
                self._filled = None
                raise RecordingError(explained(self.path, report, self.about)).failed()
        assert self._filled is not None
        return Path(self._filled.name)
