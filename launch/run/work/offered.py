"""The gate of `palpate remote join`: which job of a launcher elsewhere this machine runs.

The launcher may be anybody on the network (`--unencrypted`), or anybody with the key. Its job names classes, which
would be imported and called, and settings with files. Accepted are nodes, observers and messages of palpate, of
packages that the user of this machine trusts (`--trust`), and of modules that are already imported. A logger may only
write a file that is missing or already a recording.
"""

from pathlib import Path

from palpate.engine.imports import UntrustedError, check_trusted, load_class, modules_of
from palpate.engine.job import Job, NodeJob, ObserverJob, members
from palpate.launch.run.result import NodeFault
from palpate.messages import Message
from palpate.nodes.base import Node, Observer
from palpate.nodes.logger import Mcap
from palpate.records.format.mcap_file import MAGIC

SOURCE = "the job of a launcher elsewhere"


def refusal(job: Job) -> NodeFault | None:
    """Why this machine does not run a job; None: it runs it. Nothing is called, and nothing untrusted imported."""
    for given in members(job):
        try:
            if text := _refusal(given):
                return NodeFault(given.name, "palpate remote join", text)
        except (UntrustedError, ImportError, AttributeError) as error:
            return NodeFault(given.name, "palpate remote join", f"refused: {error}")
    return None


def _refusal(given: NodeJob | ObserverJob) -> str:
    types = [] if isinstance(given, NodeJob) else [stream.type for stream in given.streams.values()]
    check_trusted(*modules_of(given.cls, *types), source=SOURCE)
    for name in types:
        load_class(name, Message)
    if isinstance(given, NodeJob):
        load_class(given.cls, Node)
        return ""
    kind = load_class(given.cls, Observer)
    return _file_refusal(given.settings.get("path", Mcap.path)) if issubclass(kind, Mcap) else ""


def _file_refusal(path: object) -> str:
    """Why a logger must not write a file; empty: it may."""
    expected = "expected a new file, or a recording to replace, with a name that ends in .mcap"
    if not isinstance(path, str) or not path.endswith(".mcap"):
        return f"refused: path: found {path!r}, {expected}"
    file = Path(path)
    try:
        if file.is_fifo() or (file.exists() and not file.is_file()):
            return f"refused: path: {path} is no file, {expected}"
        if file.exists():
            with file.open("rb") as former:
                if former.read(len(MAGIC)) != MAGIC:
                    return f"refused: path: {path} has other content, {expected}"
    except (OSError, ValueError) as error:
        return f"refused: path: {path!r} cannot be used: {error}"
    return ""
