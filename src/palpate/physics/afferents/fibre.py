"""One afferent: stress at its receptor -> input -> membrane -> spikes, at 5 kHz (docs/equations/afferents.md).

The published fits take the vertical stress s below a probe, and d = E* (du/dt)/z² for the speed du/dt of the skin under
it at the depth z. The inputs here equal them under the probe, for any load and with shear,

    s = |sigma n|,    d = d|E* u|/dt/z²

with the traction on the plane parallel to the surface, and the displacement u of the surface above the receptor: under
a half-space both are sums over the contact, as in the published model of the skin. The other choice of the stimulus is
the stress of a bar with the same strain energy density W, times chi = sigma_z/q under the probe, and d = D ds/dt,

    q = sqrt(2 E W) = sqrt((1 + nu) sigma:sigma - nu tr(sigma)²)

A third-order Butterworth low-pass filter gives s [MPa] and the integral of d; k is the sample. A fibre that adapts
subtracts a share g of its low-pass filtered compression m: r = s - g m, where that is positive or s is negative, and
otherwise 0. The current I changes the membrane potential V,

    m <- m + (s - m) T/tau_m
    I = w(r; 1, 2) + w(d; 3, 4) + w(d_k - d_(k-1); 5, 6) + noise,   w(x; i, j) = w_i x for x >= 0, else -w_j x
    I <- S I/(S + |I|),   V <- V - V/tau + I + a_1 b_1(t) + a_2 b_2(t)

with the time t since the last spike. If V > 1 the fibre fires, at most once in 1.2 ms, and V becomes 0.
"""

import math

import numpy as np

from palpate.compiler.exact import cos, log, sin
from palpate.compiler.fields import element_type
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.records import put, vector
from palpate.physics.afferents.published import ADAPTATION, PROBE, RATE
from palpate.physics.arrays import Array, Matrix, Record

CONSTANTS = {
    "b": (4,), "a": (3,), "static": (2,), "speed": (2,), "change": (2,),
    "dynamic": (), "saturation": (), "noise": (), "leak": (), "after": (2,), "adapts": (), "subtracts": (),
}  # fmt: skip
"""Of a fibre: the filter, b and a; the weights w_1 to w_6 of s, d and the change of d, positive and negative; D [1/mm];
S; standard deviation of the noise; 1/tau; a_1, a_2; T/tau_m; g."""
STATE = {
    "filter": (3,), "path_filter": (3,), "input": (), "speed": (), "potential": (), "adapted": (), "path": (),
    "target": (), "path_target": (),
}  # fmt: skip
"""Of a fibre: the filters of s and of the integral of d; s [MPa], d, V, m, and the filtered integral of d at the last
sample; s and the integral of d before the filter at the end of the last step."""
REFRACTORY = 6  # Minimum number of samples between spikes


def post_spike() -> np.ndarray:
    """b_1 and b_2 (189,2) at each sample since the spike: raised cosines over x = 3 pi/2 ln(1 + t/ms)/ln 9, centred at
    0 and 3 pi/2, with the half width pi."""
    x = 1.5 * math.pi * log(1.0 + np.arange(189) * 1e3 / RATE) / log(np.array(9.0))
    return np.stack([0.5 + 0.5 * cos(np.clip(x - at, -math.pi, math.pi)) for at in (0.0, 1.5 * math.pi)], axis=1)


def probe_gains(depth: np.ndarray, poisson: float) -> tuple[np.ndarray, np.ndarray]:
    """chi [1] and D [1/mm] (n) of receptors at depths [m] (n) on the axis of the probe.

    The stress on the axis of a flat punch of radius a under the force P, with zeta = z/a, is (I. N. Sneddon 1946)

        sigma_z = -P/(2 pi a²) (1 + 3 zeta²)/(1 + zeta²)²,   tr(sigma) = -(1 + nu) P/(pi a² (1 + zeta²))

    The fits use d = E* (du/dt)/z² for the speed du/dt of the punch and s = E* u (1 + 3 zeta²)/(pi a (1 + zeta²)²), in
    mm and MPa; so D = pi a (1 + zeta²)²/((1 + 3 zeta²) z²), independent of the modulus.
    """
    zeta = depth / PROBE
    wide = 1.0 + zeta * zeta
    normal = (1.0 + 3.0 * zeta * zeta) / (wide * wide)
    side = 0.5 * (2.0 * (1.0 + poisson) / wide - normal)
    energy = normal * normal + 2.0 * (1.0 - poisson) * side * side - 4.0 * poisson * normal * side
    return normal / np.sqrt(energy), math.pi * (1e3 * PROBE) / (normal * (1e3 * depth) ** 2)


def constants_of(
    fits: np.ndarray, depth: np.ndarray, poisson: float, kind: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`CONSTANTS` (n), and the factor (n) from q [Pa] to the input [MPa], of fibres with these fits (n,12), depths [m]
    (n) and types (n)."""
    chi, dynamic = probe_gains(depth, poisson)
    angle = math.pi * fits[:, 0] * 10.0 / RATE
    k = sin(angle) / cos(angle)  # prewarped bilinear transform of 1/((s + 1)(s² + s + 1))
    first, second = (1.0 + k, k - 1.0), (1.0 + k + k * k, 2.0 * (k * k - 1.0), 1.0 - k + k * k)
    a = [sum(first[i] * second[j] for i in range(2) for j in range(3) if i + j == n) for n in range(4)]
    made = np.zeros(len(fits), element_type(CONSTANTS))
    made["b"] = np.stack([weight * k * k * k / a[0] for weight in (1.0, 3.0, 3.0, 1.0)], axis=1)
    made["a"] = np.stack([each / a[0] for each in a[1:]], axis=1)
    made["static"], made["speed"], made["change"] = fits[:, 1:3], fits[:, 3:5], fits[:, 5:7]
    made["dynamic"], made["saturation"], made["noise"] = dynamic, fits[:, 7], fits[:, 8]
    made["leak"], made["after"] = 1.0 / fits[:, 9], fits[:, 10:12]
    slow, made["subtracts"] = np.array(ADAPTATION)[kind].T
    made["adapts"] = 1.0 / (slow * RATE)
    return made, 1e-6 * chi


@kernel
def _noise(key: int, sample: int):
    """A random number of mean 0 and variance 1 for a fibre's key and a sample: the sum of four uniform ones from the
    stateless mixer SplitMix64 (G. L. Steele et al., 2014), so that it does not depend on the history."""
    z = np.uint64(key) + np.uint64(sample) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    low = np.uint64(0xFFFF)
    total = (z & low) + ((z >> np.uint64(16)) & low) + ((z >> np.uint64(32)) & low) + (z >> np.uint64(48))
    return (float(total) - 131070.0) / 37837.22755  # sd of four uniform integers below 65536


@kernel
def _weighted_input(x: float, weights: Array):
    return weights[0] * x if x >= 0.0 else -weights[1] * x


@ieee_kernel
def advance(
    fibre: Record,
    state: Record,
    since: int,
    basis: Matrix,
    key: int,
    sample: int,
    count: int,
    first: float,
    stride: float,
    target: float,
    moved: float,
):
    """Advance a fibre by `count` <= 62 samples. Returns a bit mask of those with a spike, and samples since the last.

    fibre, state  `CONSTANTS` and `STATE`;  since: samples since its last spike
    first        position of the first sample between the last input (0) and `target` (1);  stride: between samples
    target       [MPa] s before the filter at the end;  moved: [MPa/mm] integral of d before the filter at the end
    """
    fired, before, step = 0, state.target, target - state.target
    resting, path = state.path_target, moved - state.path_target
    (p0, p1, p2), w, (z0, z1, z2) = vector(state.path_filter), state.path, vector(state.filter)
    s, d, v, m = state.input, state.speed, state.potential, state.adapted
    b0, b1, b2, b3 = fibre.b[0], fibre.b[1], fibre.b[2], fibre.b[3]
    a1, a2, a3 = vector(fibre.a)
    passed = since
    for k in range(count):
        # Butterworth filter (transposed direct form II) of s and of the integral of d, and d from the latter
        x = before + step * (first + k * stride)
        y = b0 * x + z0
        z0 = b1 * x - a1 * y + z1
        z1 = b2 * x - a2 * y + z2
        z2 = b3 * x - a3 * y
        x = resting + path * (first + k * stride)
        out = b0 * x + p0
        p0 = b1 * x - a1 * out + p1
        p1 = b2 * x - a2 * out + p2
        p2 = b3 * x - a3 * out
        speed = (out - w) * RATE
        w = out
        # adaptation, and the current of the inputs
        m += fibre.adapts * (y - m)
        static = max(y - fibre.subtracts * m, min(y, 0.0))
        current = (
            _weighted_input(static, fibre.static)
            + _weighted_input(speed, fibre.speed)
            + _weighted_input(speed - d, fibre.change)
        )
        s, d = y, speed
        current += fibre.noise * _noise(key, sample + k)
        # saturation, and the currents after a spike
        if fibre.saturation > 0.0:
            current *= fibre.saturation / (fibre.saturation + abs(current))
        if passed < len(basis):
            current += fibre.after[0] * basis[passed, 0] + fibre.after[1] * basis[passed, 1]
            passed += 1
        # membrane, and spike
        v += current - v * fibre.leak
        if v > 1.0 and passed >= REFRACTORY:
            fired |= 1 << k
            v, passed = 0.0, 0
    put(state.filter, (z0, z1, z2))
    put(state.path_filter, (p0, p1, p2))
    state.input, state.speed, state.potential, state.adapted, state.path = s, d, v, m, w
    return fired, passed
