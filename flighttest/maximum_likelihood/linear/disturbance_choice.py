"""White process noise and gusts that a record does not distinguish.

The spectra of white noise in two rates and of a gust overlap. A record may fit either, and then the
likelihood of both together is a flat ridge without a maximum on which a search does not converge.
The likelihood ratio with one of the two alone shows it [Jategaonkar]_.

References
----------
.. [Jategaonkar] Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch. 5.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from scipy.stats import chi2

from flightmech.errors import IdentificationError
from flighttest.maximum_likelihood.linear.gust_states import DrydenGust
from flighttest.maximum_likelihood.result import UNDETERMINED, OutputError
from flighttest.maximum_likelihood.unknowns import Wanted

_CHANCE = 0.05  # probability that a disturbance that does not exist seems to be needed
_GUST_KINDS = ("gust", "scale")

Refit = Callable[[Wanted, Sequence[DrydenGust]], OutputError]


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
    if fit.estimates.attrs["converged"] or not gusts or "process" not in kinds.values():
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
