"""Curves of force, and of its standard deviation, against indentation depth.

A model is y = basis(x; q) @ p: linear in the parameters p, not in the parameters q (none, one or two of them).
`physics.curve_fit` fits them. The first column of x [m] (n,k) is the depth, the second, where a law needs it, its
rate of change [m/s].

MODELS are the five regression curves of the probabilistic force model, LAWS the contact laws of this package.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.physics.exact import exp, expm1, power


@dataclass(frozen=True)
class ForceModel:
    """One curve.

    name        as it stands in files and tables
    formula     for people, d being the depth
    linear      name -> unit of the linear parameters
    basis       (x, *q) -> a column per linear parameter; broadcasts over grids of q
    nonlinear   name -> unit of the others, q
    slopes      (x, *q) -> for each nonlinear parameter the derivative of these columns
    start       x -> for each nonlinear parameter the values that the search starts from; its ends are the limits
    columns     how many columns of x the model reads
    """

    name: str
    formula: str
    linear: dict[str, str]
    basis: Callable[..., list[np.ndarray]]
    nonlinear: dict[str, str] = field(default_factory=dict)
    slopes: Callable[..., list[list[np.ndarray]]] = lambda x: []
    start: Callable[[np.ndarray], list[np.ndarray]] = lambda x: []
    columns: int = 1

    @property
    def parameters(self) -> dict[str, str]:
        """Name -> unit of all parameters, the linear ones first."""
        return self.linear | self.nonlinear

    def __call__(self, depth, parameters, rate=None) -> np.ndarray:
        """y at each depth [m] (...), and rate [m/s] (...) where the model has one."""
        depth = np.asarray(depth, float)
        x = [depth.ravel()] if rate is None else [depth.ravel(), np.broadcast_to(rate, depth.shape).ravel()]
        return self.predict(np.stack(x, axis=1), np.asarray(parameters, float)).reshape(depth.shape)

    def predict(self, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """y (n) at x (n,k)."""
        p, q = np.split(parameters, [len(self.linear)])
        return np.sum(np.stack(self.basis(x, *q), axis=-1) * p, axis=-1)

    def jacobian(self, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """dy/d(parameters) (n, number of parameters)."""
        p, q = np.split(parameters, [len(self.linear)])
        bent = [np.stack(columns, axis=-1) @ p for columns in self.slopes(x, *q)]
        return np.stack([*self.basis(x, *q), *bent], axis=-1)


def _span(x: np.ndarray) -> float:
    """The deepest indentation [m], the scale of the searches."""
    return float(np.max(np.abs(x[:, 0]))) or 1.0


def _power(x: np.ndarray, n) -> np.ndarray:
    return power(x[:, 0], n)


def _power_slope(x: np.ndarray, n) -> np.ndarray:
    d = x[:, 0]
    return np.where(d > 0, d**n * np.log(np.where(d > 0, d, 1.0)), 0.0)


def _gauss(x: np.ndarray, q, w) -> np.ndarray:
    return exp(-(((x[:, 0] - q) / w) ** 2))


def _pad(x: np.ndarray, m) -> np.ndarray:
    return expm1(m * x[:, 0]) / m


def _by_name(*models: ForceModel) -> dict[str, ForceModel]:
    return {model.name: model for model in models}


MODELS = _by_name(
    ForceModel("linear", "m d + n", {"m": "N/m", "n": "N"}, lambda x: [x[:, 0], np.ones(len(x))]),
    ForceModel(
        "quadratic", "k1 d² + k2 d + k3", {"k1": "N/m^2", "k2": "N/m", "k3": "N"},
        lambda x: [x[:, 0] ** 2, x[:, 0], np.ones(len(x))],
    ),
    # The data cover a third of a period, so the limits of omega matter: a constant and a long wave trade off.
    ForceModel(
        "fourier", "a0 + a1 cos(omega d) + b1 sin(omega d)", {"a0": "N", "a1": "N", "b1": "N"},
        lambda x, w: [np.ones_like(w * x[:, 0]), np.cos(w * x[:, 0]), np.sin(w * x[:, 0])],
        {"omega": "1/m"},
        lambda x, w: [[np.zeros(len(x)), -x[:, 0] * np.sin(w * x[:, 0]), x[:, 0] * np.cos(w * x[:, 0])]],
        lambda x: [np.linspace(50.0, 1200.0, 231)],
    ),
    ForceModel(
        "gaussian", "p exp(-((d - q)/w)²)", {"p": "N"}, lambda x, q, w: [_gauss(x, q, w)], {"q": "m", "w": "m"},
        lambda x, q, w: [
            [_gauss(x, q, w) * 2.0 * (x[:, 0] - q) / w**2],
            [_gauss(x, q, w) * 2.0 * (x[:, 0] - q) ** 2 / w**3],
        ],
        lambda x: [x[:, 0].min() + _span(x) * np.linspace(-10.0, 10.0, 81), _span(x) * np.geomspace(0.1, 10.0, 25)],
    ),
    ForceModel(
        "exponential", "a exp(b d)", {"a": "N"}, lambda x, b: [exp(b * x[:, 0])], {"b": "1/m"},
        lambda x, b: [[x[:, 0] * np.exp(b * x[:, 0])]],
        lambda x: [np.linspace(-20.0, 20.0, 321) / _span(x)],
    ),
)  # fmt: skip
"""The regression curves by name."""

LAWS = _by_name(
    ForceModel("hertz", "K d^1.5", {"K": "N/m^1.5"}, lambda x: [_power(x, 1.5)]),
    ForceModel(
        "power", "K d^n", {"K": "N/m^n"}, lambda x, n: [_power(x, n)], {"n": "1"},
        lambda x, n: [[_power_slope(x, n)]],
        lambda x: [np.linspace(1.0, 3.0, 41)],
    ),
    ForceModel(
        "exponential", "(b/m) (exp(m d) - 1)", {"b": "N/m"}, lambda x, m: [_pad(x, m)], {"m": "1/m"},
        lambda x, m: [[(x[:, 0] * np.exp(m * x[:, 0]) - _pad(x, m)) / m]],
        lambda x: [np.geomspace(1e-3, 50.0, 121) / _span(x)],
    ),
    # lambda = c K keeps the law linear in two parameters; c follows as their ratio.
    ForceModel(
        "hunt-crossley", "K d^n (1 + c d'),  c = lambda/K", {"K": "N/m^n", "lambda": "N s/m^(n+1)"},
        lambda x, n: [_power(x, n), _power(x, n) * x[:, 1]],
        {"n": "1"},
        lambda x, n: [[_power_slope(x, n), _power_slope(x, n) * x[:, 1]]],
        lambda x: [np.linspace(1.0, 3.0, 41)],
        columns=2,
    ),
)  # fmt: skip
"""The contact laws by name."""
