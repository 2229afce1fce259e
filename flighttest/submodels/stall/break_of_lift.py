"""Whether records show a break of the lift.

A separation has six parameters and fits any bend of a lift curve. Records show a stall by one of
two signs: the slope of the lift falls below half of its attached value, or a separation describes
the lift better than a straight line with a curvature. A soft break needs the first sign, as a
curved line describes it as well. A break near the highest angle of attack needs the second. A bend
upwards, as of a vortex, is none of them, however well a separation with added lift describes it.
Nor is a lift of which the separation itself keeps more than half of the slope in steady flow: with
little noise a separation describes a cubic lift better than a parabola does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.regression.expression_functions import Pieces
from flighttest.regression.separable.search import SeparableProblem
from flighttest.regression.uncertainty.coloured_residuals import coloured_covariance_of
from flighttest.submodels.ground_effect.evidence import independent_samples, schwarz_criterion
from flighttest.submodels.stall.flow import SIDES

LEAST_ALPHA = np.radians(8.0)
"""Angle of attack that a record of a stall reaches; our number, below that of an iced wing."""
LEAST_EVIDENCE = 10.0
"""Difference of Schwarz's criterion from which on a form is very strongly preferred [Raftery95]_.

.. [Raftery95] Raftery, A. E.: Bayesian model selection in social research. Sociological
   Methodology 25, 1995, 111-163, table 6.
"""
LEAST_SLOPE = 0.5
"""Share of the attached slope of the lift below which it has a break; our number.

The lift that is only curved keeps 0.8 of its slope in the checks of this number.
"""
STANDARD_ERRORS = 2.0
"""Distance from `LEAST_SLOPE` from which on the share is decided. [standard errors]"""
_TOO_FEW = 30.0  # independent samples that a comparison needs
_SQUARE = "alpha^2"
_RANK, _SMALLEST = 1e-8, 1e-30  # of unit regressors, and of their length
_STEADY, _MANY_CHORDS = 60, 1e5  # angles of attack of a steady lift, chords between two of them
_ENDS = (0.01, 0.99)  # quantiles of the angle of attack at which the slopes are taken


class NodeFit(NamedTuple):
    """A coefficient along the records of one configuration, with the design of the fit.

    `z` (sample,) is the coefficient, `A` (sample, term) the design, `separated` states for each
    term whether it is one of the separated flow, and `shapes` is the number of parameters of the
    separation. `steady` (angle, 1 + term) are angles of attack [rad], up to the highest of the
    records, and the design there in steady flow; empty if it is not known.
    """

    z: np.ndarray
    A: np.ndarray
    terms: tuple[str, ...]
    separated: tuple[bool, ...]
    shapes: int
    samples: RegressionSamples
    steady: np.ndarray = np.empty((0, 0))


def demand_stall_records(data: Sequence[xr.Dataset]) -> None:
    """Raise if no record reaches an angle of attack at which a wing separates.

    Records without alpha are left to `demand_channels`.
    """
    reached = [float(record["alpha"].max()) for record in data if "alpha" in record]
    highest = max(reached, default=LEAST_ALPHA)
    if highest < LEAST_ALPHA:
        raise IdentificationError(
            f"the records reach an angle of attack of {np.rad2deg(highest):.3g} deg; no wing "
            f"separates below {np.rad2deg(LEAST_ALPHA):.3g} deg, so they show no stall and any "
            f"separation would be a curve in attached flow: give records of stalls, flown through "
            f"the break of the lift"
        )


def reach_of_halves(records: Sequence[xr.Dataset]) -> float:
    """Return the highest angle of attack of both wing halves of some records. [rad]"""
    highest = -np.inf
    for record in records:
        for side in SIDES:
            highest = max(highest, float(record[f"alpha_{side}"].max()))
    return highest


def database_slope(flown: Sequence[xr.Dataset], records: Sequence[xr.Dataset]) -> float:
    """Return the slope of the lift over alpha of the database that was subtracted. [rad-1]

    Parameters
    ----------
    flown, records : sequence of Dataset (time,)
        The same records with the total lift, and with that on top of the database.
    """
    alpha = np.concatenate([record["alpha"].values for record in flown])
    pairs = zip(flown, records, strict=True)
    lift = np.concatenate([(total["CL"] - rest["CL"]).values for total, rest in pairs])
    known = np.isfinite(lift)
    return float(np.polyfit(alpha[known], lift[known], 1)[0])


def steady_design(
    problem: SeparableProblem, s: np.ndarray, records: Sequence[xr.Dataset]
) -> np.ndarray:
    """Return angles of attack and the design of the lift there in steady, straight flow."""
    low = min(float(record["alpha"].min()) for record in records)
    alpha = np.linspace(low, reach_of_halves(records), _STEADY)
    quantities = {}
    for name, flown in problem.quantities[0].items():
        quantities[name] = np.full(_STEADY, float(np.median(flown)))
    for name in ("alpha", "alpha_left", "alpha_right"):
        quantities[name] = alpha
    for name in ("lead_left", "lead_right", "phat", "qhat", "rhat", "beta"):
        quantities[name] = np.zeros(_STEADY)
    # so many chords pass from one angle to the next that no lag is left
    quantities["chords"] = np.full(_STEADY, _MANY_CHORDS)
    values = dict(zip(problem.names, s, strict=True))
    pieces = Pieces([slice(0, _STEADY)], [1.0])
    design, _ = problem.models[0].columns(quantities, _STEADY, values, pieces)
    return np.column_stack([alpha, design])


class LiftBreak(NamedTuple):
    """Signs of a break of the lift.

    `preference` is the difference of Schwarz's criterion by which the separation is better than a
    curved lift, and `others` the sum of those of drag and pitching moment. `start` and `end` are
    the slopes of the curved lift at the lowest and the highest angle of attack, and `stderr` is the
    standard error of `margin` [rad-1]. They are nan without a term ``alpha``. `gain` is the mean
    lift of the terms of the separated flow, negative for a stall. `kept` is the least share of its
    slope that the separation leaves in steady flow; nan if it is not known.
    """

    preference: float
    start: float = np.nan
    end: float = np.nan
    stderr: float = np.nan
    others: float = 0.0
    gain: float = 0.0
    kept: float = np.nan

    @property
    def margin(self) -> float:
        """Slope at the highest angle of attack less `LEAST_SLOPE` of that at the lowest. [rad-1]"""
        return self.end - LEAST_SLOPE * self.start

    @property
    def is_shown(self) -> bool:
        """Whether one of the two signs is clear."""
        falls = self.start > 0.0 and self.margin < -STANDARD_ERRORS * self.stderr
        separates = self.preference >= LEAST_EVIDENCE and not self.rises
        return (separates and not self.kept >= LEAST_SLOPE) or falls

    @property
    def rises(self) -> bool:
        """Whether the lift bends upwards, and the terms of the separated flow add lift."""
        return self.gain > 0.0 and self.end > self.start > 0.0

    @property
    def is_absent(self) -> bool:
        """Whether neither sign is there, and the slope clearly stays above its limit."""
        return not self.is_shown and self.margin > STANDARD_ERRORS * self.stderr

    @property
    def is_soft(self) -> bool:
        """Whether curved coefficients without a separation describe the break as well."""
        return self.is_shown and self.preference + self.others < LEAST_EVIDENCE

    def describe(self) -> str:
        """Return both signs as text."""
        criterion = (
            f"against a curved lift the separation has the criterion {-self.preference:+.3g}, a "
            f"break needs {-LEAST_EVIDENCE:g} or less"
        )
        if self.rises:
            criterion += "; but the lift bends upwards, and a separation takes lift away"
        if self.kept >= LEAST_SLOPE:
            criterion += (
                f"; the separation keeps {100.0 * self.kept:.0f} % of the slope in steady flow, a "
                f"break less than {100.0 * LEAST_SLOPE:.0f} %"
            )
        if np.isnan(self.start):
            return criterion
        return (
            f"the slope of the lift goes from {self.start:.2f} to {self.end:.2f} per rad, a break "
            f"needs less than {LEAST_SLOPE * self.start:.2f} by {STANDARD_ERRORS:g} standard "
            f"errors of {self.stderr:.2g}; {criterion}"
        )


class _Curved(NamedTuple):
    """Fit without a separation: names of terms, regressors, coefficients and residual."""

    names: list[str]
    A: np.ndarray
    theta: np.ndarray
    residual: np.ndarray


def _fit_curved(node: NodeFit) -> _Curved:
    """Return the fit of the terms of the attached flow and the square of the angle of attack."""
    columns = {}
    for name, far, column in zip(node.terms, node.separated, node.A.T, strict=True):
        if not far:
            columns[name] = column
    if "alpha" in columns:
        columns.setdefault(_SQUARE, columns["alpha"] ** 2)
    # a flap that does not move in the records of one configuration repeats the constant
    names: list[str] = []
    A = np.empty((len(node.z), 0))
    first = [name for name in ("alpha", _SQUARE) if name in columns]
    for name in dict.fromkeys([*first, *columns]):
        length = np.linalg.norm(columns[name])
        wider = np.column_stack([A, columns[name] / max(length, _SMALLEST)])
        if np.linalg.svd(wider, compute_uv=False)[-1] > _RANK:
            A = wider
            names.append(name)
    A *= [np.linalg.norm(columns[name]) for name in names]
    theta = np.linalg.lstsq(A, node.z, rcond=None)[0]
    return _Curved(names, A, theta, node.z - A @ theta)


def _kept_slope(node: NodeFit, theta: np.ndarray, slope: float) -> float:
    """Return the least slope of the lift in steady flow over that at its start."""
    if not len(node.steady):
        return np.nan
    alpha, design = node.steady[:, 0], node.steady[:, 1:]
    slopes = np.diff(design @ theta) / np.diff(alpha) + slope
    return float(slopes.min() / slopes[0]) if slopes[0] > 0.0 else np.nan


def _preference(node: NodeFit, curved: _Curved) -> tuple[float, float, np.ndarray]:
    """Return by how much Schwarz's criterion prefers the separation to a curved coefficient.

    The second value is the mean part of the separated flow in the coefficient, the third are the
    coefficients of the terms.
    """
    theta = np.linalg.lstsq(node.A, node.z, rcond=None)[0]
    rest = node.z - node.A @ theta
    part = node.A @ np.where(node.separated, theta, 0.0)
    n = max(independent_samples(rest, node.samples), _TOO_FEW)
    broken = schwarz_criterion(rest, node.A.shape[1] + node.shapes, n)
    preference = schwarz_criterion(curved.residual, curved.A.shape[1], n) - broken
    return preference, float(part.mean()), theta


def weigh_break(lift: NodeFit, others: Sequence[NodeFit] = (), slope: float = 0.0) -> LiftBreak:
    """Return the signs of a break in a lift.

    Parameters
    ----------
    lift : NodeFit
    others : sequence of NodeFit
        Drag and pitching moment. One without a term of the separated flow shows nothing.
    slope : float
        Slope of a database which the lift does not contain. [rad-1]
    """
    curved = _fit_curved(lift)
    preference, gain, theta = _preference(lift, curved)
    kept = _kept_slope(lift, theta, slope)
    support = 0.0
    for node in others:
        if any(node.separated):
            support += _preference(node, _fit_curved(node))[0]
    if "alpha" not in curved.names:
        return LiftBreak(preference, others=support, gain=gain, kept=kept)
    # slopes at both ends, and their covariance, from the coefficients of alpha and its square
    chosen = [curved.names.index("alpha"), curved.names.index(_SQUARE)]
    low, high = np.quantile(curved.A[:, chosen[0]], _ENDS)
    pieces, steps = lift.samples.pieces()
    covariance = coloured_covariance_of(curved.A, curved.residual, pieces, steps).covariance
    ends = np.array([[1.0, 2.0 * low], [1.0, 2.0 * high]])
    start, end = ends @ curved.theta[chosen] + slope
    weights = np.array([-LEAST_SLOPE, 1.0]) @ ends
    variance = weights @ covariance[np.ix_(chosen, chosen)] @ weights
    return LiftBreak(
        preference,
        start=float(start),
        end=float(end),
        stderr=float(np.sqrt(variance)),
        others=support,
        gain=gain,
        kept=kept,
    )


def describe_missing_break(signs: LiftBreak, highest: float) -> str:
    """Return the reason why records that do not show a break of the lift do not.

    Parameters
    ----------
    signs : LiftBreak
    highest : float
        Highest flown angle of attack. [rad]
    """
    reach = f"up to the flown {np.rad2deg(highest):.1f} deg"
    if signs.is_absent:
        return (
            f"the lift shows no break {reach}: {signs.describe()}; give records of stalls, flown "
            "through the break of the lift"
        )
    return (
        f"undecided whether the lift breaks {reach}: {signs.describe()}; add stalls of the same "
        "configuration that are held for some seconds beyond the break, or records with less noise"
    )


def describe_soft_break(signs: LiftBreak) -> str:
    """Return why the shape of a soft break is not identified."""
    return (
        f"the slope of the lift falls from {signs.start:.2f} to {signs.end:.2f} per rad, which is "
        "a stall, but curves without a separation describe the coefficients as well (criterion "
        f"{-signs.preference - signs.others:+.3g}): the shape of the separation is an assumption"
    )
