"""Priors of the free parameters of a fit: what is known of them without the recordings.

A prior adds the residual (x - m)/s to the least squares, with x the value of a normal prior and its logarithm of a
log-normal one. The weighted residuals of the fields have the variance v and are correlated over tau rows, so their
squares count as 1/(v tau) each. The row of the prior is therefore multiplied by sqrt(v tau), and the covariance of the
unknowns is

    C = (G J'J G + P)^-1,     G_ii = sqrt((J'J)^-1_ii / C0_ii),     P = diag (d((x - m)/s) / du)^2,

with C0 the covariance without priors, and u the search coordinate (A. Tarantola, Inverse Problem Theory, SIAM 2005,
chapter 3.2).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from palpate.engine.faults import NOWHERE, choices
from palpate.engine.graph import Graph
from palpate.gradients.parameters import Parameter
from palpate.launch.load.tissues import deviation_of, settings, tissues
from palpate.models.fit.tissue.estimate import LEVEL, Estimate
from palpate.models.fit.tissue.rigs import Parameter as Unknown
from palpate.physics.errors import ArgumentError
from palpate.units.quantity import UnitError, convert, is_quantity

FORMS = "normal:MEAN,DEVIATION, lognormal:MEDIAN,FACTOR, or a tissue of `palpate list tissues`"
ALONE = 0.9  # [1] Share of the prior in the information on a parameter, above which a note says so


@dataclass(frozen=True)
class Prior:
    """A normal prior with mean `middle` and standard deviation `spread`, or a log-normal one with median `middle` and
    the standard deviation `spread` of the logarithm."""

    log: bool
    middle: float
    spread: float

    def row(self, p: Unknown, u: float) -> tuple[float, float]:
        """Residual (x - m)/s at a search coordinate, and its derivative."""
        value = p.value(u)
        if self.log:
            return math.log(value / self.middle) / self.spread, (1.0 if p.log else 1.0 / value) / self.spread
        return (value - self.middle) / self.spread, (value if p.log else 1.0) / self.spread


class Priors:
    """The priors of the unknowns of a fit.

    parameters  the unknowns;  known  their priors, None: none
    weight      [1] sqrt(v tau) of the residuals of the fields
    quantiles   (n) [1] half of a 95 % interval over the standard error, after `combine`: that of Student's t for the
                recordings, and of the normal distribution for a prior, by their shares in the information
    """

    def __init__(self, parameters: Sequence[Unknown], known: Sequence[Prior | None], weight: float) -> None:
        self.parameters, self.known, self.weight = parameters, known, weight
        self.quantiles = np.zeros(len(parameters))

    def residuals(self, x: np.ndarray) -> np.ndarray:
        """(priors) at unknowns (n)."""
        return np.array([self.weight * prior.row(p, u)[0] for p, prior, u in self._rows(x)])

    def slopes(self, x: np.ndarray) -> np.ndarray:
        """(priors, n) Derivatives of the residuals."""
        found = np.zeros((sum(prior is not None for prior in self.known), len(x)))
        places = [k for k, prior in enumerate(self.known) if prior is not None]
        for row, (place, (p, prior, u)) in enumerate(zip(places, self._rows(x), strict=True)):
            found[row, place] = self.weight * prior.row(p, u)[1]
        return found

    def middles(self, x: np.ndarray) -> np.ndarray:
        """Unknowns (n) with those that have a prior at its middle."""
        found = x.copy()
        for k, (p, prior) in enumerate(zip(self.parameters, self.known, strict=True)):
            if prior is not None:
                found[k] = p.to_search(prior.middle)
        return found

    def _rows(self, x: np.ndarray) -> list[tuple[Unknown, Prior, float]]:
        return [
            (p, prior, float(u)) for p, prior, u in zip(self.parameters, self.known, x, strict=True)
            if prior is not None
        ]  # fmt: skip

    def combine(self, fitted: Estimate, slopes: np.ndarray) -> list[str]:
        """Change errors, correlation and intervals of a fit to those with the priors; returns notes.

        slopes  (rows, n) derivatives of the weighted fields
        """
        information = slopes.T @ slopes
        scale = np.linalg.norm(slopes, axis=0)
        scale[scale == 0.0] = 1e-12
        _, sizes, turn = np.linalg.svd(slopes / scale, full_matrices=False)
        plain = np.sum((turn.T / np.maximum(sizes, 1e-9 * max(sizes[0], 1e-300))) ** 2, axis=1) / scale**2
        grown = np.sqrt(plain) / np.maximum(fitted.errors, 1e-300)
        own = np.sum((self.slopes(fitted.at) / self.weight) ** 2, axis=0)
        whole = grown[:, None] * information * grown + np.diag(own)
        unit = np.sqrt(np.maximum(np.diag(whole), 1e-300))
        covariance = np.linalg.pinv(whole / np.outer(unit, unit), rcond=1e-15) / np.outer(unit, unit)
        fitted.errors = np.sqrt(np.diag(covariance))
        fitted.correlation = covariance / np.outer(fitted.errors, fitted.errors)
        shares, notes = own * fitted.errors**2, []
        normal = float(norm.ppf(0.5 + LEVEL / 2))
        wide = float(student.ppf(0.5 + LEVEL / 2, fitted.effective[0] - len(fitted.at)))
        self.quantiles = shares * normal + (1.0 - shares) * wide
        for k, (p, prior) in enumerate(zip(self.parameters, self.known, strict=True)):
            reach = float(self.quantiles[k] * fitted.errors[k])
            at, interval = float(fitted.at[k]), fitted.intervals[p.name]
            if prior is not None and p.log and not prior.log:  # normal in the value, as the prior is
                ends = [interval.value * (1.0 - reach), interval.value * (1.0 + reach)]
            else:
                ends = [p.value(at - reach), p.value(at + reach)]
            interval.low, interval.high = max(ends[0], p.low), min(ends[1], p.high)
            if shares[k] > ALONE:
                notes.append(f"{p.name}: the interval is that of its prior; the recordings add almost nothing")
        return notes


def read_priors(texts: Sequence[str], parameters: Sequence[Parameter], graph: Graph) -> dict[str, Prior]:
    """Priors by path, from texts "tissue.stiffness=normal:200,30". ArgumentError: one is not valid."""
    known, found = {each.path: each for each in parameters}, dict[str, Prior]()
    for text in texts:
        path, _, form = (part.strip() for part in text.partition("="))
        where = f"--prior {text}"
        if path not in known:
            raise ArgumentError(f"{where}: found {path!r}, expected one of the free parameters: {', '.join(known)}")
        if path in found:
            raise ArgumentError(f"{where}: {path} has a prior already, expected one")
        kind, colon, numbers = form.partition(":")
        if colon or kind in ("normal", "lognormal", ""):
            found[path] = _of_numbers(where, known[path], kind.strip(), numbers)
        else:
            found[path] = _of_tissue(where, known[path], kind, graph)
    return found


def _of_numbers(where: str, parameter: Parameter, kind: str, numbers: str) -> Prior:
    """ArgumentError: an unknown distribution, or not two numbers in its range."""
    parts = [part.strip() for part in numbers.split(",")]
    if kind not in ("normal", "lognormal") or len(parts) != 2:
        raise ArgumentError(f"{where}: expected {FORMS}")
    units = parameter.unit, "1" if kind == "lognormal" else parameter.unit
    try:
        middle, spread = (
            convert(part, unit) if is_quantity(part) and unit else float(part)
            for part, unit in zip(parts, units, strict=True)
        )
    except (UnitError, ValueError) as error:
        raise ArgumentError(f"{where}: {error}; expected {FORMS}") from None
    if not (math.isfinite(middle) and math.isfinite(spread)):
        raise ArgumentError(f"{where}: found {numbers}, expected finite numbers")
    if kind == "normal" and spread > 0.0:
        return Prior(False, middle, spread)
    if kind == "lognormal" and spread > 1.0 and middle > 0.0:
        return Prior(True, middle, math.log(spread))
    raise ArgumentError(
        f"{where}: found {numbers}, expected a positive deviation, or a median above 0 and a factor above 1"
    )


def _of_tissue(where: str, parameter: Parameter, name: str, graph: Graph) -> Prior:
    """The log-normal prior with the published mean and standard deviation of a tissue.

    ArgumentError: there is no such tissue or spread, or the tissue does not determine the setting.
    """
    records = tissues()[0]
    if name not in records:
        raise ArgumentError(f"{where}: expected {FORMS}; no tissue {name!r}. {choices('Tissues', name, records)}")
    record, values, setting = records[name], settings(name, NOWHERE), parameter.target.rpartition(".")[2]
    ratio = deviation_of(record)
    if not ratio or len(record["parameters"]) != 1:
        raise ArgumentError(f"{where}: {name} has no published standard deviation of one modulus; expected {FORMS}")
    node = graph.nodes.get(parameter.node)
    unlike = node is not None and node.settings.get("exponent", 1.0) != values.get("exponent", 1.0)
    if setting not in values or setting == "exponent" or (setting == "stiffness" and unlike):
        why = f"exponent {values['exponent']:g}" if setting == "stiffness" else f"{', '.join(values)}"
        raise ArgumentError(f"{where}: the published modulus of {name} determines {why}, not this setting")
    mean = values[setting]
    for key in parameter.inside:
        mean = mean[key]
    return Prior(True, float(mean) / math.sqrt(1.0 + ratio**2), math.sqrt(math.log(1.0 + ratio**2)))


def check_range(parameters: Sequence[Unknown], known: Mapping[int, Prior]) -> None:
    """ArgumentError: the middle of a prior lies outside the range of the search, or the parameter may be negative."""
    for k, prior in known.items():
        p = parameters[k]
        if not p.low <= prior.middle <= p.high:
            raise ArgumentError(f"--prior {p.name}: found the middle {prior.middle:g} {p.unit}, expected one within "
                                f"the range of the search, {p.low:.4g} to {p.high:.4g}")  # fmt: skip
        if prior.log and p.low < 0.0:
            raise ArgumentError(
                f"--prior {p.name}: found a log-normal prior, but this setting may be negative; expected normal"
            )
