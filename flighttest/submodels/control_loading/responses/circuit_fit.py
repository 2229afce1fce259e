"""Output error on the control circuit: one likelihood of free motion and of driven sweeps.

Free motion (pulses, releases) is simulated from rest with the recorded force; travel and surface
are its outputs.  No derivative is formed, and a reversal needs no window of its own.  Where a hand
drives the control, force and stretch of the cable are the outputs: their equations are linear in
the constants and hold at every sliding sample.

    F     = offset + bob + C s + P sgn(s) + R sgn(s') + r |g| sgn(a') + (W + w g^2 - e) s'
            + (m + J g^2) s'' - g qbar S c Ch
    s - a = [J g^2 a'' + w g^2 a' + r |g| sgn(a') - g H - D (s' - a')] / K - rigging / g

The search is that of `kinked_search`.

References
----------
.. [Maine1985] Maine, Iliff, Identification of dynamic systems: theory and formulation, NASA
   RP-1138, 1985.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from flightmech.errors import IdentificationError
from flightmech.quantities import time_text
from flightmech.simulation.estimation.circuit_response import MOST_UNKNOWNS
from flighttest.maximum_likelihood.likelihood import LikelihoodMaximum
from flighttest.maximum_likelihood.residual_covariance import coloured_likelihood_covariance
from flighttest.maximum_likelihood.search import (
    PROVEN,
    invert_information,
)
from flighttest.maximum_likelihood.unknowns import Unknown, UnknownVector, lay_out
from flighttest.remarks import Convergence
from flighttest.submodels.control_loading.loading import ControlLoading
from flighttest.submodels.control_loading.responses.circuit_likelihood import CircuitLikelihood
from flighttest.submodels.control_loading.responses.driven_rows import DrivenRows
from flighttest.submodels.control_loading.responses.free_response import (
    EDGE,
    ERROR,
    FreeWindow,
)
from flighttest.submodels.control_loading.responses.kinked_search import maximise_kinked
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
    PRELOAD_TRAVEL,
    WIDTHS,
    largest_motion,
)

# First and smallest width of friction and preload, over the largest rate and the range of the
# travel in the records, and a-priori standard error of the logarithm of a width.
WIDE, _LEAST, _WIDTH_ERROR = 3e-3, 1e-4, 3.0
# Smallest bristle travel over the range of the travel: sub-steps still resolve it at a reversal.
_LEAST_BRISTLE = 1e-5
# Standard deviation of a time that lies anywhere between two samples. [steps]
_ANYWHERE = 12.0**-0.5
# Constants that cannot be negative, and those that must be positive, with the smallest part of
# their start.
_NOT_NEGATIVE = (
    "friction",
    "preload",
    "hinge_friction",
    "damping",
    "hinge_damping",
    "cable_damping",
)
_POSITIVE = ("mass", "inertia", "cable_stiffness")
_LEAST_PART = 0.02
# Most iterations of a search.
_ITERATIONS = 150
# Standard deviation of the start of a window over its motion.
_FAR = 10.0


@dataclass(frozen=True)
class CircuitFit:
    """Maximum of the likelihood of a circuit.

    Attributes
    ----------
    names : tuple of str
        Common unknowns: constants, cable, terms of the hinge moment, `HAND`, and the logarithms of
        `WIDTHS`.
    theta : array (names,)
        Estimates.
    covariance : array (names, names)
        With the colour of the residuals, the scatter between the records, and the width of a
        stationary end.
    rms : dict of str to float
        Residual of each output over the white noise of its pick-up.
    maximum : LikelihoodMaximum
        With the remaining step and the bounds of free starts.
    likelihood : CircuitLikelihood
    """

    names: tuple[str, ...]
    theta: np.ndarray
    covariance: np.ndarray
    rms: dict[str, float]
    maximum: LikelihoodMaximum
    likelihood: CircuitLikelihood

    def value(self, name: str) -> tuple[float, float]:
        """Return an estimate and its standard error; a width in place of its logarithm."""
        k = self.names.index(name)
        value, stderr = float(self.theta[k]), float(np.sqrt(self.covariance[k, k]))
        if name in WIDTHS:
            return float(np.exp(value)), float(np.exp(value)) * stderr
        return value, stderr

    @property
    def convergence(self) -> Convergence:
        """End of the search; the change is the remaining step in standard errors."""
        maximum = self.maximum
        covariance = invert_information(maximum.information, ~maximum.active)
        stderr = np.sqrt(np.diag(covariance))[~maximum.active]
        step = np.abs(maximum.remaining[~maximum.active]) / stderr
        share = float(step.max(initial=0.0)) / PROVEN
        return Convergence(maximum.converged, maximum.iterations, share)

    @property
    def stationary_within(self) -> float:
        """Largest width of the estimates at a stationary end, in standard errors; NaN without."""
        if not len(self.maximum.width):
            return np.nan
        return float(self.maximum.width[: len(self.names)].max())

    def change(self, windows: Sequence[FreeWindow], rows: Sequence[DrivenRows]) -> np.ndarray:
        """Return the change of the estimates (names,) if the records were these, to first order."""
        other = self.likelihood.with_records(windows, rows)
        theta = self.maximum.theta
        before, after = self.likelihood.residuals(theta), other.residuals(theta)
        g = np.zeros(len(theta))
        for columns, S, noise, v, w in zip(
            self.likelihood.layout.columns,
            self.maximum.slopes,
            self.maximum.noise,
            before,
            after,
        ):
            g[columns] += ((w - v) / noise).ravel() @ S.reshape(-1, S.shape[2])
        free = np.ones(len(theta), bool)
        return (invert_information(self.maximum.information, free) @ g)[: len(self.names)]


class CircuitStart(NamedTuple):
    """Where a search begins.

    Attributes
    ----------
    width : float
        First width of friction over the largest rate or the range of the travel.
    preload_width : float
        First width of the preload over the range of the travel.
    values : mapping of str to float
        Unknowns that do not begin at the regressions, starts of windows among them.
    """

    width: float = WIDE
    preload_width: float = WIDE
    values: Mapping[str, float] = MappingProxyType({})

    @classmethod
    def at(cls, fit: CircuitFit) -> CircuitStart:
        """Return the start at the end of a search with the other model of friction."""
        names = fit.likelihood.layout.names
        return cls(values=dict(zip(names, fit.maximum.theta.tolist())))


def fit_circuit(
    loading: ControlLoading,
    windows: Sequence[FreeWindow],
    rows: Sequence[DrivenRows],
    start: Mapping[str, float],
    prior: Mapping[str, tuple[float, float]],
    width: str = FRICTION_RATE,
    beyond: float = np.inf,
    begin: CircuitStart | None = None,
) -> CircuitFit:
    """Return the constants of a circuit by maximum likelihood.

    Parameters
    ----------
    loading : ControlLoading
    windows : sequence of FreeWindow
    rows : sequence of DrivenRows
    start : mapping of str to float
        First values of all constants, from the regressions.
    prior : mapping of str to (float, float)
        A-priori values and standard errors.
    width : {"friction_rate", "bristle_travel"}
        Width over which friction is developed: a rate, or a travel.
    beyond : float
        Cost above which the search ends early if no step promises less.
    begin : CircuitStart, optional
        Where the search begins; without it, at the regressions with a wide width.

    Raises
    ------
    IdentificationError
        A window with more unknowns than the kernel has room for.
    """
    begin = begin or CircuitStart()
    unknowns = _common_unknowns(start, prior) | _with_widths(start, windows, width)
    layout = _lay_out_records(unknowns, windows, len(rows))
    _demand_room(windows, layout, len(unknowns))
    first = layout.start.copy()
    values = {**start, **begin.values}
    for k, name in enumerate(layout.names):
        if name in values:
            first[k] = values[name]
    first[layout.names.index(width)] += np.log(begin.width / WIDE)
    if PRELOAD_TRAVEL in layout.names:
        first[layout.names.index(PRELOAD_TRAVEL)] += np.log(begin.preload_width / WIDE)
    first = np.clip(first, layout.low, layout.high)
    likelihood = CircuitLikelihood(loading, windows, rows, layout, start)
    maximum = maximise_kinked(likelihood, _ITERATIONS, first, beyond)
    return _fit_of(maximum, likelihood, tuple(unknowns))


def _demand_room(windows: Sequence[FreeWindow], layout: UnknownVector, common: int) -> None:
    """Raise if a window has more unknowns than the kernel has room for."""
    problems = []
    for window, names in zip(windows, layout.bases):
        if len(names) > MOST_UNKNOWNS:
            problems.append(
                f"the window {time_text(window.time[0])}-{time_text(window.time[-1])} s has "
                f"{len(names)} unknowns, "
                f"{common} of the circuit and {len(window.edges)} jumps of the force among them; "
                f"at most {MOST_UNKNOWNS} are possible: divide the window, or give fewer terms "
                "or nodes"
            )
    if problems:
        raise IdentificationError("; ".join(problems))


def _with_widths(
    start: Mapping[str, float], windows: Sequence[FreeWindow], width: str
) -> dict[str, Unknown]:
    """Return the logarithms of both widths as unknowns.

    A wide start makes the likelihood smooth; the search narrows it. No width is larger than the
    motion.
    """
    span, rate = largest_motion(windows)
    sizes = {width: rate if width == FRICTION_RATE else span}
    if "preload" in start:
        sizes[PRELOAD_TRAVEL] = span
    widths = {}
    for name, size in sizes.items():
        least_part = _LEAST_BRISTLE if name == BRISTLE_TRAVEL else _LEAST
        first, least = np.log(WIDE * size), np.log(least_part * size)
        widths[name] = Unknown(first, _WIDTH_ERROR, least, float(np.log(size)))
    return widths


def _fit_of(
    maximum: LikelihoodMaximum,
    likelihood: CircuitLikelihood,
    names: tuple[str, ...],
) -> CircuitFit:
    """Return estimates and standard errors at the end of a search."""
    count = len(names)
    covariance = _admit_scatter(
        _covariance(maximum, likelihood)[:count, :count],
        _scatter_covariance(maximum, likelihood, count)[:count, :count],
    )
    if len(maximum.width):
        # The maximum may be anywhere within this distance.
        white = np.diag(invert_information(maximum.information, ~maximum.active))
        covariance += np.diag(maximum.width[:count] ** 2 * white[:count])
    return CircuitFit(
        names=names,
        theta=maximum.theta[:count],
        covariance=covariance,
        rms=_output_rms(maximum, len(likelihood.windows)),
        maximum=maximum,
        likelihood=likelihood,
    )


def _common_unknowns(
    start: Mapping[str, float],
    prior: Mapping[str, tuple[float, float]],
) -> dict[str, Unknown]:
    """Return the constants as unknowns, with a-priori values and bounds."""
    unknowns = {}
    for name, value in start.items():
        low = -np.inf
        if name in _POSITIVE:
            low = _LEAST_PART * abs(value)
        elif name in _NOT_NEGATIVE:
            low = 0.0
        known, sigma = prior.get(name, (value, np.inf))
        unknowns[name] = Unknown(max(known, low), sigma, low)
    return unknowns


def _lay_out_records(
    unknowns: Mapping[str, Unknown], windows: Sequence[FreeWindow], rows: int
) -> UnknownVector:
    """Return the vector of common unknowns, then those of each window."""
    count = len(unknowns)
    layout = lay_out(unknowns, [{}] * (len(windows) + rows))
    names, fields, columns = list(layout.names), [], []
    bases = []
    for number, window in enumerate(windows, start=1):
        own = window.starts()
        columns.append(np.r_[np.arange(count), len(names) + np.arange(len(own))])
        bases.append((*unknowns, *own))
        for name, value in own.items():
            names.append(f"{name}@{number}")
            if name.startswith(EDGE):
                fields.append((value, _ANYWHERE, 0.0, 1.0))
            elif name.startswith(ERROR):
                sigma = window.errors[int(name.removeprefix(ERROR)) - 1][1]
                fields.append((value, sigma, -np.inf, np.inf))
            else:
                # Wide; without a cable the surface has no start of its own.
                fields.append(
                    (
                        value,
                        _FAR * np.ptp(window.measured[:, 0]) * window.scale[0],
                        -np.inf,
                        np.inf,
                    )
                )
    for _ in range(rows):
        columns.append(np.arange(count))
        bases.append(tuple(unknowns))
    own_fields = np.array(fields).reshape(-1, 4).T
    joined = []
    for common, added in zip((layout.start, layout.sigma, layout.low, layout.high), own_fields):
        joined.append(np.concatenate([common, added]))
    return UnknownVector(tuple(names), tuple(bases), tuple(columns), *joined)


def _covariance(maximum: LikelihoodMaximum, likelihood: CircuitLikelihood) -> np.ndarray:
    """Return the covariance of all unknowns for coloured residuals.

    Free and driven motion have different outputs: the covariance is formed for each and joined,
    D (I_1 + I_2 + P) D with the inner matrices I, the prior P and D, the inverse of M.
    """
    columns = likelihood.layout.columns
    count = len(likelihood.windows)
    # An unknown at a bound has the error that it would have without the bound.
    free = replace(maximum, active=np.zeros_like(maximum.active))
    total = np.zeros_like(maximum.information)
    parts = 0
    for place in (slice(0, count), slice(count, None)):
        both: list[Any] = [*likelihood.windows, *likelihood.rows]
        pieces = both[place]
        if pieces:
            part = replace(
                free,
                residuals=maximum.residuals[place],
                slopes=maximum.slopes[place],
                noise=maximum.noise[place],
            )
            steps = [piece.step for piece in pieces]
            covariance, _ = coloured_likelihood_covariance(part, columns[place], steps)
            total += covariance
            parts += 1
    # Each part counts the information of the other one as known.
    D = invert_information(maximum.information, ~free.active)
    return total - (parts - 1) * D


def _scatter_covariance(
    maximum: LikelihoodMaximum, likelihood: CircuitLikelihood, constants: int
) -> np.ndarray:
    """Return the covariance of all unknowns by the scatter of the records' gradients.

    Residuals of one window may be correlated in any way, as those of a wrong model are. Few records
    scatter too little, because they have been fitted: hence the factor n / (n - constants).

    References
    ----------
    .. [Liang1986] Liang, Zeger, Longitudinal data analysis using generalized linear models,
       Biometrika 73, 1986.
    """
    columns = likelihood.layout.columns
    inner = np.zeros_like(maximum.information)
    for at, S, noise, v in zip(columns, maximum.slopes, maximum.noise, maximum.residuals):
        g = (v / noise).ravel() @ S.reshape(-1, S.shape[2])
        inner[np.ix_(at, at)] += np.outer(g, g)
    D = invert_information(maximum.information, np.ones(len(inner), bool))
    count = len(columns)
    factor = count / max(1, count - constants)
    return factor * D @ inner @ D


def _admit_scatter(coloured: np.ndarray, scatter: np.ndarray) -> np.ndarray:
    """Return a covariance with the larger standard error of two, and the correlation of the first.

    What the records scatter beyond their coloured residuals is an error of the model.
    """
    first, second = (np.sqrt(np.maximum(np.diag(C), 0.0)) for C in (coloured, scatter))
    ratio = np.where(first > 0.0, np.maximum(1.0, second / np.where(first > 0.0, first, 1.0)), 1.0)
    return coloured * np.outer(ratio, ratio)


def _output_rms(maximum: LikelihoodMaximum, windows: int) -> dict[str, float]:
    """Return the residual of each end in free motion over the noise of its pick-up."""
    squares = np.concatenate(maximum.residuals[:windows]) ** 2
    return dict(zip(("travel", "surface"), np.sqrt(squares.mean(axis=0)).tolist()))
