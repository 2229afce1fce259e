"""Operations and functions of an expression, with their derivatives by the chain rule."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy

from flightmech.errors import OutOfRange

_ONE = np.array(1.0)


@dataclass(frozen=True)
class Pieces:
    """Stretches of samples without a gap, and the sampling interval of each [s]."""

    slices: Sequence[slice] = ()
    steps: Sequence[float] = ()


class Slopes(NamedTuple):
    """A value along the samples, with its derivatives.

    Attributes
    ----------
    value : array (samples,) or scalar array
    by : dict of str to array
        Derivatives by the parameters on which the value depends.
    """

    value: np.ndarray
    by: dict[str, np.ndarray]


Result = tuple[np.ndarray, dict[str, np.ndarray]]
Operation = Callable[[Sequence[Slopes], Pieces], Result]


class ExpressionFunction(NamedTuple):
    """A function of an expression.

    Attributes
    ----------
    arity : int
        Number of arguments.
    apply : callable
        (arguments, pieces) -> value and derivatives.
    """

    arity: int
    apply: Operation


def apply_chain_rule(value: np.ndarray, *parts: tuple[Slopes, np.ndarray]) -> Result:
    """Return a value with its derivatives by the chain rule.

    Parameters
    ----------
    value : array
    *parts : (argument, partial derivative of the value by the argument)
    """
    slopes: dict[str, np.ndarray] = {}
    for argument, partial in parts:
        for name, slope in argument.by.items():
            slopes[name] = slopes.get(name, 0.0) + partial * slope
    return value, slopes


def _scale_slopes(argument: Slopes, partial: np.ndarray) -> dict[str, np.ndarray]:
    return {name: partial * slope for name, slope in argument.by.items()}


def _make_plain(value: Callable, slope: Callable) -> ExpressionFunction:
    """Return a function of one argument from its value and its derivative."""

    def apply(arguments: Sequence[Slopes], _: Pieces) -> Result:
        (x,) = arguments
        return value(x.value), _scale_slopes(x, slope(x.value))

    return ExpressionFunction(1, apply)


def _make_positive(name: str, value: Callable, slope: Callable) -> ExpressionFunction:
    """Return a function of one positive argument from its value and its derivative."""

    def apply(arguments: Sequence[Slopes], _: Pieces) -> Result:
        (x,) = arguments
        if (x.value <= 0.0).any():
            raise OutOfRange(f"{name} of {np.min(x.value):g}; it must stay positive")
        return value(x.value), _scale_slopes(x, slope(x.value))

    return ExpressionFunction(1, apply)


def _make_choice(takes_first: Callable) -> ExpressionFunction:
    """Return the choice of one of two arguments, sample by sample."""

    def apply(arguments: Sequence[Slopes], _: Pieces) -> Result:
        x, y = arguments
        # At every sample the derivatives are those of the chosen argument.
        choice = takes_first(x.value, y.value)
        slopes = {}
        for name in sorted({*x.by, *y.by}):
            slopes[name] = np.where(choice, x.by.get(name, 0.0), y.by.get(name, 0.0))
        return np.where(choice, x.value, y.value), slopes

    return ExpressionFunction(2, apply)


def _ramp(arguments: Sequence[Slopes], _: Pieces) -> Result:
    """Return x - a above the knot a, zero below."""
    x, a = arguments
    is_above = x.value > a.value
    slopes = {}
    for name in sorted({*x.by, *a.by}):
        slope = np.subtract(x.by.get(name, 0.0), a.by.get(name, 0.0))
        slopes[name] = np.where(is_above, slope, 0.0)
    return np.where(is_above, x.value - a.value, 0.0), slopes


def _lag(arguments: Sequence[Slopes], pieces: Pieces) -> Result:
    """Return a first-order lag, tau y' + y = x, from rest at the start of each piece."""
    x, tau = arguments
    if tau.value.ndim or not tau.value > 0.0:
        raise OutOfRange(
            "the time constant of a lag is one positive number or parameter, as in lag(n1, tau)"
        )
    time_constant = float(tau.value)
    size = pieces.slices[-1].stop if pieces.slices else 0
    if not size:
        raise OutOfRange("a lag needs samples in time")

    def run(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        signal = np.broadcast_to(np.asarray(signal, float), (size,))
        lagged, slope = np.empty(size), np.empty(size)
        for piece, step in zip(pieces.slices, pieces.steps):
            lagged[piece], slope[piece] = _lag_signal(signal[piece], step, time_constant)
        return lagged, slope

    # A lag is linear: the derivative of its argument is lagged too.
    value, slope = run(x.value)
    slopes = {name: run(inner)[0] for name, inner in x.by.items()}
    for name, inner in tau.by.items():
        slopes[name] = slopes.get(name, 0.0) + slope * inner
    return value, slopes


def _lag_signal(x: np.ndarray, step: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a lagged signal and its derivative by the time constant T.

    x is linear between samples. With a = exp(-dt/T) and e = (1 - a) T/dt,
    y_k = a y_(k-1) + (e - a) x_(k-1) + (1 - e) x_k.
    """
    r = step / T
    a, e = np.exp(-r), -np.expm1(-r) / r
    da, de = a * r / T, (e - a) / T  # derivatives by T
    previous, current = x[:-1], x[1:]
    drive = (e - a) * previous + (1.0 - e) * current
    y, _ = scipy.signal.lfilter([1.0], [1.0, -a], drive, zi=[a * x[0]])
    y = np.concatenate([x[:1], y])
    # The derivative of the recursion by T is a recursion with the same filter.
    slope_drive = da * y[:-1] + (de - da) * previous - de * current
    return y, np.concatenate([[0.0], scipy.signal.lfilter([1.0], [1.0, -a], slope_drive)])


FUNCTIONS: dict[str, ExpressionFunction] = {
    "exp": _make_plain(np.exp, np.exp),
    "tanh": _make_plain(np.tanh, lambda x: 1.0 - np.tanh(x) ** 2),
    "sin": _make_plain(np.sin, np.cos),
    "cos": _make_plain(np.cos, lambda x: -np.sin(x)),
    "abs": _make_plain(np.abs, np.sign),
    "sign": _make_plain(np.sign, np.zeros_like),
    "sqrt": _make_positive("sqrt", np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "log": _make_positive("log", np.log, lambda x: 1.0 / x),
    "max": _make_choice(np.greater_equal),
    "min": _make_choice(np.less_equal),
    "ramp": ExpressionFunction(2, _ramp),
    "lag": ExpressionFunction(2, _lag),
}


def _add(arguments: Sequence[Slopes], _: Pieces) -> Result:
    x, y = arguments
    return apply_chain_rule(x.value + y.value, (x, _ONE), (y, _ONE))


def _subtract(arguments: Sequence[Slopes], _: Pieces) -> Result:
    x, y = arguments
    return apply_chain_rule(x.value - y.value, (x, _ONE), (y, -_ONE))


def _multiply(arguments: Sequence[Slopes], _: Pieces) -> Result:
    x, y = arguments
    return apply_chain_rule(x.value * y.value, (x, y.value), (y, x.value))


def _divide(arguments: Sequence[Slopes], _: Pieces) -> Result:
    # d(x/y) = dx/y - x dy/y^2
    x, y = arguments
    if (y.value == 0.0).any():
        raise OutOfRange("division by zero")
    return apply_chain_rule(x.value / y.value, (x, 1.0 / y.value), (y, -x.value / y.value**2))


def _negate(arguments: Sequence[Slopes], _: Pieces) -> Result:
    (x,) = arguments
    return apply_chain_rule(-x.value, (x, -_ONE))


def _raise_to_power(arguments: Sequence[Slopes], _: Pieces) -> Result:
    x, y = arguments
    if y.by and (x.value <= 0.0).any():
        raise OutOfRange(
            f"the base of a power with an unknown exponent reaches {np.min(x.value):g}; it "
            f"must stay positive, as in max(h, 1)"
        )
    if (x.value < 0.0).any() and (y.value != np.round(y.value)).any():
        raise OutOfRange(
            f"the base of a power that is not an integer reaches {np.min(x.value):g}; it must "
            f"not be negative"
        )
    if (x.value == 0.0).any() and (y.value < 0.0).any():
        raise OutOfRange("a negative power of zero")
    # d(x^y) = y x^(y-1) dx + x^y ln(x) dy
    value = x.value**y.value
    # Only the needed partial derivatives: the other ones may not exist at x = 0.
    parts = []
    if x.by:
        parts.append((x, y.value * x.value ** (y.value - 1.0)))
    if y.by:
        parts.append((y, value * np.log(x.value)))
    return apply_chain_rule(value, *parts)


OPERATIONS: dict[str, Operation] = {
    "+": _add,
    "-": _subtract,
    "*": _multiply,
    "/": _divide,
    "^": _raise_to_power,
    "negative": _negate,
}
