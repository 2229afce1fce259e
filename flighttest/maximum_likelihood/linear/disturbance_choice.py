"""Disturbances that a record does not need, or does not distinguish.

The spectra of white noise in two rates and of a gust overlap. A record may fit either, and then the
likelihood of both together is a flat ridge without a maximum on which a search does not converge.
The likelihood ratio with one of the two alone shows it [Jategaonkar]_. In calm air the record fits
neither: what the disturbance then explains is the noise of the instruments.

References
----------
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from flightmech.errors import AeromatchWarning, IdentificationError
from flighttest.maximum_likelihood.innovations import whiteness_variables
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust
from flighttest.maximum_likelihood.result import CALM, UNDETERMINED, OutputError
from flighttest.maximum_likelihood.unknowns import Unknown, Wanted

_CHANCE = 0.05  # probability that a disturbance that does not exist seems to be needed
# Fall of the cost below that of the filter from which on the filter is not at its maximum: output
# error is the filter without disturbances, and both searches end within about a tenth. [nats]
_STUCK = 0.1
_GUST_KINDS = ("gust", "scale", "turn")
_INTENSITIES = ("process", "gust")
_FILTER_KINDS = ("process", "noise", *_GUST_KINDS)

Refit = Callable[[Wanted, Sequence[DrydenGust]], OutputError]
CalmFit = Callable[[Wanted], OutputError]


def prefer_calm(
    fit: OutputError,
    parameters: Wanted,
    gusts: Sequence[DrydenGust],
    fit_calm: CalmFit,
    readings: int,
) -> OutputError:
    """Return the fit by output error if it is as likely as that with disturbances.

    The cost of output error without its constant and that of the filter without a disturbance
    differ by half the number of readings. The limit of twice the fall of the cost is the value of
    chi-squared that 5 % exceed, with as many degrees of freedom as there are unknown intensities,
    scales, factors of rotation and gusts, whose first value is an unknown too. Chi-squared is
    approximate here: an intensity cannot fall below zero, and a scale has no effect without one.

    Parameters
    ----------
    fit : OutputError
        With disturbances.
    parameters : mapping of str to Unknown, tuple or float
        Its unknowns.
    gusts : sequence of DrydenGust
    fit_calm : callable
        From unknowns to the fit of the same records by output error.
    readings : int
        Number of all readings.

    Returns
    -------
    OutputError
        That of output error with the test of its residuals, and with the attribute `CALM` of the
        estimates, a text; or as given, also if an intensity is given or has a prior, or if the
        filter did not converge, because its cost is then not that of its maximum. A filter whose
        cost is above that of output error has a warning.
    """
    kinds = {name: name.split(".")[0] for name in parameters}
    is_given = any(f"gust.{gust.name}" not in parameters for gust in gusts)
    for name, item in parameters.items():
        unknown = Unknown(*item) if isinstance(item, tuple) else Unknown(item)
        is_given |= kinds[name] in _INTENSITIES and math.isfinite(unknown.sigma)
    calm_parameters = {}
    for name, item in parameters.items():
        if kinds[name] not in _FILTER_KINDS and not name.startswith("init.gust_"):
            calm_parameters[name] = item
    dropped = sum(kind in ("process", *_GUST_KINDS) for kind in kinds.values())
    dropped += len(gusts)
    if is_given or not dropped or not calm_parameters:
        return fit
    try:
        with warnings.catch_warnings():
            # Turbulence, of which output error warns, is what the comparison is about.
            warnings.simplefilter("ignore", AeromatchWarning)
            calm = fit_calm(calm_parameters)
    except IdentificationError:
        return fit
    rise = float(calm.estimates.attrs["cost"]) + 0.5 * readings - float(fit.estimates.attrs["cost"])
    limit = 0.5 * float(chi2.isf(_CHANCE, dropped))
    if rise < -_STUCK:
        text = (
            f"the search of the filter error ended {-rise:.2g} nats above output error, which it "
            f"contains: it is not at its maximum; change the starts of the process noise or "
            f"estimate by output error"
        )
        return replace(fit, warnings=(*fit.warnings, text))
    both_converged = fit.estimates.attrs["converged"] and calm.estimates.attrs["converged"]
    if rise >= limit or not both_converged:
        return fit
    text = (
        f"no process noise is identified: without it the cost rises by {rise:.2g} nats "
        f"(limit {limit:.2g}); the estimates are those of output error"
    )
    parts = [np.nan_to_num(residual.to_array().values.T) for residual in calm.residuals]
    steps = [float(residual["time"].diff("time").mean()) for residual in calm.residuals]
    return replace(
        calm,
        estimates=calm.estimates.assign_attrs({CALM: text}),
        noise=calm.noise.merge(whiteness_variables(parts, steps)),
    )


def compare_disturbances(
    fit: OutputError, parameters: Wanted, gusts: Sequence[DrydenGust], refit: Refit
) -> OutputError:
    """Return a fit with both disturbances, and what one of them alone gives if it did not converge.

    Parameters
    ----------
    fit : OutputError
    parameters : mapping of str to Unknown, tuple or float
        Its unknowns.
    gusts : sequence of DrydenGust
    refit : callable
        From unknowns and gusts to a fit of the same records.

    Returns
    -------
    OutputError
        With the attribute `UNDETERMINED` of the estimates, a text, if one disturbance alone is as
        likely; otherwise as given.
    """
    kinds = {name: name.split(".")[0] for name in parameters}
    is_settled = fit.estimates.attrs["converged"] or CALM in fit.estimates.attrs
    if is_settled or not gusts or "process" not in kinds.values():
        return fit
    white = {name: item for name, item in parameters.items() if _is_kept(name, kinds[name])}
    still = {name: item for name, item in parameters.items() if kinds[name] != "process"}
    cases = {
        "white process noise (process.*)": (white, ()),
        "gusts": (still, tuple(gusts)),
    }
    close, other = [], []
    for name, (wanted, kept) in cases.items():
        try:
            alone = refit(wanted, kept)
        except IdentificationError:
            continue
        excess = alone.estimates.attrs["cost"] - fit.estimates.attrs["cost"]
        dropped = fit.estimates.sizes["parameter"] - alone.estimates.sizes["parameter"]
        # Twice the difference of the costs has this distribution if the disturbance is not there.
        limit = 0.5 * float(chi2.isf(_CHANCE, dropped))
        text = f"{name} alone {excess:+.2g} nats (limit {limit:.2g})"
        if excess < limit and alone.estimates.attrs["converged"]:
            close.append((name, text))
        else:
            other.append(text)
    if not close:
        return fit
    texts = [text for _, text in close] + other
    choice, finding = close[0][0], f"the records determine no disturbance besides {close[0][0]}"
    if len(close) > 1:
        choice = "one of them"
        finding = "the records do not distinguish white process noise from gusts"
    text = f"not identifiable: {finding}; cost with {', '.join(texts)}; choose {choice}"
    return replace(fit, estimates=fit.estimates.assign_attrs({UNDETERMINED: text}))


def _is_kept(name: str, kind: str) -> bool:
    """Return whether an unknown exists without gusts."""
    return kind not in _GUST_KINDS and not name.startswith("init.gust_")
