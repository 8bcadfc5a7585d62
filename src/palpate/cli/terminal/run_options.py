"""The options that describe a run, for every command that takes one: GRAPH, --set, --scene, and the file of an organ.

A command takes `chosen: RunOptions` first, marked by `@takes_run()`, and starts with `launch = chosen.launch()`.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, get_type_hints

from palpate.cli.terminal import options

if TYPE_CHECKING:
    from palpate.launch.load.launchfile import LaunchFile


@dataclass(frozen=True)
class RunOptions:
    """The values of these options in a call."""

    graph: options.Graph
    sets: options.Sets = None
    scene: options.SceneOption = None
    organ: options.OrganOption = None
    unit: options.UnitOption = None
    piece: options.PieceOption = None
    label: options.LabelOption = None
    repair: options.RepairOption = False

    def launch(self, place: str | None = None, fused: bool = False, silent: bool = False) -> LaunchFile:
        """The run that they describe. GraphError, MeshError, SettingError: an option or the organ is invalid.

        place, fused  as in `options.choose_launch`;  silent: print no notes on the organ
        """
        chosen = options.choose_launch(self.graph, self.sets, self.scene, place, fused)
        return options.with_organ_file(chosen, self.organ, self.unit, self.piece, self.repair, silent, self.label)


def takes_run(graph: str | None = None) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark of a command whose first argument is `RunOptions`: its help lists these options, then those of the command.
    An argument of the command with the name of one of these options takes its place.

    graph  default of GRAPH; None: it must be given
    """

    def mark(command: Callable[..., None]) -> Callable[..., None]:
        of_run, of_command = _hints(RunOptions), _hints(command)
        names = [f.name for f in fields(RunOptions) if f.name not in of_command]
        first, *others = inspect.signature(command).parameters.values()
        assert of_command[first.name] is RunOptions, command
        defaults = {name: getattr(RunOptions, name, inspect.Parameter.empty) for name in names}
        if graph is not None:
            defaults["graph"] = graph
        given = [inspect.Parameter(n, first.kind, default=defaults[n], annotation=of_run[n]) for n in names]
        given += [each.replace(annotation=of_command[each.name]) for each in others]

        @functools.wraps(command)
        def call(**values: Any) -> None:
            command(RunOptions(**{name: values.pop(name) for name in names}), **values)

        call.__signature__ = inspect.Signature(given)  # type: ignore[attr-defined]
        call.__annotations__ = {each.name: each.annotation for each in given}
        return call

    return mark


def _hints(of: Callable[..., Any]) -> dict[str, Any]:
    return get_type_hints(of, include_extras=True)
