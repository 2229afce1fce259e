"""Terms of local models that no table of the database can carry.

A fit CL = 1 + alpha + qhat + delta_e informs the tables through their bases B: what the estimate of
delta_e contributes reaches the database only if some table of CL depends on delta_e.  Without such
a table the estimate is lost, the control is dead in the model, and the estimates of regressors that
move with it are compared with tables that lack its effect.

Whether a table carries a regressor is decided on the samples of the fit.  With M the projection
that removes the other regressors of the fit, the carried share of a regressor x is the part of the
sum of squares of M x that the columns of M B explain.  It is 1 for a table with the regressor, 0
where the flown values lie beyond its breakpoints, and between 0 and 1 where a table follows a curve
in pieces.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.update.observations import CoefficientTerms, basis_at, coefficient_of, known_terms
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

SIGNIFICANT = float(np.sqrt(20.0))
"""Least t value of a significant term: the partial F of 20 with which a term enters a stepwise regression."""
CARRIED = 0.5  # least carried share of a regressor that counts as placed
CHOICES = ("raise", "warn")
COLUMNS = ("term", "estimate", "stderr", "t", "carried", "significant", "reason")
# variables of the state that stand for one another along a flight: a table over alpha carries CL**2
_STATE = frozenset({"alpha", "CL", "CZ", "mach", "V", "V_cas", "V_eas", "qbar", "h"})
_ROUNDING = 1e-9  # eigenvalue over the largest, of regressors scaled to one
# what acts on a coefficient in the first place; of the others, as the ailerons on the side force,
# samples alone decide little
_LIFT, _DRAG = ("delta_e", "delta_f"), ("delta_f", "gear", "speedbrake")
_CONTROLS = {
    "CL": _LIFT,
    "CZ": _LIFT,
    "CD": _DRAG,
    "CX": _DRAG,
    "Cm": ("delta_e", "delta_t", *_DRAG),
    "CY": ("delta_r",),
    "Cl": ("delta_a",),
    "Cn": ("delta_r",),
}
_FEW = 4  # terms of a database that are named one by one
_STILL = 1e-3  # movement of a control, in all and next to the tables, that counts as none [rad, 1]
_REFUSED = (
    "no table of the database carries these terms of the fits, so that their estimates would "
    "be lost and those of the regressors that move "
    "with them biased (a term left out of the fit biases them too); "
    'unplaced="warn", --unplaced warn, or unplaced = "warn" in a project file goes on without them'
)
_NAME = re.compile(r"(?<![\w.])[A-Za-z_][\w.]*\b(?!\()")
_POWER = re.compile(r"\*\*\d+|\^\d+")
_RAMP = re.compile(r"ramp\(([^,()]+),[^()]*\)")
_LISTINGS = {
    "delta_e": "elevator",
    "delta_f": "flaps",
    "delta_a": "aileron",
    "delta_t": "tabs",
    "delta_s": "spoiler",
    "h_agl": "ground",
}


Covariance = Callable[[xr.Dataset, np.ndarray, np.ndarray], np.ndarray]


class _Part(NamedTuple):
    """A term of a fit that no table carries."""

    carried: float
    reason: str
    is_finer: bool  # a table depends on its variables, with breakpoints too far apart for its curve


def unplaced_terms(
    fits: Sequence[Any], prior: xr.DataTree, held: Sequence[str] = ()
) -> pd.DataFrame:
    """Return the terms of local models that no table of a database can carry.

    Parameters
    ----------
    fits : sequence of Fit
        As in `aerodb.tabulate`.
    prior : DataTree
        The database.
    held : sequence of str
        Terms that keep their values; they carry what they depend on.

    Returns
    -------
    DataFrame
        Index (coefficient, fit); ``term``, ``estimate``, ``stderr``, ``t``, ``carried`` (share of
        the regressor that the tables carry, below `CARRIED`), ``significant``, ``reason``.  The t
        value is the estimate over its standard error, in which the coloured residuals and the
        systematic errors of the instruments count: hypot(stderr, stderr_systematic).  A term is
        significant from `SIGNIFICANT` on.  The bend of a table that is finer than its breakpoints
        is never significant: the estimates of the fit are compared with tables without this bend.

    Raises
    ------
    SchemaError, UnknownName
        As in `aerodb.tabulate`.
    """
    rows, index = [], []
    for known in known_terms([coefficient_of(fit) for fit in fits], prior, held):
        for number, fit in enumerate(
            one for one in fits if coefficient_of(one) == known.coefficient
        ):
            estimates = fit.estimates
            for place, term in enumerate(map(str, estimates["term"].values)):
                part = _unplaced(place, term, fit, known)
                if part is not None:
                    estimate, stderr = (
                        float(estimates["estimate"].values[place]),
                        _standard_error(estimates, place),
                    )
                    t = abs(estimate) / max(stderr, np.finfo(float).tiny)
                    significant = t >= SIGNIFICANT and not part.is_finer
                    rows.append((term, estimate, stderr, t, part.carried, significant, part.reason))
                    index.append(
                        (known.coefficient, str(estimates.attrs.get("name", "")) or f"fit {number}")
                    )
    return _table(rows, index)


def unplaced_controls(
    name: str,
    samples: xr.Dataset,
    known: CoefficientTerms,
    directions: Callable[[], np.ndarray],
    covariance: Covariance,
) -> pd.DataFrame:
    """Return the primary controls of a coefficient that moved in samples without local models and
    on which none of its terms depends.

    Parameters
    ----------
    name : str
        Of the samples.
    samples : Dataset (sample,)
        As in `aerodb.update.regress_tables`.
    known : Known
        Terms of the coefficient.
    directions : callable
        Returns orthonormal directions, (samples, directions), in which the samples move the tables.
    covariance : callable
        As in `aerodb.update.regress_tables`.

    Returns
    -------
    DataFrame
        As that of `unplaced_terms`; the estimate is that of the control next to the tables, its
        standard error that of the coloured residual.
    """
    rows = []
    z = samples[known.coefficient].values.astype(float)
    needed = set().union(*map(_terms.list_model_variables, known.leaves.values()))
    primary = _CONTROLS.get(known.coefficient, ())
    lacking = [
        word
        for word in primary
        if word in samples and word not in needed and float(samples[word].std()) > _STILL
    ]
    Q = (
        np.linalg.qr(np.column_stack([directions(), np.ones(z.size)]))[0]
        if lacking
        else np.zeros((z.size, 0))
    )
    for control in lacking:
        x = samples[control].values.astype(float)
        free = x - Q @ (Q.T @ x)
        size = float(np.linalg.norm(free))
        if size <= _STILL * np.sqrt(z.size):
            continue
        estimate = float(free @ z) / size**2
        residual = z - Q @ (Q.T @ z) - estimate * free
        stderr = float(np.sqrt(covariance(samples, free[:, None] / size, residual)[0, 0])) / size
        t = abs(estimate) / max(stderr, np.finfo(float).tiny)
        reason = f"no term of {known.coefficient} in the database depends on {control}"
        rows.append((control, estimate, stderr, t, 0.0, t >= SIGNIFICANT, reason))
    return _table(rows, [(known.coefficient, name or "samples")] * len(rows))


def demand_places(found: pd.DataFrame, unplaced: str) -> list[str]:
    """Raise if a significant term has no place, or return one line for each of them.

    Parameters
    ----------
    found : DataFrame
        From `unplaced_terms`.
    unplaced : {"raise", "warn"}

    Raises
    ------
    UnknownName
        `unplaced` is neither.
    SchemaError
        A significant term without a place and ``unplaced="raise"``; all of them.
    """
    if unplaced not in CHOICES:
        raise UnknownName(unplaced, CHOICES, "choice of unplaced")
    problems = _lines(found[found["significant"].astype(bool)])
    if problems and unplaced == "raise":
        raise SchemaError(_REFUSED, problems)
    return problems


def _lines(found: pd.DataFrame) -> list[str]:
    """Return one line for each coefficient and term, of the fit with the largest t value."""
    lines = []
    for (coefficient, term), rows in found.groupby(
        [found.index.get_level_values("coefficient"), "term"], sort=False
    ):
        place = int(np.argmax(rows["t"].to_numpy()))
        row, fit = rows.iloc[place], rows.index[place][1]
        others = f", and of {len(rows) - 1} more fits" if len(rows) > 1 else ""
        lines.append(
            f"{coefficient}: {term} of {fit!r}{others}: estimate {row['estimate']:.4g} +- "
            f"{row['stderr']:.2g}, t {row['t']:.1f}; "
            f"{row['reason']}; {_remedies(str(coefficient), str(term))}"
        )
    return lines


def _remedies(coefficient: str, term: str) -> str:
    """Return how a term gets a place: by a listing, or opened as a term of its own."""
    factors = _factors(term)
    name = f"{coefficient}/{'_'.join(dict.fromkeys(factors)) or 'basic'}"
    given = f"regressors = {factors!r}, ".replace("'", '"') if factors else ""
    shape = (
        given
        if len(factors) <= _terms.MAX_REGRESSORS
        else f"axes over {', '.join(dict.fromkeys(factors))}, "
    )
    opened = (
        f'open the term: [terms."{name}"] with {shape}stderr = its a-priori error in a '
        f"project file, or aerodb.replace_terms"
    )
    roles = list(
        dict.fromkeys(_LISTINGS[variable] for variable in factors if variable in _LISTINGS)
    )
    return f"read the DATCOM listing for {' and '.join(roles)}, or {opened}" if roles else opened


def _factors(term: str) -> list[str]:
    """Return the variables of a term, each as often as it is a factor; a ramp counts as its
    variable.
    """
    found: list[str] = []
    for part in re.split(r"(?<!\*)\*(?!\*)", term):
        power = re.search(r"(?:\*\*|\^)(\d+)$", part)
        found += _variables(part) * (int(power[1]) if power else 1)
    return found


def _variables(term: str) -> list[str]:
    """Return the names of the variables in a term."""
    return _NAME.findall(_RAMP.sub(r"\1", term))


def _standard_error(estimates: xr.Dataset, place: int) -> float:
    systematic = (
        float(estimates["stderr_systematic"].values[place])
        if "stderr_systematic" in estimates
        else 0.0
    )
    stderr = (
        float(estimates["stderr"].values[place])
        if "stderr" in estimates
        else float(np.sqrt(estimates["covariance"].values[place, place]))
    )
    return float(np.hypot(stderr, systematic if np.isfinite(systematic) else 0.0))


def _table(rows: Sequence[tuple], index: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """Return the rows of unplaced terms as a table."""
    labels = pd.MultiIndex.from_arrays(list(zip(*index)) or [[], []], names=["coefficient", "fit"])
    return pd.DataFrame(rows, columns=list(COLUMNS), index=labels)


def _unplaced(place: int, term: str, fit: Any, known: CoefficientTerms) -> _Part | None:
    """Return why no table carries a term of a fit, or None where one does."""
    factors = _factors(term)
    needed = set(factors) - _STATE
    # whatever else multiplies such a table, as gear = 1 along the flight, is in its basis
    leaves = {
        name: leaf
        for name, leaf in known.leaves.items()
        if needed <= _terms.list_model_variables(leaf)
    }
    if not leaves:
        lacking = sorted(needed) or factors
        missing = (
            f"no term of {known.coefficient} in the database depends on {' and '.join(lacking)}"
            if lacking
            else ""
        )
        return _Part(0.0, missing or f"{known.coefficient} has no term in the database", False)
    if any(
        _is_regressor(leaf, factors) and _free_nodes(name, leaf, known).all()
        for name, leaf in leaves.items()
    ):
        return None
    regressors = getattr(fit, "regressors", fit.design).values
    share = carried_share(
        regressors, place, [_columns(name, leaf, fit.data, known) for name, leaf in leaves.items()]
    )
    if share >= CARRIED:
        return None
    there = (
        ", ".join(leaves)
        if len(leaves) <= _FEW
        else f"the {len(leaves)} terms of {known.coefficient}"
    )
    reason = (
        f"{there} in the database cannot carry it over the flown range ({100.0 * share:.0f} "
        f"% of it)"
    )
    return _Part(share, reason, _is_finer(term, factors, regressors, fit, leaves, known))


def _is_regressor(leaf: xr.Dataset, factors: Sequence[str]) -> bool:
    """Whether equal nodes of a table give the term itself, whatever its axes."""
    return (
        sorted(_terms.list_regressors(leaf)) == sorted(factors)
        and _terms.power_factor(leaf) is None
        and not {"K1", "K2"} & set(leaf)
    )


def _free_nodes(name: str, leaf: xr.Dataset, known: CoefficientTerms) -> np.ndarray:
    """Return which nodes may carry something: those with a standard error; all of a table that is
    held or stated as exact.
    """
    if name in known.fixed or "stderr" not in leaf:
        return np.ones(leaf["value"].size, bool)
    free = leaf["stderr"].values.ravel() > 0.0
    stated_exact = not free.any() and bool(leaf["value"].values.any())
    return free | stated_exact


def _columns(name: str, leaf: xr.Dataset, data: xr.Dataset, known: CoefficientTerms) -> np.ndarray:
    """Return the columns of the nodes that the samples touch, (samples, nodes)."""
    basis = basis_at(leaf, data).tocsc()[:, _free_nodes(name, leaf, known)]
    return basis[:, np.diff(basis.indptr) > 0].toarray()


def carried_share(regressors: np.ndarray, place: int, columns: Sequence[np.ndarray]) -> float:
    """Return the share of a regressor that tables explain once the other regressors are removed.

    Parameters
    ----------
    regressors : array (samples, terms)
    place : int
        Which of them.
    columns : sequence of array (samples, nodes)
        Basis of each table.
    """
    x, others = regressors[:, place], np.delete(regressors, place, axis=1)
    alone = _sum_of_squares(x, others)
    if alone <= _ROUNDING * float(
        x @ x
    ):  # a regressor that the others repeat has no estimate of its own
        return 1.0
    return 1.0 - _sum_of_squares(x, np.hstack([others, *columns])) / alone


def _sum_of_squares(x: np.ndarray, columns: np.ndarray) -> float:
    """Return the residual sum of squares of `x` on columns that may repeat each other."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    if not scaled.shape[1]:
        return float(x @ x)
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    used = values > _ROUNDING * values[-1]
    solved = vectors[:, used] @ ((vectors[:, used].T @ (scaled.T @ x)) / values[used])
    residual = x - scaled @ solved
    return float(residual @ residual)


def _is_finer(
    term: str,
    factors: Sequence[str],
    regressors: np.ndarray,
    fit: Any,
    leaves: Mapping[str, xr.Dataset],
    known: CoefficientTerms,
) -> bool:
    """Whether a table carries the straight part of a curved term along an axis, so that only its
    breakpoints are too far apart.
    """
    if term == _POWER.sub("", _RAMP.sub(r"\1", term)):
        return False
    along = {
        name: leaf
        for name, leaf in leaves.items()
        if set(factors) & {str(axis) for axis in leaf["value"].dims}
    }
    if not along or any(variable not in fit.data for variable in factors):
        return False
    straight = np.prod([fit.data[variable].values for variable in dict.fromkeys(factors)], axis=0)
    constant = np.ones(len(straight))
    columns = [_columns(name, leaf, fit.data, known) for name, leaf in along.items()]
    return carried_share(np.column_stack([constant, straight]), 1, columns) >= CARRIED
