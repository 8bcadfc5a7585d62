"""Errors have one root, which holds the exit code, and one place where a command tells them."""

import ast
import builtins
import json
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from palpate.launch.commands.common import Verbs
from palpate.physics.errors import PalpateError

FOLDERS = (
    "physics", "models", "messages", "drivers", "nodes", "engine", "launch", "records", "views", "studies",
)  # fmt: skip
INSIDE = {
    "Broken", "Ended", "Hangs", "Inverted", "MissingInput", "NotPositive", "Refused", "UnheldError", "ZmtpError",
    "_Fault",
    "UntrustedError",
}  # fmt: skip
"""Caught by their callers, always; no user meets them."""
APART = {"MessageError"}
"""Of `palpate.messages`, which imports nothing of ours."""


def raised():
    """Every class of an error that is declared in a source, with its bases."""
    for folder in FOLDERS:
        for file in sorted((Path(__file__).parents[3] / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    bases = {base.id for base in node.bases if isinstance(base, ast.Name)}
                    if any(issubclass(getattr(builtins, b, int), Exception) for b in bases) or "PalpateError" in bases:
                        yield node.name, bases


def test_every_error_has_the_one_root():
    errors = dict(raised())
    assert len(errors) > 20
    without = {name for name, bases in errors.items() if "PalpateError" not in bases} - {"PalpateError"}
    assert without <= INSIDE | APART, "an error that a user may meet derives from PalpateError"


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
def test_a_command_of_a_group_tells_an_error_in_one_place(case):
    error, code, text, data = CASES[case]
    run = CliRunner().invoke(program(error), ["group", "deep"])
    assert (run.exit_code, run.stderr) == (code, text)
    run = CliRunner().invoke(program(error), ["group", "deep", "--json"])
    assert run.exit_code == code and json.loads(run.stdout) == {"ok": False, **data}
    run = CliRunner().invoke(program(error), ["--debug", "group", "deep"])
    assert run.exception is error


def test_what_typer_itself_says_is_left_to_it():
    run = CliRunner().invoke(program(typer.BadParameter("no such thing")), ["group", "deep"])
    assert run.exit_code == 2 and "no such thing" in run.stderr
    assert CliRunner().invoke(program(typer.Exit(5)), ["group", "deep"]).exit_code == 5
