"""The files of a page: each file of data is named after the hash of its compressed content, which the page checks.

Data that the same variants need are one file: for each request a browser uses about 2 ms of processor time."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import re
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any

from palpate.engine.faults import GraphError
from palpate.engine.slot import NodeError
from palpate.launch.load.launchfile import LaunchFile
from palpate.physics.scratch import ScratchFolder
from palpate.physics.writable import check_folder
from palpate.web.bundle import as_text, bundle
from palpate.web.device import HID
from palpate.web.errors import WebError
from palpate.web.packing import joined, shortest, squeezed
from palpate.web.program import compile_program
from palpate.web.recording import recording_head
from palpate.web.started import Started, started
from palpate.web.variants import Place, Variant, describe_page, variants

POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval' blob:; worker-src blob:; style-src 'self'; "
    "img-src data: blob:"
)
"""Content security policy: scripts of the folder only, no connection to any server, no text that becomes code."""
PAGE = ("page.js", "scene.js", "charts.js", "panel.js", "model.js", "hard.js", "sound.js")  # of views/page/static
ENGINE = (
    "engine.js",
    "worker.js",
    "tick.js",
    "frames.js",
    "carried.js",
    "fill.js",
    "recording.js",
    "replay.js",
    "files.js",
    "unpack.js",
    "sha256.js",
    "guard.js",
    "raw_hid.js",
    "palpate.js",
)


@dataclass(frozen=True)
class Built:
    """A folder.

    variants  number of them;  left_out  nodes and bodies that do not run, with the reason
    code, first, whole  [bytes] of the compressed code, of what the page loads at first, of the folder
    """

    variants: int
    left_out: dict[str, str]
    code: int
    first: int
    whole: int


def build(
    places: Sequence[Place],
    out: Path,
    bodies: Sequence[str],
    begin: Callable[[str], Callable[[float], None]],
    measure: Callable[[LaunchFile, Sequence[str], Callable[[float], None]], dict[str, Any]] | None = None,
) -> Built:
    """Write the page of a run to a new folder.

    places   scenes and organs to offer, that of the beginning first
    bodies   names of the bodies to offer; (): all that fit the graph
    begin    begins a stage of the progress; returns what takes the finished share
    measure  error and time of bodies on the touch of a run (`studies.body_figures`); None: the page shows none

    WebError: the folder has other files, or a node is not compiled. PageError, GraphError, OSError.
    """
    check_empty(out)
    launch = places[0].launch
    name = (launch.record or launch.graph).stem  # that of the organ, if it is from a file
    scratch = ScratchFolder("web")
    try:
        found = _all_variants(places, Path(scratch.name), bodies, begin, measure)
        files, entries, left_out, code = _build_variants(found, name, bodies, begin)
    finally:
        scratch.cleanup()
    first = next(entry for entry in entries if entry["first"])
    with _new_folder(out) as folder:
        (folder / "data").mkdir()
        for digest, data in files.items():
            text = f'palpateData("{digest}", "{base64.b64encode(data).decode()}");\n'
            (folder / "data" / f"{digest}.js").write_text(text, encoding="ascii")
        hid = HID if any(entry["device"] for entry in entries) else None
        code_hash = hashlib.sha256(code).hexdigest()
        _write_page(folder, {"name": name, "code": code_hash, "variants": entries, "hid": hid})
    page = sum((out / name).stat().st_size for name in ("index.html", "page.js", "page.css", "site.js"))
    loaded = sum(len(files[digest]) for digest in first["files"])  # without the form as text
    whole = sum(file.stat().st_size for file in out.rglob("*") if file.is_file())
    return Built(len(entries), left_out, len(squeezed(code)), page + loaded, whole)


def _all_variants(
    places: Sequence[Place], folder: Path, bodies: Sequence[str], begin: Any, measure: Any
) -> list[Variant]:
    """The variants of all places, with the figures of their bodies."""
    found = list[Variant]()
    for number, place in enumerate(places):
        (folder / str(number)).mkdir()
        own = variants(place, folder / str(number), bodies)
        names = list(dict.fromkeys(one.body for one in own))
        if measure is not None and len(names) > 1:
            measured = replace(place, figures=measure(place.launch, names, begin("measuring the bodies")))
            own = [replace(one, place=measured) for one in own]
        found += own
    return found


@contextlib.contextmanager
def _new_folder(out: Path) -> Iterator[Path]:
    """A folder under a temporary name next to this one, which it becomes when it is complete."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{out.name}-", dir=out.parent) as temporary:
        folder = Path(temporary) / out.name
        folder.mkdir()
        yield folder
        if out.is_dir():
            out.rmdir()  # it is empty
        folder.rename(out)


class _Store:
    """Data by their hash, and the variants that need them."""

    def __init__(self) -> None:
        self._forms: dict[str, bytes] = {}
        self._needed: dict[str, list[int]] = {}

    def add(self, data: bytes, variant: int) -> str:
        """Add data that a variant needs, by its number; their hash."""
        digest = hashlib.sha256(data).hexdigest()
        if digest not in self._forms:
            self._forms[digest] = shortest(data)
        needed = self._needed.setdefault(digest, [])
        if variant not in needed:
            needed.append(variant)
        return digest

    def files(self) -> tuple[dict[str, bytes], dict[int, list[str]]]:
        """Compressed files by the hash of their content, each with all data of the same variants; and the files of
        each variant."""
        groups: dict[tuple[int, ...], dict[bytes, bytes]] = {}
        for digest, form in self._forms.items():
            groups.setdefault(tuple(self._needed[digest]), {})[bytes.fromhex(digest)] = form
        files, needs = dict[str, bytes](), dict[int, list[str]]()
        for numbers, forms in groups.items():
            data = squeezed(joined(forms))
            digest = hashlib.sha256(data).hexdigest()
            files[digest] = data
            for number in numbers:
                needs.setdefault(number, []).append(digest)
        return files, needs


def _build_variants(
    found: Sequence[Variant], name: str, wished: Sequence[str], begin: Callable[[str], Callable[[float], None]]
) -> tuple[dict[str, bytes], list[dict[str, Any]], dict[str, str], bytes]:
    """The files of all variants, their entries in the list of the page, what is left out, and the code."""
    store, entries = _Store(), list[dict[str, Any]]()
    with ExitStack() as running:
        runs, refused = _start(found, wished, running, begin("starting the nodes"))
        done = begin("compiling to WebAssembly")
        program = compile_program(run.segment for _, run in runs)
        done(1.0)
        done = begin("packing the memory")
        offered = [variant for variant, _ in runs]
        for number, (variant, run) in enumerate(runs):
            page, mesh = describe_page(run, variant, offered, name)
            about = program.describe(run) | {
                "name": f"{name}.mcap", "mesh": store.add(mesh, number), "page": page, "recording": recording_head(run),
            }  # fmt: skip
            about["recording"]["program"] = _identity(program.code.code, about["parts"])
            for data in (program.code.code, *(program.parts[part["hash"]] for part in about["parts"])):
                store.add(data, number)
            digest = store.add(json.dumps(about, separators=(",", ":")).encode(), number)
            entries.append({**variant.choice, "hash": digest, "program": about["recording"]["program"]})
            done((number + 1) / len(runs))
        files, needs = store.files()
        entries = [{**entry, "files": needs[number]} for number, entry in enumerate(entries)]
        return files, entries, runs[0][1].left_out | refused, program.code.code


def _start(
    found: Sequence[Variant], wished: Sequence[str], running: ExitStack, done: Callable[[float], None]
) -> tuple[list[tuple[Variant, Started]], dict[str, str]]:
    """The variants that start, and the bodies that do not, with the reason.

    NodeError, GraphError: the first one does not, or one with a body of `wished`, the names of the bodies to offer.
    """
    runs: list[tuple[Variant, Started]] = []
    refused: dict[str, str] = {}
    for number, variant in enumerate(found):
        body = variant.body.rpartition(".")[2]
        try:
            runs.append((variant, running.enter_context(started(variant.launch))))
        except (GraphError, NodeError) as error:
            asked = variant.case is None and body in [name.rpartition(".")[2] for name in wished]
            if variant.first or (asked and isinstance(error, NodeError)):
                raise
            if variant.case is None:
                refused.setdefault(body, str(error).splitlines()[0])
        done((number + 1) / len(found))
    return runs, {body: why for body, why in refused.items() if all(body not in run.body for run, _ in runs)}


def _identity(code: bytes, parts: Sequence[dict[str, Any]]) -> str:
    """The hash of what determines the bytes of a variant's messages: its code and its memory. A recording of the page
    has it, so that the page finds the variant again."""
    return hashlib.sha256(code + "".join(part["hash"] for part in parts).encode()).hexdigest()


def check_empty(out: Path) -> None:
    """WebError: a folder cannot take the page. OSError: it cannot be written."""
    out = out.absolute()
    if out.exists() and not out.is_dir():
        raise WebError(f"--out: {out} is a file, expected a new or empty folder")
    if out.is_dir() and any(out.iterdir()):
        raise WebError(f"--out: {out} is not empty, expected a new or empty folder")
    check_folder(out)


def _write_page(out: Path, site: dict[str, Any]) -> None:
    """The page of `palpate touch`, with the engine that runs in the browser."""
    page, web = resources.files("palpate.views.page") / "static", resources.files("palpate.web") / "static"
    sources = {name: (page / name).read_text(encoding="utf-8") for name in PAGE}
    sources |= {name: (web / name).read_text(encoding="utf-8") for name in ENGINE}
    script = as_text("palpateWorker", bundle(sources, "worker.js")) + bundle(sources, "page.js")
    (out / "page.js").write_text(script, encoding="utf-8")
    library = bundle(sources, "palpate.js") + "export const { load, Touch } = module_palpate_js;\n"
    (out / "palpate.mjs").write_text(library, encoding="utf-8")
    (out / "palpate.d.mts").write_text((web / "palpate.d.ts").read_text(encoding="utf-8"), encoding="utf-8")
    (out / "page.css").write_text((page / "page.css").read_text(encoding="utf-8"), encoding="utf-8")
    (out / "site.js").write_text(f"globalThis.palpateSite = {json.dumps(site)};\n", encoding="utf-8")
    text = (page / "index.html").read_text(encoding="utf-8")
    policy = f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">'
    text = text.replace('<meta charset="utf-8">', f'<meta charset="utf-8">{policy}').replace(
        'href="/page.css"', 'href="page.css"'
    )
    scripts = '<script src="site.js"></script>\n<script src="page.js"></script>'
    text = re.sub(r'<script type="module" src="/page.js"></script>', scripts, text)
    (out / "index.html").write_text(text, encoding="utf-8")
