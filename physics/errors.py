"""The errors that palpate raises on purpose: what a caller can tell apart and do something about.

    PalpateError
      ArgumentError     an argument of a function or a command that cannot be used
        MissingError      an outside solver or a stored reference that is not there
        UnsupportedError  a touch that a method cannot compute
      SettingError      a setting of a node
      UnitError         a quantity
      ClassError        a `use:` that names no usable class
      GraphError        a graph, scene, placement or launch file, with all its faults
      InputError        a message that a node cannot use
      NodeError         a node that failed, with its cause
      DeviceError       a device that is not there, or lost
      RunError          a run that cannot begin, failed, or is not to be found
      RecordingError    a recording that cannot be read, or lacks what is wanted
      PictureError      what cannot be drawn
      PageError         what cannot be shown in a browser
      ArchiveError      a stored basis or table
      FingertipError    the surfaces of a fingertip
      MaterialError     the constants of a material
      MeshError         a mesh
      ConvergenceError  a load step that fails however small
      ScanError         images of a scan
      SessionError      measured indentations
      FitError          data that cannot determine a model
      GymError          gymnasium, which is not there

Each is declared where it is first raised; those that several rooms raise stand below. `MessageError` stands apart, as
`palpate.messages` imports nothing of ours.
"""

from typing import Any, Self

TROUBLE = 1  # Exit code of a command that failed
MISUSE = 2  # Exit code of a wrong graph, setting, file or command line


class PalpateError(Exception):
    """Its text says where, what was found, what was expected and what would work.

    exit_code  of the command that ends with it
    hint       a line more, for people
    """

    exit_code: int = TROUBLE

    def failed(self) -> Self:
        """This error, where the input was right and the work itself failed."""
        self.exit_code = TROUBLE
        return self

    @property
    def hint(self) -> str:
        return ""

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {"error": type(self).__name__, "text": str(self)}


class ArgumentError(PalpateError, ValueError):
    """An argument of a function or a command that cannot be used; says what was expected."""

    exit_code = MISUSE


class MeshError(PalpateError, ValueError):
    """A mesh that cannot be used; says which element or face, and where."""

    exit_code = MISUSE


class RunError(PalpateError, RuntimeError):
    """A run that cannot begin, failed, or is not to be found. What was recorded before stays in its file."""
