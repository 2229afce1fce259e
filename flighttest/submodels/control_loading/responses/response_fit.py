"""End of an output error on a circuit, with remarks on what it does not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from flighttest.remarks import Convergence, Remark
from flighttest.submodels.control_loading.responses.direct_search import DISTANCES
from flighttest.submodels.control_loading.responses.window_response import (
    BRISTLE_TRAVEL,
    FRICTION_RATE,
)

# Standard errors from which on a nuisance is remarked; misfit over noise from which on it is.
_CERTAIN, _MISFIT = 3.0, 2.0
# Growth of a standard error by another model of friction from which on it is remarked.
_WIDENED = 1.05
# Names of the models of friction by that of their width.
FRICTION_MODELS = {FRICTION_RATE: "by the rate", BRISTLE_TRAVEL: "over a travel"}


@dataclass(frozen=True)
class ResponseFit:
    """Output error on a circuit.

    Attributes
    ----------
    convergence : Convergence
        End of the search.
    windows : int
        Windows of free motion.
    rms : dict of str to float
        Residual of ``travel`` and ``surface`` over the white noise of their pick-ups.
    hand_damping : (float, float)
        Force over rate that driven records lack compared with free motion, and its standard error.
    widths : dict of str to (float, float)
        Rate at which friction is developed to 76 %, or travel over which it builds up to 63 %, and
        travel at which the preload is developed to 76 %, with their standard errors. [m/s and m, of
        the wheel rad/s and rad]
    friction_models : dict of str to float
        Weight of each model of friction by the name of its width, 0 to 1; the estimates are those
        of the likeliest, the standard errors contain the difference.
    widened : float
        Largest factor by which this difference widens a standard error.
    maxima : int
        Maxima of the likelier model that are nearly as likely as the best, itself included.
    widened_by_maxima : float
        Largest factor by which their differences widen a standard error.
    stationary_within : float
        Width of a stationary end in standard errors: the search stalled, but around its end the
        cost is higher everywhere beyond it. NaN without one.
    unfinished : sequence of str
        Models of friction whose search ended before its maximum: their weight is a lower limit.
    """

    convergence: Convergence
    windows: int
    rms: Mapping[str, float]
    hand_damping: tuple[float, float]
    widths: Mapping[str, tuple[float, float]]
    friction_models: Mapping[str, float]
    widened: float = 1.0
    maxima: int = 1
    widened_by_maxima: float = 1.0
    stationary_within: float = math.nan
    unfinished: Sequence[str] = ()

    @property
    def is_maximum(self) -> bool:
        """Whether the search converged or ended at a stationary place."""
        return self.convergence.converged or not math.isnan(self.stationary_within)

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on a force that driven and free motion do not share, on the misfit, and on models
        of friction and maxima between which the records do not decide.
        """
        remarks = []
        if not self.is_maximum:
            remarks = self.convergence.remarks(
                "output error of the circuit",
                "the likelihood still rises; give records with more motion, fewer terms, or "
                "drawings",
                severity="warning",
            )
        elif not self.convergence.converged:
            text = (
                f"output error of the circuit: stationary within {self.stationary_within:.2g} "
                f"standard errors, not converged: the search stalled after "
                f"{self.convergence.iterations} iterations where the likelihood is uneven. It is "
                f"lower at {DISTANCES[-1]:g} standard error in every direction that was tried; the "
                f"standard errors contain the width"
            )
            remarks.append(
                Remark(
                    "convergence",
                    text,
                    value=self.stationary_within,
                    threshold=DISTANCES[-1],
                    severity="note",
                )
            )
        value, stderr = self.hand_damping
        if abs(value) > _CERTAIN * stderr:
            text = (
                f"driven records have {value:.3g} +- {stderr:.2g} N per m/s less damping than free "
                f"motion: their force lacks a part proportional to the rate; damping is that of "
                f"free motion. Check filter and time of the force transducer"
            )
            remarks.append(
                Remark(
                    "disturbance",
                    text,
                    "damping",
                    value=value,
                    threshold=_CERTAIN * stderr,
                    severity="note",
                )
            )
        worst = max(self.rms, key=lambda name: self.rms[name])
        if self.rms[worst] > _MISFIT:
            text = (
                f"free motion: {worst} differs from its simulation by {self.rms[worst]:.2g} times "
                f"the noise of its pick-up; the standard errors contain the difference. Check the "
                f"times at which the force changes, and stops"
            )
            remarks.append(
                Remark(
                    "unexplained",
                    text,
                    worst,
                    value=self.rms[worst],
                    threshold=_MISFIT,
                    severity="note",
                )
            )
        if self.widened > _WIDENED:
            weights = []
            for width, weight in self.friction_models.items():
                weights.append(f"{FRICTION_MODELS[width]} {weight:.0%}")
            text = (
                f"the records do not decide how friction is developed: {', '.join(weights)} of the "
                f"likelihood; the difference widens a standard error {self.widened:.2g} times. "
                f"Pulses with small motion, and a faster pick-up of the travel, would decide"
            )
            remarks.append(
                Remark(
                    "friction model",
                    text,
                    "friction",
                    value=self.widened,
                    threshold=_WIDENED,
                    severity="note",
                )
            )
        if self.widened_by_maxima > _WIDENED:
            text = (
                f"the likelihood has {self.maxima} maxima that are nearly equal; their differences "
                f"widen a standard error {self.widened_by_maxima:.2g} times. Further releases, "
                f"and a faster pick-up of the travel, would decide"
            )
            remarks.append(
                Remark(
                    "several maxima",
                    text,
                    "friction",
                    value=self.widened_by_maxima,
                    threshold=_WIDENED,
                    severity="note",
                )
            )
        return remarks
