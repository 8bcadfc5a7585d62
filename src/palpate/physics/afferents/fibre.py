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
from palpate.compiler.kernel import kernel
from palpate.physics.afferents.published import ADAPTATION, PROBE, RATE

STATE = 13  # Filter of s (3), s, d, V, last input, m; filter of the integral of d (3), its output and last input
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


def rows(fits: np.ndarray, depth: np.ndarray, poisson: float, kind: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Constants (n,21) of `advance`, and the factor (n) from q [Pa] to the input [MPa], of fibres with these fits
    (n,12), depths [m] (n) and types (n). Constants: filter b (4) and a (3), weights (6), D, saturation, noise, 1/tau,
    a_1, a_2, T/tau_m, g."""
    chi, dynamic = probe_gains(depth, poisson)
    angle = math.pi * fits[:, 0] * 10.0 / RATE
    k = sin(angle) / cos(angle)  # prewarped bilinear transform of 1/((s + 1)(s² + s + 1))
    first, second = (1.0 + k, k - 1.0), (1.0 + k + k * k, 2.0 * (k * k - 1.0), 1.0 - k + k * k)
    a = [sum(first[i] * second[j] for i in range(2) for j in range(3) if i + j == n) for n in range(4)]
    b = [weight * k * k * k / a[0] for weight in (1.0, 3.0, 3.0, 1.0)]
    out = [*b, *(each / a[0] for each in a[1:]), *fits[:, 1:7].T, dynamic, fits[:, 7], fits[:, 8], 1.0 / fits[:, 9]]
    slow, share = np.array(ADAPTATION)[kind].T
    out += [fits[:, 10], fits[:, 11], 1.0 / (slow * RATE), share]
    return np.ascontiguousarray(np.stack(out, axis=1)), 1e-6 * chi


@kernel
def _noise(key, sample):
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
def _weighted_input(x, positive, negative):
    return positive * x if x >= 0.0 else -negative * x


@kernel(error_model="numpy")
def advance(row, state, since, basis, key, sample, count, first, stride, target, moved):
    """Advance a fibre by `count` <= 62 samples. Returns a bit mask of those with a spike, and samples since the last.

    row, state   its constants and state;  since: samples since its last spike
    first        position of the first sample between the last input (0) and `target` (1);  stride: between samples
    target       [MPa] s before the filter at the end;  moved: [MPa/mm] integral of d before the filter at the end
    """
    fired, before, step, resting, path = 0, state[6], target - state[6], state[12], moved - state[12]
    p0, p1, p2, w = state[8], state[9], state[10], state[11]
    z0, z1, z2, s, d, v, m = state[0], state[1], state[2], state[3], state[4], state[5], state[7]
    passed = since
    for k in range(count):
        # Butterworth filter (transposed direct form II) of s and of the integral of d, and d from the latter
        x = before + step * (first + k * stride)
        y = row[0] * x + z0
        z0 = row[1] * x - row[4] * y + z1
        z1 = row[2] * x - row[5] * y + z2
        z2 = row[3] * x - row[6] * y
        x = resting + path * (first + k * stride)
        out = row[0] * x + p0
        p0 = row[1] * x - row[4] * out + p1
        p1 = row[2] * x - row[5] * out + p2
        p2 = row[3] * x - row[6] * out
        speed = (out - w) * RATE
        w = out
        # adaptation, and the current of the inputs
        m += row[19] * (y - m)
        static = max(y - row[20] * m, min(y, 0.0))
        current = (
            _weighted_input(static, row[7], row[8])
            + _weighted_input(speed, row[9], row[10])
            + _weighted_input(speed - d, row[11], row[12])
        )
        s, d = y, speed
        current += row[15] * _noise(key, sample + k)
        # saturation, and the currents after a spike
        if row[14] > 0.0:
            current *= row[14] / (row[14] + abs(current))
        if passed < len(basis):
            current += row[17] * basis[passed, 0] + row[18] * basis[passed, 1]
            passed += 1
        # membrane, and spike
        v += current - v * row[16]
        if v > 1.0 and passed >= REFRACTORY:
            fired |= 1 << k
            v, passed = 0.0, 0
    state[0], state[1], state[2], state[3], state[4], state[5], state[7] = z0, z1, z2, s, d, v, m
    state[8], state[9], state[10], state[11] = p0, p1, p2, w
    return fired, passed
