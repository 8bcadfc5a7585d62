"""Forward sensitivity of the series contact and of the laws in it.

With one common force f = F1(x; theta) = F2(s; theta), x + s = e, a parameter p of anything before the contact gives

    df/dp = (F2' (F1' de/dp + A1) + F1' A2)/(F1' + F2'),    ds/dp = (df/dp - A2)/F2',    dx/dp = de/dp - ds/dp

F1', F2' [N/m] are slopes at the root; A1 and A2 [N/p] sum what the numbers of each law change its force by: parameters,
and the state at the end of the last step, whose derivatives are carried along.

Derivatives are arrays (P,), one entry for each parameter.
"""

import math

import numpy as np

from palpate.physics.contact.series import EXPONENTIAL, POWER, ElasticLaw, elastic
from palpate.physics.contact.terminal import Terminal, terminal_force


def finger_partials(law: ElasticLaw, s: float) -> np.ndarray:
    """dg/d(first, second, radius) (3,) of an elastic law g [N] at the compression s [m]; zero for s <= 0."""
    if not s > 0.0:
        return np.zeros(3)
    kind, first, second, radius = law
    g = float(elastic(s, kind, first, second, radius)[0])
    if kind == POWER:
        return np.array([g / first, g * math.log(s), 0.0])
    grown = s * math.exp(second * s)
    if kind == EXPONENTIAL:
        return np.array([g / first, (first * grown - g) / second, 0.0])
    scale = 8.0 * first / (3.0 * second) * math.sqrt(radius * s) * s
    return np.array([g / first, scale * grown - g / second, 0.5 * g / radius])


def terminal_partials(s: float, dt: float, law: Terminal) -> np.ndarray:
    """dF/d(K, n, c, s_free, s_prev) (5,) of a terminal law at the indentation s [m] and a step of dt [s]; zero where it
    does not press."""
    k, n, c, free, previous = law
    x, rate = s - free, 1.0 + c * (s - previous) / dt
    if x <= 0.0 or rate <= 0.0:
        return np.zeros(5)
    power: float = x**n
    elastic = k * power
    return np.array(
        [
            power * rate,
            elastic * math.log(x) * rate,
            elastic * (s - previous) / dt,
            -n * elastic / x * rate,
            -elastic * c / dt,
        ]
    )


def recovered(dt: float, law: Terminal, dlaw: np.ndarray) -> np.ndarray:
    """(P,) Derivative of `free_recovery`, max(s_free, s_prev - T/c), by that of the law's numbers (5,P)."""
    _, _, c, free, previous = law
    if c > 0.0 and previous - dt / c > free:
        return dlaw[4] + dt / c**2 * dlaw[2]
    return dlaw[3]


def pressed(s: float, dt: float, law: Terminal, dlaw: np.ndarray, dforce: np.ndarray) -> np.ndarray:
    """(P,) Derivative of `indentation`, the root of F(s) = force > 0, by those of law (5,P) and force (P,)."""
    slope = terminal_force(s, dt, *law)[1]
    return (dforce - terminal_partials(s, dt, law) @ dlaw) / slope


class SeriesTangent:
    """Derivatives of force, compression and indentation of `contact.Series`, carried from step to step.

    finger   the fingertip's law, c1 [s/m] its damping
    dfinger  (4,P)  derivatives of its first, second and third number, and of c1, by each parameter
    """

    def __init__(self, finger: ElasticLaw, damping: float, dfinger: np.ndarray) -> None:
        self.finger, self.damping, self.dfinger = finger, damping, dfinger
        self.before = 0.0
        self.dbefore = np.zeros(dfinger.shape[1])

    def step(
        self,
        force: float,
        x: float,
        s: float,
        dt: float,
        body: Terminal | None,
        dbody: np.ndarray,
        dapproach: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """df, dx, ds (P,) of a step of dt [s] that came out at force [N], compression x [m] and indentation s [m].

        body, dbody (5,P)  the law that it was solved against; None: there was none
        dapproach (P,)     of the approach e
        """
        before, dbefore, c = self.before, self.dbefore, self.damping
        zero = np.zeros_like(dbefore)
        if body is None or not force > 0.0:
            own = Terminal(1.0, 1.0, c, 0.0, before)
            dx = recovered(dt, own, np.array([zero, zero, self.dfinger[3], zero, dbefore]))
            df, ds = zero, zero if body is None else recovered(dt, body, dbody)
        else:
            g, g1 = elastic(x, *self.finger)
            rate = max(0.0, 1.0 + c * (x - before) / dt)
            slope1, slope2 = g1 * rate + g * c / dt, terminal_force(s, dt, *body)[1]
            a1 = rate * (finger_partials(self.finger, x) @ self.dfinger[:3])
            a1 += g / dt * ((x - before) * self.dfinger[3] - c * dbefore)
            a2 = terminal_partials(s, dt, body) @ dbody
            df = (slope2 * (slope1 * dapproach + a1) + slope1 * a2) / (slope1 + slope2)
            ds = (slope1 * dapproach + a1 - a2) / (slope1 + slope2)
            dx = dapproach - ds
        self.before, self.dbefore = x, dx
        return df, dx, ds
