"""From folders of commands to the command line."""

from __future__ import annotations

from types import ModuleType

import typer

from palpate.registry import modules


def group(package: ModuleType, **options: object) -> typer.Typer:
    """The commands of a folder that has a `HELP`, see `palpate.launch.commands`; `options` go to typer."""
    app = typer.Typer(no_args_is_help=True, help=package.HELP, **options)  # type: ignore[arg-type]
    app.callback(help=package.HELP)(lambda: None)  # a group of one command stays a group
    order = list(getattr(package, "ORDER", ()))
    found = commands(package)
    for name in sorted(found, key=lambda name: (order.index(name) if name in order else len(order), name)):
        if hasattr(found[name], "HELP"):
            app.add_typer(group(found[name]), name=name)
        else:
            app.command(cls=getattr(found[name], "Command", None))(getattr(found[name], name))
    return app


def commands(package: ModuleType) -> dict[str, ModuleType]:
    """The commands of a folder by name: files, and folders with a `HELP`; other folders only keep files apart."""
    found: dict[str, ModuleType] = {}
    for name, module in modules(package).items():
        if hasattr(module, "__path__") and not hasattr(module, "HELP"):
            found |= commands(module)
        else:
            found[name] = module
    return found
