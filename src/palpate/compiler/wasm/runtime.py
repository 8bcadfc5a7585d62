"""What kernels call and WebAssembly lacks: a b + c rounded once, the remainder, and memory of arrays."""

import numpy as np

from palpate.compiler.doubles import bits, with_bits
from palpate.compiler.kernel import ieee_kernel, kernel
from palpate.compiler.memory import set_word, word

LOW = (1 << 32) - 1
INFINITE = 0x7FF << 52
SIGN = -1 << 63
TOP = (1 << 63) - 1  # all bits but the sign
EXACT = 900  # largest exponent, of either sign, of a product that `fma` computes by error-free transforms
SPLIT = 134217729.0  # 2^27 + 1, which splits a double into two halves (Dekker)

CLASSES = 40
"""Sizes of blocks of an `allocate`d heap: powers of two; for each the list of its free blocks."""
HEAD = 64  # [bytes] before the memory of an array: numba's description of it, in a line of the cache
BEGIN, END = CLASSES, CLASSES + 1  # words of the control block after the lists: unused memory of the heap
CONTROL = CLASSES + 2


@kernel(inline=True)
def shift_right(m, count):
    """Shift a word to the right as an unsigned one; 0 <= count <= 63."""
    return np.int64(np.uint64(m) >> np.uint64(count))


@kernel(inline=True)
def plus(a, b):
    """The sum of two unsigned words modulo 2^64; numba leaves an overflow of signed ones undefined."""
    return np.int64(np.uint64(a) + np.uint64(b))


@kernel(inline=True)
def minus(a, b):
    """The difference of two unsigned words modulo 2^64."""
    return np.int64(np.uint64(a) - np.uint64(b))


@kernel(inline=True)
def times(a, b):
    """The product of two unsigned words modulo 2^64."""
    return np.int64(np.uint64(a) * np.uint64(b))


@kernel(inline=True)
def below(a, b):
    """Whether a < b as unsigned words."""
    return (a ^ SIGN) < (b ^ SIGN)


@kernel
def leading_zeros(m):
    """Number of zero bits above the highest one of a word that is not 0."""
    count = 0
    for step in (32, 16, 8, 4, 2, 1):
        if shift_right(m, 64 - step) == 0:
            m, count = m << step, count + step
    return count


@kernel
def wide_product(a, b):
    """High and low word of the 128-bit product of two unsigned words.

    By pieces of 16 bits: LLVM would recognise the usual four products of halves and call `__multi3`, which is this.
    """
    a_high, a_low = shift_right(a, 32), a & LOW
    high = low = 0
    for shift in range(0, 64, 16):
        piece = shift_right(b, shift) & 0xFFFF
        part = a_high * piece
        below_part = plus(a_low * piece, part << 32)
        above = shift_right(part, 32) + below(below_part, a_low * piece)
        if shift > 0:
            above = (above << shift) | shift_right(below_part, 64 - shift)
            below_part = below_part << shift
        low = plus(low, below_part)
        high = plus(high, above + below(low, below_part))
    return high, low


@kernel
def multiply(to, a_low, a_high, b_low, b_high):
    """Write the product of two integers of 128 bits to an address, low word first."""
    high, low = wide_product(a_low, b_low)
    set_word(to, low)
    set_word(to + 8, plus(high, plus(times(a_low, b_high), times(a_high, b_low))))


@kernel(inline=True)
def exponent_of(x):
    """The exponent in the bits of a number, from 0 for subnormal ones to 0x7FF for infinity and NaN."""
    return (bits(x) >> 52) & 0x7FF


@kernel
def unpacked(x):
    """Mantissa of 54 bits with a zero at the end, exponent and sign of a finite number that is not 0: its size is
    mantissa 2^exponent."""
    word = bits(x)
    exponent = exponent_of(x)
    if exponent == 0:  # subnormal
        word = bits(x * 2.0**63)
        exponent = exponent_of(x * 2.0**63) - 63
    return ((word & ((1 << 52) - 1)) | (1 << 52)) << 1, exponent - 0x3FF - 53, word < 0


@kernel
def sticky_shift(m, count):
    """Shift a word to the right by 0 <= count; the last bit is set if a bit is lost."""
    if count == 0:
        return m
    if count > 63:
        return 1 if m != 0 else 0
    return shift_right(m, count) | ((m << (64 - count)) != 0)


@kernel
def rounded(m, exponent, negative):
    """The double nearest to +-m 2^exponent, for 2^62 <= m < 2^63 whose last bit represents all that follow."""
    if exponent < -1022 - 62:  # subnormal: it has fewer bits, to which the only rounding goes
        lost = -1074 - exponent
        if lost > 63:
            return -0.0 if negative else 0.0
        kept, rest = shift_right(m, lost), m & ((1 << lost) - 1)
        half = 1 << (lost - 1)
        kept += rest > half or (rest == half and kept & 1 == 1)
        return with_bits(kept | (SIGN if negative else 0))
    value = float(-m if negative else m)  # rounded
    first = exponent // 2
    return value * with_bits((first + 0x3FF) << 52) * with_bits((exponent - first + 0x3FF) << 52)


@kernel
def fma_by_integers(a, b, c):
    """a b + c rounded once, of numbers that are finite and not 0, by integers of 128 bits.

    As in musl, src/math/fma.c (MIT licence): the product of the mantissas is exact; what is shifted out when the terms
    are aligned only decides about a rounding, so one bit represents it.
    """
    m_a, e_a, s_a = unpacked(a)
    m_b, e_b, s_b = unpacked(b)
    m_c, e_c, s_c = unpacked(c)
    high, low = wide_product(m_a, m_b)
    exponent, negative = e_a + e_b, s_a != s_b
    distance = e_c - exponent
    c_high = 0
    if distance >= 64:
        c_high, c_low, exponent, distance = m_c, 0, e_c - 64, distance - 64
        if distance >= 64:
            high, low = 0, 1
        elif distance > 0:
            low = (high << (64 - distance)) | sticky_shift(low, distance)
            high = shift_right(high, distance)
    elif distance > 0:
        c_high, c_low = shift_right(m_c, 64 - distance), m_c << distance
    else:
        c_low = sticky_shift(m_c, -distance)
    if negative == s_c:
        low = plus(low, c_low)
        high += c_high + below(low, c_low)
    else:
        before = low
        low = minus(low, c_low)
        high -= c_high + below(before, low)
        if high < 0:
            low = minus(0, low)
            high = -high - (low != 0)
            negative = not negative
    if high == 0 and low == 0:
        return 0.0
    if high != 0:
        exponent += 64
        free = leading_zeros(high) - 1
        m = (high << free) | shift_right(low, 64 - free) | ((low << free) != 0) if free > 0 else high | (low != 0)
    else:
        free = leading_zeros(low) - 1
        m = shift_right(low, 1) | (low & 1) if free < 0 else low << free
    return rounded(m, exponent - free, negative)


@ieee_kernel
def fma(a, b, c):
    """a b + c, rounded once, with the bits of the instruction of other processors.

    Error-free transforms give the sum as three numbers; the two small ones are added with rounding to odd, so that the
    last sum rounds correctly (S. Boldo, G. Melquiond, IEEE Trans. Comput. 57 (2008) 462-471). Where an exponent is
    extreme, and a part could be lost, integers do it.
    """
    product = a * b
    size_a, size_b, size_c = exponent_of(a), exponent_of(b), exponent_of(c)
    size = exponent_of(product)
    if size < 0x3FF - EXACT or max(size, size_a, size_b, size_c) > 0x3FF + EXACT:
        if a == 0.0 or b == 0.0 or max(size_a, size_b) == 0x7FF:
            return product + c
        if size_c == 0x7FF:
            return c
        return product if c == 0.0 else fma_by_integers(a, b, c)
    # The product and its error (Dekker).
    split = SPLIT * a
    a_high = split - (split - a)
    a_low = a - a_high
    split = SPLIT * b
    b_high = split - (split - b)
    b_low = b - b_high
    error = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    # The sum of c and the error, the sum of that and the product, each with its error (Knuth).
    small = c + error
    part = small - c
    small_error = (c - (small - part)) + (error - part)
    total = product + small
    part = total - product
    total_error = (product - (total - part)) + (small - part)
    # The sum of both errors, rounded to odd.
    rest = small_error + total_error
    part = rest - small_error
    lost = (small_error - (rest - part)) + (total_error - part)
    if lost != 0.0 and bits(rest) & 1 == 0:
        rest = with_bits(bits(rest) + (1 if (rest > 0.0) == (lost > 0.0) else -1))
    return total + rest


@ieee_kernel
def fmod(x, y):
    """The remainder of x/y with the sign of x, which is exact: long division in base 2."""
    x_bits, y_bits = bits(x) & TOP, bits(y) & TOP
    if y_bits == 0 or x_bits >= INFINITE or y_bits > INFINITE:
        return (x * y) / (x * y)
    if x_bits < y_bits:
        return x
    if x_bits == y_bits:
        return 0.0 * x
    m_x, e_x, negative = unpacked(x)
    m_y, e_y, _ = unpacked(y)
    for _ in range(e_x - e_y):
        m_x = (m_x - m_y if m_x >= m_y else m_x) << 1
    if m_x >= m_y:
        m_x -= m_y
    if m_x == 0:
        return 0.0 * x
    free = leading_zeros(m_x) - 1
    return rounded(m_x << free, e_y - free, negative)


@kernel
def allocate(control, size, alignment):
    """Memory for an array of `size` bytes, aligned to 64 bytes at most: address of numba's description, which precedes
    it: count of references (8 bytes), destructor, its argument, address of the memory (4 each), size (8). 0: the heap
    is full.

    control  address of the lists of free blocks and of the limits of the heap, `CONTROL` words
    """
    kind = 64 - leading_zeros(size + HEAD - 1)
    free = word(control + 8 * kind)
    if free != 0:
        set_word(control + 8 * kind, word(free))
    else:
        free = word(control + 8 * BEGIN)
        if free + (1 << kind) > word(control + 8 * END):
            return 0
        set_word(control + 8 * BEGIN, free + (1 << kind))
    set_word(free, 1)
    set_word(free + 8, 0)
    set_word(free + 16, free + HEAD)
    set_word(free + 24, size)
    return free


@kernel
def release(control, block):
    """Give an `allocate`d block back."""
    place = control + 8 * (64 - leading_zeros(word(block + 24) + HEAD - 1))
    set_word(block, word(place))
    set_word(place, block)


@kernel
def reshape(axes, lengths, strides, new_axes, new_lengths, new_strides, size):
    """Write the strides of an array in a new shape, without a copy: 1; 0 if the array is not contiguous.

    lengths, strides, new_lengths, new_strides  addresses of words, one for each axis;  size [bytes] of an element
    """
    step = size
    for axis in range(axes - 1, -1, -1):
        if word(lengths + 8 * axis) > 1 and word(strides + 8 * axis) != step:
            return 0
        step *= word(lengths + 8 * axis)
    step = size
    for axis in range(new_axes - 1, -1, -1):
        set_word(new_strides + 8 * axis, step)
        step *= word(new_lengths + 8 * axis)
    return 1
