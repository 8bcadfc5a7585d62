"""Discrete Fourier transforms of real numbers in kernels: the same bits on all processors.

numpy's have the same definitions, but their last bits depend on whether the processor fuses products and sums.
"""

from functools import lru_cache

import numpy as np

from palpate.compiler.exact import cos, sin
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.physics.arrays import Array


def rfft(x: np.ndarray) -> np.ndarray:
    """sum_j x_j exp(-2 pi i j k/n), k = 0 ... n/2, of x (n): as `np.fft.rfft`."""
    re, im = np.array(x, float), np.zeros(len(x))
    _transform(re, im)
    return (re + 1j * im)[: len(x) // 2 + 1]


def irfft(lines: np.ndarray, count: int) -> np.ndarray:
    """The real numbers (n) with these transforms `lines` (n/2 + 1): as `np.fft.irfft`, for n = `count`."""
    re, im = np.zeros(count), np.zeros(count)
    top = count // 2 + 1
    re[:top], im[:top] = lines.real, -lines.imag  # conjugates, since the inverse is the conjugate of their transform
    re[top:], im[top:] = re[1 : count - top + 1][::-1], -im[1 : count - top + 1][::-1]
    im[0] = 0.0
    if count % 2 == 0:
        im[count // 2] = 0.0
    _transform(re, im)
    return re / count


def _transform(re: np.ndarray, im: np.ndarray) -> None:
    """Replace the real and imaginary parts (n) by those of their transform."""
    count = len(re)
    if count & (count - 1) == 0:
        _radix_2(re, im, *_roots(count))
    elif count:
        _chirp(re, im, *_chirps(count))


@lru_cache(maxsize=16)
def _roots(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of 2 pi j/n (n/2)."""
    angle = 2.0 * np.pi * np.arange(count // 2) / count
    return cos(angle), sin(angle)


@lru_cache(maxsize=16)
def _chirps(count: int) -> tuple[np.ndarray, ...]:
    """For a transform of any length by convolution: cosine and sine of pi j²/n (n), the transform (m) of the filter,
    and the roots of the length m, a power of 2."""
    j = np.arange(count, dtype=np.int64)
    angle = np.pi * (j * j % (2 * count)) / count
    c, s = cos(angle), sin(angle)
    size = 1 << (2 * count - 2).bit_length()
    re, im = np.zeros(size), np.zeros(size)
    re[:count], im[:count] = c, s
    re[size - count + 1 :], im[size - count + 1 :] = c[:0:-1], s[:0:-1]
    _radix_2(re, im, *_roots(size))
    return c, s, re, im, *_roots(size)


@ieee_kernel
def _radix_2(re: Array, im: Array, cosine: Array, sine: Array):
    """Transform in place, n a power of 2 (J. W. Cooley, J. W. Tukey, Math. Comput. 19 (1965) 297-301)."""
    count = len(re)
    other = 0
    for k in range(1, count):  # bit-reversed order
        bit = count >> 1
        while other & bit:
            other ^= bit
            bit >>= 1
        other |= bit
        if k < other:
            re[k], re[other] = re[other], re[k]
            im[k], im[other] = im[other], im[k]
    half = 1
    while half < count:
        stride = count // (2 * half)
        for begin in range(0, count, 2 * half):
            for k in range(half):
                c, s, low, high = cosine[k * stride], sine[k * stride], begin + k, begin + k + half
                x, y = c * re[high] + s * im[high], c * im[high] - s * re[high]
                re[high], im[high] = re[low] - x, im[low] - y
                re[low] += x
                im[low] += y
        half *= 2


@kernel
def _times(re: Array, im: Array, c: Array, s: Array):
    """Multiply by c + i s in place, as far as c reaches."""
    for k in range(len(c)):
        x, y = re[k] * c[k] - im[k] * s[k], re[k] * s[k] + im[k] * c[k]
        re[k], im[k] = x, y


@ieee_kernel
def _chirp(re: Array, im: Array, c: Array, s: Array, filter_re: Array, filter_im: Array, cosine: Array, sine: Array):
    """Transform in place, of any length n (L. I. Bluestein, IEEE Trans. Audio Electroacoust. 18 (1970) 451-455)."""
    count, size = len(re), len(filter_re)
    x, y = np.zeros(size), np.zeros(size)
    x[:count], y[:count] = re, im
    _times(x, y, c, -s)
    _radix_2(x, y, cosine, sine)
    _times(x, y, filter_re, filter_im)
    y[:] = -y
    _radix_2(x, y, cosine, sine)
    for k in range(count):
        re[k], im[k] = x[k] / size, -y[k] / size
    _times(re, im, c, -s)
