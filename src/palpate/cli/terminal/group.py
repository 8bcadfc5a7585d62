"""Builds the command line from folders of commands, and prints their errors in red, without traceback."""

import contextlib
import copy
import inspect
import os
import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from importlib import import_module
from types import ModuleType
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from palpate.cli import commands
from palpate.cli.terminal.formatter import import_formatter
from palpate.cli.terminal.output import print_json, say
from palpate.launch.run.interrupts import StoppedError, interrupts, signal_of
from palpate.physics.errors import MISUSE, PalpateError
from palpate.registry import files

SYNONYMS = {
    "plot": "picture", "draw": "picture", "image": "picture", "show": "view", "open": "view", "start": "run",
    "launch": "run", "simulate": "run", "play": "replay", "validate": "check", "convert": "export", "diff": "compare",
    "graphs": "list", "nodes": "list", "describe": "info", "monitor": "top", "optimise": "tune", "optimize": "tune",
    "sweep": "study",
}  # fmt: skip
"""Words of other programs for a command: similar spelling alone suggests `export` for "plot"."""
RETRY = 0.1  # [s] after which a dropped interrupt is sent again


class Verbs(TyperGroup):
    """The command group: errors are printed in red on standard error, without traceback unless `--debug` is given.

    SIGTERM and a closed terminal end a command as Ctrl-C does: by KeyboardInterrupt, so that the command cleans up. It
    prints one line with the notes that the command has added; the exit code is 128 plus the signal's number.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the options; those that install shell completion work, but the help omits them."""
        params = super().get_params(ctx)
        param: Any
        for param in params:
            if param.name in ("install_completion", "show_completion"):
                param.hidden = True
        return params

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find the command; a usage error suggests the one with this meaning, or one with a similar name."""
        if not ctx.resilient_parsing and args[0] in SYNONYMS:
            ctx.fail(f"No such command {args[0]!r}. Did you mean {SYNONYMS[args[0]]!r}?")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: Any) -> Any:
        numbers = [int(signal.SIGINT)]
        try:
            with _interruptible(numbers):
                return super().invoke(ctx)
        except KeyboardInterrupt as error:
            say("; ".join(["stopped", *getattr(error, "__notes__", ())]), "red", err=True)
            raise typer.Exit(128 + (error.number if isinstance(error, StoppedError) else numbers[-1])) from None
        except Exception as error:
            # Print palpate's errors here; leave errors and exits of click to click.
            known = isinstance(error, PalpateError)
            of_click = hasattr(error, "exit_code") or isinstance(error, typer.Abort | BrokenPipeError | EOFError)
            if ctx.params.get("debug") or (of_click and not known):
                raise
            reported = error if isinstance(error, PalpateError) else _of_extra(error) or _Foreign(error)
            if ctx.find_root().meta.get("palpate.json"):
                print_json({"ok": False, **reported.to_spec()})
            else:
                say(reported, "red", err=True)
                if reported.hint:
                    say(reported.hint, "dim", err=True)
            raise typer.Exit(reported.exit_code) from None


@contextlib.contextmanager
def _interruptible(numbers: list[int]) -> Iterator[None]:
    """Raise StoppedError for SIGTERM and SIGHUP, and append their numbers to the list.

    Python discards exceptions raised in some callbacks, so a signal that is lost there is sent again, and raised at the
    latest at the end.
    """
    before, lost = sys.unraisablehook, list[KeyboardInterrupt]()

    def end(number: int) -> None:
        numbers.append(number)
        raise StoppedError(number)

    def handle_unraisable(error: Any) -> None:
        if issubclass(error.exc_type, KeyboardInterrupt):
            lost.append(error.exc_value or KeyboardInterrupt())
            again = threading.Timer(RETRY, os.kill, (os.getpid(), signal_of(lost[-1])))
            again.daemon = True  # do not delay the end of the program
            again.start()
        else:
            before(error)

    sys.unraisablehook = handle_unraisable
    try:
        with interrupts(end, [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]):
            yield
            if lost:
                raise lost[0]
    finally:
        sys.unraisablehook = before


def _of_extra(error: Exception) -> PalpateError | None:
    """The error to print if an optional package is missing."""
    from palpate.physics.extras import extra_of, missing

    extra = extra_of(error.name or "") if isinstance(error, ModuleNotFoundError) else None
    return PalpateError(missing("this command", error.name, extra)) if extra else None  # type: ignore[attr-defined]


class _Foreign(PalpateError):
    """An exception of another library. An unusable file counts as misuse and needs no traceback."""

    def __init__(self, error: Exception) -> None:
        self.name = type(error).__name__
        self.of_file = isinstance(error, OSError) and bool(error.filename and error.strerror)
        text = f"{error.filename}: {error.strerror}" if self.of_file else str(error)  # type: ignore[attr-defined]
        super().__init__(text or "no details available")
        if self.of_file or isinstance(error, FileNotFoundError | FileExistsError):
            self.exit_code = MISUSE

    def __str__(self) -> str:
        return self.args[0] if self.of_file else f"{self.name}: {self.args[0]}"

    @property
    def hint(self) -> str:
        return "" if self.of_file else "`palpate --debug ...` shows the traceback."

    def to_spec(self) -> dict[str, Any]:
        return {"error": self.name, "text": self.args[0]}


class _Commands(Mapping[str, Any]):
    """The commands of a folder by name, each imported and built at its first use: a command needs no other one.

    found  panel of the help, and full name of the module, by name and in order
    """

    def __init__(self, found: dict[str, tuple[str | None, str]]) -> None:
        self._found = found
        self._built: dict[str, Any] = {}

    def __iter__(self) -> Iterator[str]:
        return iter(self._found)

    def __len__(self) -> int:
        return len(self._found)

    def __getitem__(self, name: str) -> Any:
        if name not in self._built:
            panel, place = self._found[name]
            module = import_module(place)
            if hasattr(module, "__path__"):
                app = group(module, module.__doc__, name=name, add_completion=False)
            else:
                app = typer.Typer(add_completion=False)
                app.command(epilog=f"Example: {module.EXAMPLE}")(getattr(module, name))
            command: Any = typer.main.get_command(app)
            command.rich_help_panel = panel
            self._built[name] = command
        return self._built[name]

    def rows(self) -> dict[str, Any]:
        """The commands with the texts of the help's table, but without parameters, which take three times as long to
        build as the rest of the table."""
        rows: dict[str, Any] = {}
        for name, (panel, place) in self._found.items():
            module = import_module(place)
            text = inspect.getdoc(module if hasattr(module, "__path__") else getattr(module, name))
            rows[name] = TyperCommand(name, help=text, rich_help_panel=panel)
        return rows


def group(package: ModuleType, about: str | None, **options: Any) -> typer.Typer:
    """The commands of a folder, see `palpate.cli.commands`, with their help; `options` go to typer."""
    found = {name: (panel, place) for panel, name, place in _commands(package)}
    base: type[TyperGroup] = options.pop("cls", TyperGroup)

    class Ordered(base):  # type: ignore[misc, valid-type]
        def __init__(self, **given: Any) -> None:
            super().__init__(**given)
            self.commands = _Commands(found)

        def list_commands(self, context: Any) -> list[str]:  # typer would list all commands, then all groups
            return list(found)

        def format_help(self, ctx: Any, formatter: Any) -> None:
            import_formatter()
            table: Any = copy.copy(self)
            table.commands = self.commands.rows()
            super(Ordered, table).format_help(ctx, formatter)

    app = typer.Typer(no_args_is_help=True, help=about, cls=Ordered, **options)
    app.callback(help=about)(lambda: None)  # a group of one command stays a group
    return app


def _commands(package: ModuleType, panel: str | None = None) -> Iterator[tuple[str | None, str, str]]:
    """Panel, name and full name of the module of each command of a folder, in the order of the help."""
    order, found = commands.ORDER, {place.rpartition(".")[2]: place for place in files(package)}
    for name in sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name)):
        if package is commands:  # its folders are the groups of the help
            folder = import_module(found[name])
            inside = hasattr(folder, "__path__")
            yield from _commands(folder, folder.__doc__) if inside else [(panel, name, found[name])]
        else:
            yield panel, name, found[name]
