"""The five regression curves of the probabilistic force model: force, or its standard deviation, against depth.

A model is y = basis(x; q) @ p: linear in the parameters p, nonlinear in the parameters q (none, one or two); x [m] (n)
is the depth. `models.fit.curve_fit` fits them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from palpate.compiler.exact import cos, exp, power, sin
from palpate.physics.arrays import Numbers, Vector


@dataclass(frozen=True)
class ForceModel:
    """One curve.

    slopes      (x, *q) -> the derivative of these columns by each nonlinear parameter
    start       x -> start values of the search for each nonlinear parameter; the first and last are its limits
    """

    name: str  # as in files and tables
    formula: str  # human-readable; d is the depth
    linear: dict[str, str]  # name -> unit of the linear parameters
    basis: Callable[..., list[np.ndarray]]  # (x, *q) -> a column per linear parameter; broadcasts over grids of q
    nonlinear: dict[str, str] = field(default_factory=dict)  # name -> unit of the others, q
    slopes: Callable[..., list[list[np.ndarray]]] = lambda x: []
    start: Callable[[np.ndarray], list[np.ndarray]] = lambda x: []

    @property
    def parameters(self) -> dict[str, str]:
        return self.linear | self.nonlinear

    def __call__(self, depth: Numbers, parameters: Vector) -> np.ndarray:
        """y at each depth [m] (...)."""
        depth = np.asarray(depth, float)
        return self.predict(depth.ravel(), np.asarray(parameters, float)).reshape(depth.shape)

    def predict(self, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        p, q = np.split(parameters, [len(self.linear)])
        return np.sum(np.stack(self.basis(x, *q), axis=-1) * p, axis=-1)

    def jacobian(self, x: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """dy/d(parameters) (n, number of parameters)."""
        p, q = np.split(parameters, [len(self.linear)])
        bent = [np.sum(np.stack(columns, axis=-1) * p, axis=-1) for columns in self.slopes(x, *q)]
        return np.stack([*self.basis(x, *q), *bent], axis=-1)


def _span(x: np.ndarray) -> float:
    """The deepest indentation [m], the scale of the searches."""
    return float(np.max(np.abs(x))) or 1.0


def _gauss(x: np.ndarray, q: float, w: float) -> np.ndarray:
    return exp(-(((x - q) / w) ** 2))


MODELS = {model.name: model for model in (
    ForceModel("linear", "m d + n", {"m": "N/m", "n": "N"}, lambda x: [x, np.ones(len(x))]),
    ForceModel(
        "quadratic", "k1 d² + k2 d + k3", {"k1": "N/m^2", "k2": "N/m", "k3": "N"},
        lambda x: [x ** 2, x, np.ones(len(x))],
    ),
    # the data cover 1/3 of a period, so omega needs limits: a constant and a long wave are nearly equivalent
    ForceModel(
        "fourier", "a0 + a1 cos(omega d) + b1 sin(omega d)", {"a0": "N", "a1": "N", "b1": "N"},
        lambda x, w: [np.ones_like(w * x), cos(w * x), sin(w * x)],
        {"omega": "1/m"},
        lambda x, w: [[np.zeros(len(x)), -x * sin(w * x), x * cos(w * x)]],
        lambda x: [np.linspace(50.0, 1200.0, 231)],
    ),
    ForceModel(
        "gaussian", "p exp(-((d - q)/w)²)", {"p": "N"}, lambda x, q, w: [_gauss(x, q, w)], {"q": "m", "w": "m"},
        lambda x, q, w: [
            [_gauss(x, q, w) * 2.0 * (x - q) / w**2],
            [_gauss(x, q, w) * 2.0 * (x - q) ** 2 / (w * w * w)],
        ],
        lambda x: [
            x.min() + _span(x) * np.linspace(-10.0, 10.0, 81), _span(x) * power(10.0, np.linspace(-1.0, 1.0, 25))
        ],
    ),
    ForceModel(
        "exponential", "a exp(b d)", {"a": "N"}, lambda x, b: [exp(b * x)], {"b": "1/m"},
        lambda x, b: [[x * exp(b * x)]],
        lambda x: [np.linspace(-20.0, 20.0, 321) / _span(x)],
    ),
)}  # fmt: skip
"""The regression curves by name."""
