"""All errors have one base class with the exit code, and one function prints them for all commands."""

import ast
import builtins
import functools
import json
import re
from pathlib import Path

import pytest
import typer
from sources import nodes
from typer.testing import CliRunner

from palpate.cli.__main__ import app
from palpate.cli.terminal.group import Verbs
from palpate.physics import errors
from palpate.physics.errors import PalpateError

FOLDERS = ("src/palpate", "messages", "nodes", "launch")
INSIDE = {
    "Broken", "ClosedError", "DisturbedError", "EndedError", "HangError", "Inverted", "LinkError", "MissingInput",
    "NotPositive", "ProcessorError", "RefusedError", "UncheckedError", "UnheldError", "UnnamedError", "UntrustedError",
    "ZmtpError", "_NoEquilibrium",
}  # fmt: skip
"""Internal errors, which their callers always catch."""
APART = {"MessageError"}
"""Of `palpate.messages`, which imports no other folder of palpate."""


@functools.cache
def declared() -> dict[str, list[str]]:
    """Name of each error class in the sources -> first base class of each of its declarations."""
    bases: dict[str, list[str]] = {}
    for folder in FOLDERS:
        for file in sorted((Path(__file__).parents[2] / folder).rglob("*.py")):
            for node in nodes(file):
                if isinstance(node, ast.ClassDef) and node.bases:
                    bases.setdefault(node.name, []).append(ast.unparse(node.bases[0]))

    def error(name: str) -> bool:
        kind = getattr(builtins, name, None)
        if isinstance(kind, type):
            return issubclass(kind, Exception) and not issubclass(kind, Warning)
        return any(error(base) for base in bases.get(name, ()) if base != name)

    return {name: found for name, found in bases.items() if error(name)}


def drawn() -> dict[str, str]:
    """Error -> base class in the tree in the docstring of `physics/errors.py`."""
    parents, path = {}, []
    for line in errors.__doc__.splitlines():
        entry = re.match(r"( {4,})(\w+Error)\b", line)
        if entry:
            depth = len(entry[1]) // 2 - 2
            path = [*path[:depth], entry[2]]
            parents[entry[2]] = path[-2] if depth else "Exception"
    return parents


def test_the_tree_of_errors_agrees_with_the_documented_one():
    public = {name: bases for name, bases in declared().items() if name not in INSIDE | APART and name[0] != "_"}
    assert {name: [parent] for name, parent in drawn().items()} == public, "one declaration each, ending in Error"


def test_the_tree_has_one_root_and_omits_internal_errors():
    assert [name for name, parent in drawn().items() if parent == "Exception"] == ["PalpateError"]
    assert declared().keys() >= INSIDE | APART, "one of them no longer exists"


class Sour(PalpateError):
    exit_code = 7

    @property
    def hint(self):
        return "sweeten it"


def program(error):
    app = typer.Typer(cls=Verbs)

    @app.callback()
    def top(debug: bool = False) -> None:
        pass

    group = typer.Typer()

    @group.command()
    def deep(as_json: bool = typer.Option(False, "--json", callback=note)) -> None:
        raise error

    @group.command()
    def other() -> None:
        pass

    app.add_typer(group, name="group")
    return app


def note(context: typer.Context, value: bool) -> bool:
    context.find_root().meta["palpate.json"] = value
    return value


CASES = {
    "own": (Sour("it is sour"), 7, "it is sour\nsweeten it\n", {"error": "Sour", "text": "it is sour"}),
    "file": (FileNotFoundError(2, "No such file or directory", "x.csv"), 2, "x.csv: No such file or directory\n",
             {"error": "FileNotFoundError", "text": "x.csv: No such file or directory"}),
    "permission": (PermissionError(13, "Permission denied", "/x"), 2, "/x: Permission denied\n",
                   {"error": "PermissionError", "text": "/x: Permission denied"}),
    "unforeseen": (ZeroDivisionError("by zero"), 1,
                   "ZeroDivisionError: by zero\n`palpate --debug ...` shows the traceback.\n",
                   {"error": "ZeroDivisionError", "text": "by zero"}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_errors_of_all_commands_are_printed_by_one_function(case):
    error, code, text, data = CASES[case]
    run = CliRunner().invoke(program(error), ["group", "deep"])
    assert (run.exit_code, run.stderr) == (code, text)
    run = CliRunner().invoke(program(error), ["group", "deep", "--json"])
    assert run.exit_code == code and json.loads(run.stdout) == {"ok": False, **data}
    run = CliRunner().invoke(program(error), ["--debug", "group", "deep"])
    assert run.exception is error


def test_usage_errors_are_printed_by_typer():
    run = CliRunner().invoke(program(typer.BadParameter("unknown thing")), ["group", "deep"])
    assert run.exit_code == 2 and "unknown thing" in run.stderr
    assert CliRunner().invoke(program(typer.Exit(5)), ["group", "deep"]).exit_code == 5


def test_join_prints_the_launcher_that_it_waits_for(monkeypatch):
    monkeypatch.setattr("palpate.launch.run.work.process.join", lambda *given: 0)
    words = ["remote", "join", "tcp://10.0.0.1:5600", "far", "--unencrypted", "--timeout", "7"]
    printed = CliRunner().invoke(app, words)
    assert printed.exit_code == 0 and "waiting up to 7 s for the launcher at tcp://10.0.0.1:5600" in printed.stderr


def test_join_without_a_launcher_ends_with_a_one_line_error():
    words = ["remote", "join", "tcp://127.0.0.1:1", "far", "--unencrypted", "--timeout", "0.3"]
    printed = CliRunner().invoke(app, words)
    assert printed.exit_code == 1
    assert printed.stderr.splitlines()[-1] == "no launcher at tcp://127.0.0.1:1 that waits for group 'far'"
