"""The bodies of a contact of organs, from its setting `bodies`."""

import json
from typing import Any, NamedTuple

from palpate.nodes.base import Node, SettingError
from palpate.nodes.base.surface import OnThinnedSurface
from palpate.physics.geometry.mesh import Mesh


class GivenBody(NamedTuple):
    """A body, and its surface."""

    body: Any
    mesh: Mesh


def _body(name: str) -> Any:
    """The class of a shipped body. SettingError: it is none; the name comes from a graph, a job or a recording."""
    from palpate.nodes import deformation

    found = getattr(deformation, name, None)
    if not (isinstance(found, type) and issubclass(found, Node) and hasattr(found, "between")):
        raise SettingError(f"setting 'bodies': found the class {name!r}, expected a body of palpate.nodes.deformation")
    return found


def given_bodies(text: str) -> list[GivenBody]:
    """The bodies of the setting `bodies`. SettingError: a body or surface cannot be used."""
    if not text:
        raise SettingError("setting 'bodies': empty; a graph that is loaded finds them by its contact.Side")
    try:
        given, found = json.loads(text), []
    except ValueError:
        raise SettingError(
            "setting 'bodies': found no JSON; leave it out, it is set when the graph is loaded"
        ) from None
    surfaces = [OnThinnedSurface(**each["surface"]) for each in given]
    for each, surface in zip(given, surfaces, strict=True):
        if len(surface.mesh().vertices) != len(surface.whole().vertices):
            raise SettingError(
                f"surface {surface.surface!r}: thinned to {1e3 * surface.spacing:.3g} mm, expected all vertices "
                "where organs touch: scene.surface.spacing: 0, or a coarser mesh"
            )
        found.append(GivenBody(_body(each["use"])(**each["settings"]), surface.mesh()))
    return found
