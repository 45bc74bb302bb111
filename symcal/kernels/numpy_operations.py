"""The operations of a program on arrays, as functions (operands, array to fill); semantics are CasADi's.

`EXACT` ones give the same bits wherever an element stands in an array. `ROUNDED` ones may be computed in vectors by
numpy, with another last bit than one by one: they are to be given whole vectors. Truth values are the numbers 0 and 1,
and anything but 0 (NaN too) is true.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SINCOS_RANGE = 1e5
_SHIFT = 6755399441055744.0  # 1.5 * 2^52: adding it rounds to an integer
_QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)  # pi/2 in three parts


def sincos(x: Array) -> tuple[Array, Array]:
    """Sine and cosine, operation by operation those of `v_sincos` in lanes.h, where every step is rounded on its own.

    Source: fdlibm (k_sin.c, k_cos.c: Sun Microsystems 1993, freely redistributable).
    """
    t = x * 6.36619772367581382433e-01 + _SHIFT
    k = t - _SHIFT
    quadrant = t.view(np.int64)
    r = x - k * _QUARTER[0]
    r = r - k * _QUARTER[1]
    r = r - k * _QUARTER[2]
    z = r * r
    p = -2.50507602534068634195e-08 + z * 1.58969099521155010221e-10
    p = 2.75573137070700676789e-06 + z * p
    p = -1.98412698298579493134e-04 + z * p
    p = 8.33333333332248946124e-03 + z * p
    p = -1.66666666666666324348e-01 + z * p
    s = np.copysign(r + (r * z) * p, r)
    c = 2.08757232129817482790e-09 + z * -1.13596475577881948265e-11
    c = -2.75573143513906633035e-07 + z * c
    c = 2.48015872894767294178e-05 + z * c
    c = -1.38888888888741095749e-03 + z * c
    c = 4.16666666666666019037e-02 + z * c
    half = 0.5 * z
    w = 1.0 - half
    c = w + ((1.0 - w - half) + (z * z) * c)
    odd = (quadrant & 1) != 0
    sine, cosine = np.where(odd, c, s), np.where(odd, s, c)
    np.negative(sine, out=sine, where=(quadrant & 2) != 0)
    np.negative(cosine, out=cosine, where=((quadrant + 1) & 2) != 0)
    beyond = ~(np.abs(x) < SINCOS_RANGE)
    if beyond.any():
        for i in np.flatnonzero(beyond):
            finite = math.isfinite(x[i])
            sine[i], cosine[i] = (math.sin(x[i]), math.cos(x[i])) if finite else (math.nan, math.nan)
    return sine, cosine


def _chosen(function: Callable[..., Array]) -> Callable[..., Array]:
    """A function that makes its own array, as one that may be given the array to fill."""

    def fill(*args: Array) -> Array:
        *operands, out = args if len(args) > function.__code__.co_argcount else (*args, None)
        made = function(*operands)
        if out is None:
            return made
        out[...] = made
        return out

    return fill


def _truth(ufunc: np.ufunc) -> Callable[..., Array]:
    def both(a: Array, b: Array) -> Array:
        return np.asarray(ufunc(a, b), dtype=np.float64)

    return _chosen(both)


def _opposite(a: Array) -> Array:
    return np.asarray(a == 0.0, dtype=np.float64)


def _if_else_zero(a: Array, b: Array) -> Array:
    return np.where(a != 0.0, b, 0.0)


def _sign(a: Array) -> Array:
    return np.where(a < 0.0, -1.0, np.where(a > 0.0, 1.0, a))


def _erf(a: Array) -> Array:
    return np.array([math.erf(value) for value in a])


EXACT: dict[str, Callable[..., Array]] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": np.divide,
    "neg": np.negative,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "ceil": np.ceil,
    "fabs": np.absolute,
    "fmin": np.fmin,
    "fmax": np.fmax,
    "copysign": np.copysign,
    "lt": _truth(np.less),
    "le": _truth(np.less_equal),
    "eq": _truth(np.equal),
    "ne": _truth(np.not_equal),
    "and": _truth(np.logical_and),
    "or": _truth(np.logical_or),
    "not": _chosen(_opposite),
    "if_else_zero": _chosen(_if_else_zero),
    "sign": _chosen(_sign),
}

ROUNDED: dict[str, Callable[..., Array]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "asinh": np.arcsinh,
    "acosh": np.arccosh,
    "atanh": np.arctanh,
    "exp": np.exp,
    "expm1": np.expm1,
    "log": np.log,
    "log1p": np.log1p,
    "erf": _chosen(_erf),
    "atan2": np.arctan2,
    "pow": np.float_power,  # `power` takes a root where the exponent is one half, and so -inf for NaN
    "fmod": np.fmod,
    "hypot": np.hypot,
}
