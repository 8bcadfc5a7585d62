"""Arrays of a contact of organs whose candidates follow where these slide (`followed`): room for any cells."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from palpate.nodes.contact.organs.body_side import BodySide
from palpate.physics.bodies.between_bodies import measure_along
from palpate.physics.contact.organs import following
from palpate.physics.contact.organs.between_rows import CONDENSED, SPRINGS, Law, fill_columns
from palpate.physics.contact.organs.candidates import Candidates
from palpate.physics.contact.organs.condensed_fields import gather_all_hats
from palpate.physics.geometry.mesh import Mesh


def make_follow(node: Any, found: Candidates, meshes: tuple[Mesh, Mesh], laws: tuple[Law, Law]) -> None:
    """Let the candidates of a `Between` follow when the organs, of these meshes and laws, slide on each other."""
    node.hold("track", track := following.track(found, *meshes, any(len(law.table) for law in laws)))
    node.hold("tangents", np.zeros((2, 3)))
    _free_borders(node, track)
    for side, name, law, slides in zip(
        ("one", "two"), ("first", "second"), laws, (found.swapped, not found.swapped), strict=True
    ):  # fmt: skip
        node.hold(f"{name}_law", law)
        if law.kind == SPRINGS:
            _free_springs(node, side)
        if not slides:
            _free_cells(node, side, track)
        else:
            _free_shares(node, side, track)
            one, two = found.first.place, found.second.place
            places = (two, one) if found.swapped else (one, two)
            matrix, drags, tangents = (node._held[key] for key in (f"pair.{name}", f"rub.{name}", "rub.tangents"))
            measure_along(law, matrix, drags, places, found.normal, tangents[0], found.area)
        if law.kind == CONDENSED:
            _list_hats(node, side, law, (1 if not slides else 3) * int(np.diff(track.begins).max()))


def keep_columns(state: Any, held: dict[str, np.ndarray], prefix: str, counts: Sequence[int]) -> None:
    """Set in the laws of a `Between`, of this state and with the arrays `held` at a prefix, whether their bodies may
    bear other loads, by the numbers of these. Without, a candidate that moves needs no response to loads. If loads
    are new after a step, the responses of all candidates are computed."""
    for k, (side, name, count) in enumerate(zip(("one", "two"), ("first_law", "second_law"), counts, strict=True)):
        gains = count > 0 and not state[name]["loaded"]
        state[name]["loaded"] = count > 0
        if gains and state["steps"] > 0 and state[name]["kind"] == CONDENSED:
            law, body = _group(Law, name, state, held, prefix), _group(BodySide, side, state, held, prefix)
            fill_columns(law, body, 1.0 - 2.0 * k, held[f"{prefix}rub.tangents"][k])


def _group(form: Any, name: str, state: Any, held: dict[str, np.ndarray], prefix: str) -> Any:
    """A NamedTuple of the state of a node."""
    paths = {field: f"{prefix}{name}.{field}" for field in form._fields}
    return form(*(held[path] if path in held else state[name][field].item() for field, path in paths.items()))


def _list_hats(node: Any, side: str, law: Law, most: int) -> None:
    """The coarse vertices of all candidates, which have at most `most` shares on a condensed organ."""
    count = len(node._held[f"{side}.few"])
    for name, kind in (("coarse", np.int64), ("hats", np.float64)):
        node._hold(node.own[side], name, np.zeros((count, 3 * most), kind), f"{side}.{name}")
    gather_all_hats(law, BodySide(*(node._held[f"{side}.{name}"] for name in BodySide._fields)))


def _free_springs(node: Any, side: str) -> None:
    """Terminals at all vertices of a body of springs."""
    used, size = node._held[f"{side}.weights"][:, 0] > 0.0, len(node._held[f"{side}.corners"])
    for name in ("response", "aside"):
        kept = node._held[f"{side}.{name}"]
        if kept.size:
            every = np.zeros((len(kept), size, 3, kept.shape[2]))
            every[:, used] = kept.reshape(len(kept), -1, 3, kept.shape[2])
            node._hold(node.own[side], name, every.reshape(len(kept), 3 * size, -1), f"{side}.{name}")
    corners = np.zeros((size, 3), np.int64)
    corners[:, 0] = np.arange(size)
    for name, value in (
        ("corners", corners), ("gathered", np.zeros((size, 3))), ("touched", np.zeros((2, size), np.int64)),
    ):  # fmt: skip
        node._hold(node.own[side], name, value, f"{side}.{name}")


def _free_borders(node: Any, track: following.Track) -> None:
    """Room for the borders of candidates in any cells."""
    most = np.sort(np.diff(track.near_at))[-len(track.cell) :].sum() // 2
    for name, value in (("borders", np.zeros((most, 2), np.int64)), ("strips", np.zeros(most))):
        kept = node._held[name]
        value[: len(kept)] = kept
        node.hold(name, value)


def _free_cells(node: Any, side: str, track: following.Track) -> None:
    """The shares of all cells of the surface on which the candidates stay, and room for the load of any."""
    count, most = len(track.cell), int(np.diff(track.begins).max())
    used = min(len(track.vertices), count * most)
    for name, value in (
        ("begins", track.begins[:count].copy()), ("ends", track.begins[1 : count + 1].copy()),
        ("vertices", track.vertices.copy()), ("shares", track.weights.copy()),
        ("nodes", np.zeros(used, np.int32)), ("forces", np.zeros((used, 3))),
    ):  # fmt: skip
        node._hold(node.own[side], name, value, f"{side}.{name}")


def _free_shares(node: Any, side: str, track: following.Track) -> None:
    """Room for the shares of candidates on the body over which they slide: three for each vertex of any cell."""
    count, size = len(track.cell), len(node._held[f"{side}.corners"])
    begins = 3 * int(np.diff(track.begins).max()) * np.arange(count + 1)
    ends = begins[:-1] + np.diff(node._held[f"{side}.begins"])
    vertices, shares = np.zeros(begins[-1], np.int64), np.zeros(begins[-1])
    at = np.concatenate([np.arange(*each) for each in zip(begins, ends, strict=False)])
    vertices[at], shares[at] = node._held[f"{side}.vertices"], node._held[f"{side}.shares"]
    used = min(size, len(vertices))
    for name, value in (
        ("begins", begins), ("ends", ends), ("vertices", vertices), ("shares", shares),
        ("nodes", np.zeros(used, np.int32)), ("forces", np.zeros((used, 3))),
    ):  # fmt: skip
        node._hold(node.own[side], name, value, f"{side}.{name}")
