"""Whether records show a break of the lift: the separation against a lift without one.

A separation has six parameters and fits any bend of a lift curve. Only if it describes the flown
lift better than a straight line with a slight curvature, the records show a stall.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.errors import IdentificationError
from flighttest.regression.equation_error.samples import RegressionSamples
from flighttest.submodels.ground_effect.evidence import independent_samples, schwarz_criterion
from flighttest.submodels.stall.flow import SIDES

LEAST_ALPHA = np.radians(8.0)
"""Angle of attack that a record of a stall reaches; our number, below that of an iced wing."""
LEAST_EVIDENCE = 10.0
"""Difference of Schwarz's criterion from which on a form is very strongly preferred [Raftery95]_.

.. [Raftery95] Raftery, A. E.: Bayesian model selection in social research. Sociological
   Methodology 25, 1995, 111-163, table 6.
"""
_TOO_FEW = 30.0  # independent samples that a comparison needs


class NodeLift(NamedTuple):
    """Lift of the records of one configuration, with the design of the fit.

    `z` (sample,) is the lift, `A` (sample, term) the design, `separated` states for each term whether
    it is one of the separated flow, and `shapes` is the number of parameters of the separation.
    """

    z: np.ndarray
    A: np.ndarray
    terms: tuple[str, ...]
    separated: tuple[bool, ...]
    shapes: int
    samples: RegressionSamples


def demand_stall_records(data: Sequence[xr.Dataset]) -> None:
    """Raise if no record reaches an angle of attack at which a wing separates."""
    highest = max(float(record["alpha"].max()) for record in data)
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


def weigh_break(lift: NodeLift) -> float:
    """Return by how much Schwarz's criterion prefers the separation to a lift without one.

    The lift without a separation has the terms of the attached flow and the square of the angle of
    attack.

    Returns
    -------
    float
        Positive: the separation describes the lift better.
    """
    is_separated = np.array(lift.separated)
    smooth = [lift.A[:, ~is_separated]]
    if "alpha" in lift.terms:
        smooth.append(lift.A[:, [lift.terms.index("alpha")]] ** 2)
    plain = np.hstack(smooth)
    residuals = [lift.z - A @ np.linalg.lstsq(A, lift.z, rcond=None)[0] for A in (lift.A, plain)]
    n = max(independent_samples(residuals[0], lift.samples), _TOO_FEW)
    broken = schwarz_criterion(residuals[0], lift.A.shape[1] + lift.shapes, n)
    return schwarz_criterion(residuals[1], plain.shape[1], n) - broken


def describe_smooth_lift(lift: NodeLift, highest: float) -> str:
    """Return the reason why the records show no break of the lift; empty if they do.

    Parameters
    ----------
    lift : NodeLift
    highest : float
        Highest flown angle of attack. [rad]
    """
    preference = weigh_break(lift)
    if preference >= LEAST_EVIDENCE:
        return ""
    return (
        f"the lift shows no break up to the flown {np.rad2deg(highest):.1f} deg: without a separation "
        f"it is described as well (criterion {-preference:+.3g}, a break needs "
        f"{-LEAST_EVIDENCE:g} or less)"
    )
