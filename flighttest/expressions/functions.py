"""Functions that may stand in an expression, each with its partial derivatives."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from flightmech.errors import OutOfRange


@dataclass(frozen=True)
class Pieces:
    """Stretches of samples without a gap, and the sampling interval of each [s]."""

    slices: Sequence[slice] = ()
    steps: Sequence[float] = ()


class Function(NamedTuple):
    """Number of arguments, and the value with its derivatives from those of the arguments and the pieces."""

    arity: int
    apply: Callable[[Sequence[Any], Pieces], tuple[np.ndarray, dict[str, np.ndarray]]]


def _by(given, partial: np.ndarray) -> dict[str, np.ndarray]:
    return {name: partial * slope for name, slope in given.by.items()}


def _plain(value: Callable, slope: Callable) -> Function:
    """A function of one argument from its value and its derivative, both of the argument."""
    return Function(1, lambda given, _: (value(given[0].value), _by(given[0], slope(given[0].value))))


def _positive(name: str, value: Callable, slope: Callable) -> Function:
    """The same, of a positive argument."""

    def apply(given, _):
        x = given[0].value
        if (x <= 0.0).any():
            raise OutOfRange(f"{name} of {np.min(x):g}; it must stay positive")
        return value(x), _by(given[0], slope(x))

    return Function(1, apply)


def _chosen(first: Callable) -> Function:
    """One of two arguments, sample by sample: the first where `first` of the two values holds."""

    def apply(given, _):
        x, y = given
        choice = first(x.value, y.value)
        by = {name: np.where(choice, x.by.get(name, 0.0), y.by.get(name, 0.0)) for name in sorted({*x.by, *y.by})}
        return np.where(choice, x.value, y.value), by

    return Function(2, apply)


def _ramp(given, _):
    """x - a above the knot a, zero below."""
    x, a = given
    above = x.value > a.value
    by = {name: np.where(above, np.subtract(x.by.get(name, 0.0), a.by.get(name, 0.0)), 0.0) for name in sorted({*x.by, *a.by})}
    return np.where(above, x.value - a.value, 0.0), by


def _lag(given, pieces: Pieces):
    """First-order lag, tau y' + y = x, from rest at the first sample of each piece; x is straight between samples.

    With a = exp(-dt/tau) and e = (1 - a) tau/dt:  y_k = a y_(k-1) + (e - a) x_(k-1) + (1 - e) x_k.
    """
    x, tau = given
    if tau.value.ndim or not tau.value > 0.0:
        raise OutOfRange("the time constant of a lag is one positive number or parameter, as in lag(n1, tau)")
    T = float(tau.value)
    size = pieces.slices[-1].stop if pieces.slices else 0
    if not size:
        raise OutOfRange("a lag needs samples in time")

    def run(signal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        signal = np.broadcast_to(np.asarray(signal, float), (size,))
        out, slope = np.empty(size), np.empty(size)
        for at, step in zip(pieces.slices, pieces.steps):
            out[at], slope[at] = _lagged(signal[at], step, T)
        return out, slope

    value, slope = run(x.value)
    by = {name: run(inner)[0] for name, inner in x.by.items()}
    for name, inner in tau.by.items():
        by[name] = by.get(name, 0.0) + slope * inner
    return value, by


def _lagged(x: np.ndarray, step: float, T: float) -> tuple[np.ndarray, np.ndarray]:
    """A lagged signal and its derivative with respect to the time constant."""
    r = step / T
    a, e = np.exp(-r), -np.expm1(-r) / r
    da, de = a * r / T, (e - a) / T  # by T
    before, later = x[:-1], x[1:]
    push = (e - a) * before + (1.0 - e) * later
    y, _ = scipy.signal.lfilter([1.0], [1.0, -a], push, zi=[a * x[0]])
    y = np.concatenate([x[:1], y])
    dpush = da * y[:-1] + (de - da) * before - de * later
    return y, np.concatenate([[0.0], scipy.signal.lfilter([1.0], [1.0, -a], dpush)])


FUNCTIONS: dict[str, Function] = {
    "exp": _plain(np.exp, np.exp),
    "tanh": _plain(np.tanh, lambda x: 1.0 - np.tanh(x) ** 2),
    "sin": _plain(np.sin, np.cos),
    "cos": _plain(np.cos, lambda x: -np.sin(x)),
    "abs": _plain(np.abs, np.sign),
    "sign": _plain(np.sign, np.zeros_like),
    "sqrt": _positive("sqrt", np.sqrt, lambda x: 0.5 / np.sqrt(x)),
    "log": _positive("log", np.log, lambda x: 1.0 / x),
    "max": _chosen(np.greater_equal),
    "min": _chosen(np.less_equal),
    "ramp": Function(2, _ramp),
    "lag": Function(2, _lag),
}
