"""Size of the controls: effect of a control in flight over its a-priori effect.

A pick-up of half the gain gives twice the derivatives, and a model that flies the record as well.
Neither the fits nor a match of recorded deflections shows it.  The a-priori tables do, if the
ratio is one that no aerodynamics explains: handbook methods compute a sealed, rigid surface.  Gaps,
cables and boundary layer take away from its effect, and nothing adds much to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.update.observations import (
    CoefficientTerms,
    Observation,
    coefficient_of,
    observe_fits,
)
from flightmech import terms as _terms

COLUMNS = ("coefficient", "ratio", "stderr", "prior_stderr", "fits", "damping", "others")
_START = "size of "  # of a warning
LEAST, MOST = 0.35, 1.3
"""Effect in flight over the a-priori one, beyond which the size of a control is doubted.

The records of the T-37, the C182 and the commuter have 0.42 to 0.97.
"""
_CERTAIN = 3.0  # standard errors by which the ratio is beyond its limit
# A-priori standard errors that an effect must have to be compared, and by which the flights must
# differ from it: a guess of half the effect leaves room for both limits.
_KNOWN = 2.0
_EXPECTED = (0.7, 1.4)  # ratio of a damping that is as expected
# By control: coefficients in the order in which one is compared, and regressor of the damping.
_EFFECTS = {
    "delta_e": (("Cm", "CL", "CZ"), "qhat"),
    "delta_a": (("Cl", "Cn"), "phat"),
    "delta_r": (("Cn", "CY", "Cl"), "rhat"),
}


@dataclass(frozen=True)
class _ControlSize:
    """Estimates of one regressor over what the a-priori tables give; NaN if that is not known."""

    value: float
    stderr: float
    prior_stderr: float
    fits: int


def control_sizes(
    fits: Sequence[Any], prior: xr.DataTree, held: Sequence[str] = ()
) -> pd.DataFrame:
    """Return the effect of the controls in flight over their a-priori effect.

    Parameters
    ----------
    fits : sequence of Fit
        As in `aerodb.tabulate`.
    prior : DataTree
    held : sequence of str
        Terms that keep their values.

    Returns
    -------
    DataFrame
        Index control, for each that is a term of a fit; ``coefficient`` that is compared,
        ``ratio`` (NaN if the a-priori effect is zero or less than two of its standard errors),
        ``stderr`` of the fits, ``prior_stderr`` (of the a-priori effect, as a share of it),
        ``fits`` (number), ``damping`` (the same ratio of the rate derivative about this axis),
        ``others`` (ratios of the other coefficients, a text). [1]

    Raises
    ------
    SchemaError, UnknownName
        As in `aerodb.tabulate`.
    """
    wanted: set[str] = set()
    for coefficients, _ in _EFFECTS.values():
        wanted.update(coefficients)
    used = [fit for fit in fits if coefficient_of(fit) in wanted]
    observed: dict[str, tuple[CoefficientTerms, list[tuple[Any, Observation]]]] = {}
    for group, observations in observe_fits(used, prior, held):
        local = [fit for fit in used if coefficient_of(fit) == group.coefficient]
        observed[group.coefficient] = group, list(zip(local, observations, strict=True))
    rows, index = [], []
    for control, (coefficients, rate) in _EFFECTS.items():
        ratios = {}
        for name in coefficients:
            if name in observed:
                ratios[name] = _size_of(control, *observed[name])
        ratios = {name: ratio for name, ratio in ratios.items() if ratio.fits}
        if not ratios:
            continue
        known = [name for name, ratio in ratios.items() if np.isfinite(ratio.value)]
        first = known[0] if known else next(iter(ratios))
        damping = _size_of(rate, *observed[first])
        others = ", ".join(f"{name} {ratios[name].value:.2f}" for name in known[1:])
        ratio = ratios[first]
        errors = (ratio.stderr, ratio.prior_stderr)
        rows.append((first, ratio.value, *errors, ratio.fits, damping.value, others))
        index.append(control)
    return pd.DataFrame(rows, columns=list(COLUMNS), index=pd.Index(index, name="control"))


def _size_of(
    regressor: str, group: CoefficientTerms, observed: Sequence[tuple[Any, Observation]]
) -> _ControlSize:
    """Return the ratio of a regressor over all fits of a coefficient that have it as a term."""
    nodes = np.concatenate([leaf["value"].values.ravel() for leaf in group.free.values()])
    errors = np.concatenate([_errors_by(regressor, leaf) for leaf in group.free.values()])
    rows = list(_rows_of(regressor, observed, nodes, errors))
    if not rows:
        return _ControlSize(np.nan, np.nan, np.nan, 0)
    theta, expected, unknown, variance, common = np.array(rows).T
    # Where the a-priori effect may as well be zero, a ratio to it has no meaning.
    is_known = np.abs(expected) > _KNOWN * unknown
    if not is_known.any() or not (unknown[is_known] > 0.0).any():
        return _ControlSize(np.nan, np.nan, np.nan, len(rows))
    theta, expected, unknown, variance, common = (
        column[is_known] for column in (theta, expected, unknown, variance, common)
    )
    # Least squares of theta = ratio expected; the common errors are those of all fits at once.
    weight = expected / np.maximum(variance + common**2, np.finfo(float).tiny)
    weight = weight / float(weight @ expected)
    ratio = float(weight @ theta)
    own = np.maximum(variance, (theta - ratio * expected) ** 2)
    stderr = float(np.hypot(np.sqrt(weight**2 @ own), np.abs(weight) @ common))
    prior_stderr = float(np.abs(weight) @ unknown)
    return _ControlSize(ratio, stderr, prior_stderr, len(rows))


def _rows_of(
    regressor: str,
    observed: Sequence[tuple[Any, Observation]],
    nodes: np.ndarray,
    errors: np.ndarray,
) -> Iterator[tuple[float, ...]]:
    """Yield estimate, a-priori value and its error, variance and common error of each fit."""
    for fit, observation in observed:
        names = list(map(str, fit.estimates["term"].values))
        if regressor not in names:
            continue
        k = names.index(regressor)
        H = observation.H[k]
        variance, common = observation.C[k, k], float(np.linalg.norm(observation.D[k]))
        # The nodes of a table err alike: their errors add up.
        yield observation.theta[k], H @ nodes, np.abs(H) @ errors, variance, common


def _errors_by(regressor: str, leaf: xr.Dataset) -> np.ndarray:
    """Return the standard errors of the nodes of a term with the regressor; zeros for others."""
    stderr = leaf["stderr"].values.ravel()
    if regressor in _terms.list_model_variables(leaf):
        return stderr
    return np.zeros(stderr.size)


def doubtful_sizes(sizes: pd.DataFrame) -> dict[str, str]:
    """Return a warning for each control whose size no aerodynamics explains, by control.

    Parameters
    ----------
    sizes : DataFrame
        From `control_sizes`.
    """
    texts = {}
    for control, row in sizes.iterrows():
        margin = _CERTAIN * row["stderr"]
        if not (row["ratio"] - margin > MOST or row["ratio"] + margin < LEAST):
            continue
        if abs(row["ratio"] - 1.0) < _KNOWN * row["prior_stderr"]:
            continue
        rate = _EFFECTS[str(control)][1]
        also = f" and in {row['others']}" if row["others"] else ""
        # A wrong inertia or airspeed would change the damping as well.
        cause = "check the scale of its pick-up, inertia, airspeed and the a-priori tables"
        if _EXPECTED[0] <= row["damping"] <= _EXPECTED[1]:
            cause = (
                f"the damping by {rate} has {row['damping']:.2f}, as expected, so that the gain "
                f"of the recorded {control} is more likely wrong than inertia or airspeed"
            )
        texts[str(control)] = (
            f"{_START}{control}: the flights give {row['ratio']:.2f} (standard error "
            f"{row['stderr']:.2f}) of its a-priori effect in {row['coefficient']}{also}, usual is "
            f"{LEAST:g} to {MOST:g}; {cause}; flights alone do not show the gain of a pick-up: "
            f"compare it with its calibration on the ground, the stops, or the cockpit control"
        )
    return texts


def doubted_control(text: str) -> str:
    """Return the control of a warning of `doubtful_sizes`; empty for another text."""
    if not text.startswith(_START):
        return ""
    return text.removeprefix(_START).partition(":")[0]


def sizes_text(sizes: pd.DataFrame) -> str:
    """Return the sizes of all controls in one line, for a report; empty without a control."""
    parts = []
    for control, row in sizes.iterrows():
        text = f"{control} has no known a-priori effect"
        if np.isfinite(row["ratio"]):
            text = (
                f"{control} {row['ratio']:.2f} of its a-priori effect in {row['coefficient']} "
                f"(standard error {row['stderr']:.2f})"
            )
        parts.append(text)
    if not parts:
        return ""
    return f"{'; '.join(parts)}; the gain of the recorded deflections decides these numbers"
