"""Products of vectors and matrices in kernels, with a fixed order of summation.

For `np.dot` and `@` numba calls BLAS, whose order of summation depends on the processor. A plain loop has a fixed order
but is not vectorised. Here `LANES` partial sums in vector registers are added at the end, with the same result on every
processor.
"""

from functools import partial

from palpate.compiler import interpreted
from palpate.compiler.kernel import kernel
from palpate.compiler.target.intrinsic import intrinsic

LANES = 16  # Parallel partial sums: four vector registers of doubles, to hide the latency of the addition

inner = intrinsic(partial(interpreted.inner, lanes=LANES), "dot.inner", LANES)
"""a.b of contiguous vectors (n,) of one precision, in a kernel: `inner(a, b)`."""


@kernel
def cross(p, q):
    """p x q of two triples."""
    return p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]


@kernel
def dot(p, q):
    """p . q of two triples."""
    return p[0] * q[0] + p[1] * q[1] + p[2] * q[2]


@kernel
def times(matrix, x, out):
    """out = A x, of A = matrix (n,m) and x (m,) into out (n,); all of one precision."""
    for i in range(len(out)):
        out[i] = inner(matrix[i], x)


@kernel
def add_products(a, b, out):
    """out += a'b, of a (k,n) and b (k,m) into out (n,m)."""
    for k in range(len(a)):
        for i in range(len(out)):
            for j in range(len(out[i])):
                out[i, j] += a[k, i] * b[k, j]


@kernel
def left_times(x, matrix, out):
    """out = x A, of x (n,) and A = matrix (n,m) into out (m,)."""
    out[:] = 0.0
    for i in range(len(x)):
        for j in range(len(out)):
            out[j] += x[i] * matrix[i, j]
