"""Constants of a calibrated tissue model, fitted to a reference body under the scene's own patch, and what is left.

MassSpring's law is that of a ball by default; under a patch of fixed width the force has another shape. The graph's
touch is recorded once, the reference computes it, and of its indentation s and force f at all instants of contact

    MassSpring   f = K s^n (1 + c s')    K, n, c by least squares of f: for each n a linear problem in K and K c >= 0
    BeamBundle   all moduli times (f.s/s.s of the reference)/(f.s/s.s of the bundle as it is, computed beside it)

What the touch is off by with the constants is then measured, before and after: no constant makes the surface of springs
that of a solid.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from palpate.launch.load.launchfile import LaunchFile
from palpate.messages import Contact
from palpate.nodes.deformation import BeamBundle, MassSpring
from palpate.physics.errors import ArgumentError
from palpate.records.changed import changed
from palpate.records.compare import compare
from palpate.records.player import Player
from palpate.studies.known import body_of, own_error
from palpate.studies.search import Show, off_by, touched, write

QUANTITIES = ("force", "indentation", "shape")
LEAST = 20
"""Instants of contact below which nothing is fitted."""


@dataclass(frozen=True)
class FittedBody:
    """The constants as `--set` takes them; what the touch is off by [1], rms over the peak of the reference, and the
    force at worst, by quantity, before and after; and what is known of the reference's own error."""

    overrides: dict[str, Any]
    before: dict[str, float]
    after: dict[str, float]
    reference: str


def fit_body(
    launch: LaunchFile, file: Path, reference: Sequence[str] = (), show: Show = lambda what: None
) -> FittedBody:
    """Fit the graph's body to a reference, by default ReducedFE in its place, and write the launch file.

    reference  overrides that make it

    ArgumentError: a body without constants to fit, a touch without contact.
    """
    graph = launch.load()
    name = body_of(graph)
    cls = graph.nodes[name].cls
    if cls not in (MassSpring, BeamBundle):
        raise ArgumentError(
            f"{graph.path}: node {name!r} is {cls.__name__}, expected one with a constant to calibrate: "
            "deformation.MassSpring or deformation.BeamBundle"
        )
    base = list(reference) or [f"{name}.use=deformation.ReducedFE"]
    with tempfile.TemporaryDirectory() as folder:
        recording = touched(launch, Path(folder) / "touch.mcap")
        show("the touch")
        senders = [sender for sender, spec in graph.nodes.items() if Contact in spec.streams.values()]
        pairs: tuple[list[tuple[float, ...]], ...] = ([], [])

        def on_tick(players: Sequence[Player]) -> None:
            for pair, player in zip(pairs, players, strict=True):
                for sent in (message for sender in senders for message in player.last(sender)):
                    if isinstance(sent, Contact) and sent.force > 0.0 and sent.indentation > 0.0:
                        pair.append((sent.indentation, sent.indentation_rate, sent.force))

        _, first = compare(recording, [[]], reference=base, on_tick=on_tick)
        show("the reference and the model as it is")
        if min(map(len, pairs)) < LEAST:
            raise ArgumentError(f"{graph.path}: the touch hardly presses the body; a longer one may: --duration '3 s'")
        right, own = (np.array(pair) for pair in pairs)
        if cls is MassSpring:
            law: dict[str, Any] = power_law(*right.T)
        else:
            factor = _slope(right) / _slope(own)
            moduli = BeamBundle(**graph.nodes[name].settings).moduli
            law = {"moduli": [float(f"{modulus * factor:.6g}") for modulus in moduli]}
        fitted = {f"{name}.{key}": value for key, value in law.items()}
        _, last = compare(recording, [[f"{key}={value}" for key, value in fitted.items()]], reference=base)
        show("the fitted model")
        known = own_error(changed(recording, base).graph)
    before, after = (
        {q: off_by(one, q) for q in QUANTITIES} | {"worst": off_by(one, "force", "peak")} for one in (first, last)
    )
    told = (
        f"Fitted by palpate fit-body to {' '.join(base)} on this graph's touch. Differences, RMS of its peak:",
        f"  before: {words(before)}",
        f"  after:  {words(after)}",
        known,
    )
    write(launch, fitted, told, file)
    return FittedBody(fitted, before, after, known)


def words(off: dict[str, float]) -> str:
    """The differences by quantity."""
    shares = ", ".join(f"{name} {100 * off[name]:.2g} %" for name in QUANTITIES)
    return f"{shares}; force {100 * off['worst']:.2g} % at worst"


def power_law(depth: np.ndarray, rate: np.ndarray, force: np.ndarray) -> dict[str, Any]:
    """K [N/m^n], n in [1, 3] and c >= 0 [s/m] of f = K s^n (1 + c s') through s [m], s' [m/s] and f [N] (T,)."""
    deepest = float(depth.max())

    def solved(n: float) -> tuple[np.ndarray, float]:
        elastic = (depth / deepest) ** n
        return optimize.nnls(np.stack([elastic, elastic * rate], axis=1), force)

    n = float(optimize.minimize_scalar(lambda n: solved(n)[1], bounds=(1.0, 3.0), method="bounded").x)
    (k, kc), _ = solved(n)
    if not k > 0.0:
        raise ArgumentError("no power law fits the reference's force: it does not rise with its indentation")
    rounded = {"stiffness": k / deepest**n, "exponent": n, "damping": kc / k}
    return {name: float(f"{value:.6g}") for name, value in rounded.items()}


def _slope(pairs: np.ndarray) -> float:
    return float(pairs[:, 2] @ pairs[:, 0] / (pairs[:, 0] @ pairs[:, 0]))
