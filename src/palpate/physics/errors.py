"""The exceptions that palpate raises on purpose, which a caller can distinguish and handle.

    PalpateError
      ArgumentError     an invalid argument of a function or a command
        MissingError      a reference solver or a stored reference is missing
        UnsupportedError  a touch that a method cannot compute
      SettingError      a setting of a node
      UnitError         a quantity
      ClassError        a `use:` that names no usable class
      GraphError        a graph, scene, placement or launch file, with all its faults
      InputError        a message that a node cannot use
      NodeError         a node that failed, with its cause
      DeviceError       a device that is missing or was lost
      RunError          a run that cannot start, failed, or cannot be found
      RecordingError    a recording that cannot be read, or lacks requested data
      PictureError      a picture that cannot be drawn
      PageError         a page that cannot be shown in a browser
      WebError          a page that cannot run without a server
      ArchiveError      a stored basis or table
      FingertipError    the surfaces of a fingertip
      MaterialError     the constants of a material
      MeshError         a mesh
      PolygonError      a polygon of a mesh file
      ConvergenceError  a load step that fails at the smallest size
      ScanError         images of a scan
      SessionError      measured indentations
      FitError          data that cannot determine a model
      GymError          gymnasium is not installed

Each is declared where it is first raised; those that several packages raise are declared below. `MessageError` is
separate because `palpate.messages` does not import this module.
"""

from typing import Any, Self

TROUBLE = 1  # Exit code of a command that failed
MISUSE = 2  # Exit code of a wrong graph, setting, file or command line


class PalpateError(Exception):
    """Base class. The text says where, what was found, what was expected and what would work.

    exit_code  exit code of a command that fails with it
    hint       an additional line for people
    """

    exit_code: int = TROUBLE

    def as_failure(self) -> Self:
        """The error itself, with the exit code for a failure that the input did not cause."""
        self.exit_code = TROUBLE
        return self

    @property
    def hint(self) -> str:
        return ""

    def to_spec(self) -> dict[str, Any]:
        """The error as plain data for programs."""
        return {"error": type(self).__name__, "text": str(self)}


class ArgumentError(PalpateError, ValueError):
    """An invalid argument of a function or a command; says what was expected."""

    exit_code = MISUSE


class PalpateWarning(UserWarning):
    """A result that is valid only within limits; says which node, what was found and what would help."""


class MeshError(PalpateError, ValueError):
    """An invalid mesh; says which element or face, and where."""

    exit_code = MISUSE


class RunError(PalpateError, RuntimeError):
    """A run that cannot start, failed, or cannot be found. Data recorded before the failure stay in the file."""
