"""Joins the scripts of a page into one, so that a folder opened without a server works: browsers load no modules there.

Each module becomes a function whose result has what it exports. The modules use only named imports and exports at the
beginning of a line.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

_IMPORT = re.compile(r'^import \{([^}]*)\} from "/([\w.]+)";\n', re.MULTILINE)
_COMMENT = re.compile(r"^ *//.*\n", re.MULTILINE)
_EXPORT = re.compile(r"^export (?:async )?(?:const|let|class|function\*?) (\w+)", re.MULTILINE)


def bundle(sources: Mapping[str, str], main: str) -> str:
    """The script of a module and of all that it imports.

    sources  text of each module by its name
    """
    order: list[str] = []

    def visit(name: str) -> None:
        for found in _IMPORT.finditer(sources[name]):
            visit(found[2])
        if name not in order:
            order.append(name)

    visit(main)
    return '"use strict";\n' + "".join(_function(name, sources[name]) for name in order)


def _function(name: str, text: str) -> str:
    text = _COMMENT.sub("", text)  # 18 kB of all scripts
    exports = _EXPORT.findall(text)
    text = _IMPORT.sub(lambda found: f"const {{{found[1].replace(' as ', ': ')}}} = {_variable(found[2])};\n", text)
    text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
    return f"const {_variable(name)} = (() => {{\n{text}return {{ {', '.join(exports)} }};\n}})();\n"


def _variable(name: str) -> str:
    return "module_" + re.sub(r"\W", "_", name)


def as_text(name: str, script: str) -> str:
    """A script that sets a global variable to the text of another one."""
    return f"globalThis.{name} = {json.dumps(script)};\n"
