"""The root of all errors that palpate raises on purpose: what a user can do something about.

    PalpateError
      MaterialError  FingertipError  BasisError            physics
      MeshError  ConvergenceError  RunError                finite elements
      SessionError  FitError  ScanError                    measurements
      SettingError  NodeFault  DeviceError                 nodes and devices
      GraphError  ClassError  UnitError                    graphs, scenes, placements, launch files
      RecordingError  NoRun  PortInUse  NoMesh  NoRendering

`MessageError` stands apart, as `palpate.messages` imports nothing of ours.
"""

from __future__ import annotations

from typing import Any

TROUBLE = 1
"""Exit code of a command that failed."""
MISUSE = 2
"""Exit code of a wrong graph, setting, file or command line."""


class PalpateError(Exception):
    """Its text says where, what was found, what was expected and what would work.

    exit_code  of the command that ends with it
    hint       a line more, for people
    """

    exit_code: int = TROUBLE

    @property
    def hint(self) -> str:
        return ""

    def to_spec(self) -> dict[str, Any]:
        """Plain data for programs."""
        return {"error": type(self).__name__, "text": str(self)}
