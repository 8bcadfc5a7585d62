"""The page of all commands, from their `--help`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import typer
from prose import escaped, table
from typer.core import TyperGroup, TyperOption

from palpate.cli.__main__ import app


def commands() -> str:
    """Each command with its arguments and options."""
    lines = ["# Commands", "", "`palpate COMMAND --help` prints the same.", ""]
    for name, command in _walk(typer.main.get_command(app), "palpate"):
        arguments = [p for p in command.params if not isinstance(p, TyperOption)]
        words = [_argument(p) if p.required else f"[{_argument(p)}]" for p in arguments]
        usage = " ".join([name, *words, "[OPTIONS]"])
        lines += [f"## {name}", "", f"```text\n{usage}\n```", ""]
        lines += [escaped(command.help or "").replace("\n\n", "\0").replace("\n", " ").replace("\0", "\n\n"), ""]
        given = [(f"`{_argument(p)}`", _help(p), _default(p)) for p in arguments]
        lines += table(("argument", "", "default"), given)
        options = [p for p in command.params if isinstance(p, TyperOption) and not p.hidden]
        lines += table(("option", "", "default"), [(_names(p), _help(p), _default(p)) for p in options])
    return "\n".join(lines)


def _walk(group: Any, name: str) -> Iterator[tuple[str, Any]]:
    for key, command in group.commands.items():
        if command.hidden:
            continue
        if isinstance(command, TyperGroup):
            yield from _walk(command, f"{name} {key}")
        else:
            yield f"{name} {key}", command


def _argument(parameter: Any) -> str:
    """As `--help` writes it."""
    return (parameter.metavar or parameter.name).strip("[]").upper()


def _names(option: TyperOption) -> str:
    return ", ".join(f"`{one}`" for one in (*option.opts, *option.secondary_opts))


def _help(parameter: Any) -> str:
    return parameter.help or ""


def _default(parameter: Any) -> str:
    """The default; empty for a flag, and if the help explains the default."""
    value = parameter.default
    if parameter.required:
        return "required"
    return "" if isinstance(value, bool) or callable(value) or value in (None, "", []) else f"`{value}`"
