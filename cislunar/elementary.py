"""Exponential, sine and cosine in elementary arithmetic, for vectorized loops, and the normal
distribution (compiled).

The functions of the mathematics library are calls, which prevent vectorization, and their last bit
depends on the machine. The functions here consist of sums and products alone: argument reduction
(Cody & Waite 1980) and a Taylor polynomial. The compiler reorders nothing, so that the result does
not depend on the vector width.
"""

import math

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from cislunar.compiled import njit_inline

LOWEST_EXPONENT = -708.0
"""For smaller arguments the exponential is exp(-708) = 3e-308, so that it is never subnormal."""

_INVERSE_LN2 = 1.0 / math.log(2.0)
# log(2) and pi / 2 in parts; the first is short, so that its product with an integer is exact
_LN2 = (float.fromhex("0x1.62e42fefap-1"), float.fromhex("0x1.cf79abc9e3b39p-40"))
_RIGHT_ANGLE = (
    float.fromhex("0x1.921fb544p+0"),
    float.fromhex("0x1.0b4611a6p-34"),
    float.fromhex("0x1.3198a2e037073p-69"),
)
_SQRT_HALF = math.sqrt(0.5)
_TO_INTEGER = 1.5 * 2.0**52
"""Added to a number, leaves its nearest integer in the lowest bits."""
_BIAS = 1023.0
"""Added to an exponent of two, gives the biased exponent of a float64."""

(_1, _2, _3, _4, _5, _6, _7, _8, _9, _10, _11, _12, _13, _14, _15, _16) = (
    1.0 / math.factorial(n) for n in range(1, 17)
)


@intrinsic
def _bits(typing_context, number):
    """The bits of a float64 as an int64."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.IntType(64))

    return types.int64(types.float64), generate


@intrinsic
def _number(typing_context, bits):
    """The float64 whose bits are an int64."""

    def generate(context, builder, signature, arguments):
        return builder.bitcast(arguments[0], ir.DoubleType())

    return types.float64(types.int64), generate


@njit_inline
def exponential(x):
    """exp(x) for x up to 709, within 4e-16 of it (relative)."""
    x = x if x > LOWEST_EXPONENT else LOWEST_EXPONENT
    shifted = x * _INVERSE_LN2 + (_TO_INTEGER + _BIAS)
    count = shifted - (_TO_INTEGER + _BIAS)
    r = (x - count * _LN2[0]) - count * _LN2[1]
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 + r) + r2 * (_2 + _3 * r)
    middle = (_4 + _5 * r) + r2 * (_6 + _7 * r)
    high = (_8 + _9 * r) + r2 * (_10 + _11 * r)
    series = low + r4 * (middle + r4 * (high + r4 * (_12 + _13 * r)))
    return series * _number(_bits(shifted) << 52)


@njit_inline
def normal_cdf(x, sigma):
    """Probability that a normal variable of mean 0 and standard deviation sigma is below x, with a
    small relative error in both tails; with sigma = 0 it is 0, 1, or 0.5 at x = 0."""
    if sigma == 0.0:
        return 0.5 + 0.5 * np.sign(x)
    return 0.5 * math.erfc(-x / sigma * _SQRT_HALF)


@njit_inline
def sine_and_cosine(x):
    """sin(x) and cos(x) for |x| up to 4e6, within 2e-16 of them."""
    shifted = x * (2.0 / math.pi) + _TO_INTEGER
    count = shifted - _TO_INTEGER
    r = ((x - count * _RIGHT_ANGLE[0]) - count * _RIGHT_ANGLE[1]) - count * _RIGHT_ANGLE[2]
    r2 = r * r
    r4 = r2 * r2
    low = -_3 + _5 * r2
    middle = -_7 + _9 * r2
    high = -_11 + _13 * r2
    sine = r + r * r2 * (low + r4 * (middle + r4 * (high - r4 * _15)))
    low = -_2 + _4 * r2
    middle = -_6 + _8 * r2
    high = -_10 + _12 * r2
    cosine = 1.0 + r2 * (low + r4 * (middle + r4 * (high + r4 * (-_14 + _16 * r2))))
    quarter = _bits(shifted)
    turned = (quarter & 1) == 1
    first = cosine if turned else sine
    second = sine if turned else cosine
    return (
        -first if (quarter & 2) == 2 else first,
        -second if ((quarter + 1) & 2) == 2 else second,
    )
