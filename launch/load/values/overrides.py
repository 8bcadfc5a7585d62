"""Overrides, the texts of `--set`: from Python values, and back to settings."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from palpate.engine.faults import GraphError, Location
from palpate.launch.load.files import TOP, Override
from palpate.launch.load.values.source import YamlSource, parse
from palpate.nodes.base import SettingError, plain
from palpate.physics.errors import ArgumentError

LONG = 80  # longest Python text quoted in a fault


def overrides(given: str | Sequence[str] | Mapping[str, Any]) -> list[str]:
    """Overrides of a text, several texts, or nodes by name with their model or settings. ArgumentError: other types."""
    if isinstance(given, str):
        return [given]
    if isinstance(given, Mapping):
        return [f"{path}={text}" for path, text, _ in _parts(given)]
    if isinstance(given, Sequence) and all(isinstance(text, str) for text in given):
        return list(given)
    raise ArgumentError(
        f"found {given!r}, expected 'tissue.use=deformation.Rigid', a list of such texts, or a dict, "
        "{'tissue': 'deformation.Rigid'}"
    )


def of_keywords(nodes: Mapping[str, str | Mapping[str, Any]]) -> Iterator[Override]:
    """Overrides of the keywords of `palpate.run`; faults quote the Python text. ArgumentError, GraphError."""
    for path, text, python in _parts(nodes):
        value = parse(text, python)
        yield Override(tuple(path.split(".")), YamlSource(value.data, {(): Location(python)}), keyword=True)


def _parts(nodes: Mapping[str, str | Mapping[str, Any]]) -> Iterator[tuple[str, str, str]]:
    """Path and text for `--set` of each value, and the Python text of both."""
    for name, what in nodes.items():
        if name in TOP:
            text = what if isinstance(what, str) else _text(name, what)
            raise ArgumentError(f"{name}: no node has this name; expected sets=['{name}={text}']")
        if isinstance(what, str):
            yield f"{name}.use", what, f"{name}={what!r}"
        elif isinstance(what, Mapping):
            for key, value in what.items():
                if not all(str(key).split(".")):
                    raise ArgumentError(
                        f"{name}: found {key!r}, expected the name of a setting, as in {name}={{'stiffness': 2e3}}"
                    )
                yield f"{name}.{key}", _text(f"{name}.{key}", value), f"{name}={shorten_text(repr({key: value}))}"
        else:
            raise ArgumentError(
                f"{name}: found {what!r}, expected a model, {name}='deformation.ReducedFE', or settings, "
                f"{name}={{'stiffness': 2e3}}"
            )


def shorten_text(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= LONG else f"{line[: LONG - 4]} ..."


def _text(name: str, value: Any) -> str:
    """A value as text for `--set`: texts unchanged, all else as JSON, which is valid YAML."""
    if isinstance(value, str):
        return value
    try:
        return json.dumps(plain(value))
    except TypeError:
        raise ArgumentError(
            f"{name}: found {type(value).__name__}, expected a number, a text, a list or a dict"
        ) from None


def settings_of(sets: list[str]) -> dict[str, Any]:
    """Values by name, from texts "name=value". SettingError: another text, or a value that is not YAML."""
    settings = {}
    for text in sets:
        name, sign, value = text.partition("=")
        if not sign:
            raise SettingError(f"--set {text}: expected name=value")
        try:
            settings[name.removeprefix("tissue.")] = parse(value, f"--set {text}").data
        except GraphError:
            raise SettingError(f"--set {text}: expected a number, a name or a list such as '[0, 0, 0.012]'") from None
    return settings
