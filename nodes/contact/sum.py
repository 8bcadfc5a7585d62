"""One finger that meets several organs."""

import math
from typing import Annotated

from palpate.messages import Contact, Friction, Vector3
from palpate.nodes.base import Node, Wants


class Sum(Node):
    """What one finger feels of several organs, as one contact and one friction: forces add up.

    Each organ has a collision, contact, spread and body of its own. Where one presses, that is the contact. Where
    several do, force and normal are those of F = sum f_i n_i, the lengths are means weighted with f_i, what is stored
    adds up, and foot is that of the one that presses most. Organs do not touch each other.
    """

    def step(
        self, contact: list[Contact], friction: Annotated[list[Friction | None], Wants("force")]
    ) -> tuple[Contact, Friction]:
        rubbed: Vector3 = (0.0, 0.0, 0.0)
        for rubbing in friction:
            if rubbing is not None:
                rubbed = _plus(rubbed, rubbing.force)
        total = along = (0.0, 0.0, 0.0)
        most, lengths, whole, pressing, stored = contact[0], [0.0] * 4, 0.0, 0, 0.0
        for one in contact:
            f = one.force
            most = one if f > most.force else most
            pressing += f > 0.0
            whole += f
            total, along = _plus(total, one.normal, f), _plus(along, one.lateral_force)
            own = one.compression, one.indentation, one.compression_rate, one.indentation_rate
            lengths = [mean + f * length for mean, length in zip(lengths, own, strict=True)]
            stored += one.stored[0] if one.stored else 0.0
        sliding = Friction(force=rubbed, bristle=(0.0, 0.0, 0.0), stick=False)
        if pressing < 2:
            return most, sliding
        force = math.hypot(*total)
        compression, indentation, compression_rate, indentation_rate = (length / whole for length in lengths)
        return Contact(
            foot=most.foot,
            normal=(total[0] / force, total[1] / force, total[2] / force) if force > 0.0 else most.normal,
            force=force,
            compression=compression,
            indentation=indentation,
            compression_rate=compression_rate,
            indentation_rate=indentation_rate,
            lateral_force=along,
            stored=(stored,) if most.stored else (),
        ), sliding


def _plus(a: Vector3, b: Vector3, scale: float = 1.0) -> Vector3:
    return a[0] + scale * b[0], a[1] + scale * b[1], a[2] + scale * b[2]
