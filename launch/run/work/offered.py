"""The gate of `palpate remote join`: which job of a launcher elsewhere this machine runs.

The launcher may be anybody on the network (`--unencrypted`), or anybody with the key. Its job names classes, which
would be imported and called, and settings with files. Accepted are nodes, observers and messages of palpate, of
packages that the user of this machine trusts (`--trust`), and of modules that are already imported. A logger may only
write a file that is missing or already a recording.

Placement never changes the results, so the sources of palpate and the data files in the settings must be those of the
launcher's machine.
"""

from pathlib import Path

from palpate.engine.imports import UntrustedError, check_trusted, load_class, modules_of
from palpate.engine.job import Job, NodeJob, ObserverJob, members
from palpate.launch.load.dependencies import texts
from palpate.launch.run.result import NodeFault
from palpate.launch.run.tasks.task import sources
from palpate.messages import Message
from palpate.nodes.base import Node, Observer
from palpate.nodes.logger import Mcap
from palpate.physics.extras import package_version
from palpate.physics.readable import DATA, hash_of_file
from palpate.records.format.mcap_file import MAGIC

SOURCE = "the job of a launcher elsewhere"


def refusal(job: Job, launcher: str) -> NodeFault | None:
    """Why this machine does not run a job; None: it runs it. Nothing is called, and nothing untrusted imported.

    launcher  `sources` of the launcher
    """
    for given in members(job):
        try:
            if text := _refusal(given) or _difference(given, job.about.get("files")):
                return NodeFault(given.name, "palpate remote join", text)
        except (UntrustedError, ImportError, AttributeError) as error:
            return NodeFault(given.name, "palpate remote join", f"refused: {error}")
    if launcher != sources():
        text = (
            f"refused: palpate {package_version('palpate')} there has other sources ({sources()}) than that of the "
            f"launcher ({launcher or 'unknown'}), so results might differ; install the same one on both machines"
        )
        return NodeFault(", ".join(given.name for given in members(job)), "palpate remote join", text)
    return None


def _difference(given: NodeJob | ObserverJob, files: object) -> str:
    """A data file in the settings that this machine lacks, or of which it has another one; empty: none.

    files  names and hashes of the data files of the run, on the launcher's machine
    """
    named = set(texts(given.settings))
    for name, expected in files.items() if isinstance(files, dict) else ():
        if name in named and Path(name).suffix.lower() in DATA and (found := hash_of_file(name)) != expected:
            what = "differs from that of the launcher" if found else "is missing"
            return f"refused: {name}: the file there {what}; copy it to the same path on both machines"
    return ""


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
