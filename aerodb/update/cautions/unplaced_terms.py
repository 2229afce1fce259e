"""Terms of local models that no table of the database can carry.

A fit CL = 1 + alpha + qhat + delta_e informs the tables through their bases B.  The estimate of
delta_e reaches the database only if some table of CL depends on delta_e.  Without such a table the
estimate is lost and the control has no effect in the model.  The estimates of regressors that move
with it are compared with tables that lack its effect.

Whether a table carries a regressor is decided on the samples of the fit.  M is the projection that
removes the other regressors of the fit.  The carried share of a regressor x is the part of the sum
of squares of M x that the columns of M B explain.  It is 1 for a table with the regressor, 0 where
the flown values lie beyond its breakpoints, and between 0 and 1 where a table follows a curve in
pieces.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from aerodb.update.observations import CoefficientTerms, basis_at, coefficient_of, known_terms
from flightmech import terms as _terms
from flightmech.errors import SchemaError, UnknownName

SIGNIFICANT = float(np.sqrt(20.0))
"""Least t value of a significant term: the root of the partial F of 20 of a stepwise regression."""
CARRIED = 0.5  # least carried share of a regressor that has a place
CHOICES = ("raise", "warn")
COLUMNS = ("term", "estimate", "stderr", "t", "carried", "significant", "reason")
# Variables of the state that replace one another along a flight: a table over alpha carries CL**2.
_STATE = frozenset({"alpha", "CL", "CZ", "mach", "V", "V_cas", "V_eas", "qbar", "h"})
_ROUNDING = 1e-9  # eigenvalue over the largest, of regressors scaled to unit length
# Primary controls of each coefficient.  Samples alone say little about the others, such as the
# ailerons on the side force.
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
_FEW = 4  # terms of a database up to which a message names each of them
# Standard deviation of a control, in total and next to the tables, up to which it counts as fixed.
_LEAST_MOVEMENT = 1e-3  # [rad, 1]
_REFUSED = (
    "no table of the database carries these terms of the fits, so that their estimates would "
    "be lost and those of the regressors that move "
    "with them biased (a term left out of the fit biases them too); "
    'unplaced="warn", --unplaced warn, or unplaced = "warn" in a project file goes on without them'
)
# A name that is not followed by a bracket; the power behind a variable; a ramp of a variable.
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


class _UnplacedPart(NamedTuple):
    """A term of a fit that no table carries."""

    carried: float
    reason: str
    is_finer: bool  # a table depends on its variables; its breakpoints are too far apart


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
        Terms that keep their values; they carry regressors as well.

    Returns
    -------
    DataFrame
        Index (coefficient, fit); ``term``, ``estimate``, ``stderr``, ``t``, ``carried`` (share of
        the regressor that the tables carry, below `CARRIED`), ``significant``, ``reason``.  The t
        value is the estimate over hypot(stderr, stderr_systematic): the coloured residuals and the
        systematic errors of the instruments count.  A term is significant from `SIGNIFICANT` on.  A
        bend that is finer than the breakpoints of a table is never significant: the estimates of
        the fit are compared with tables without this bend.

    Raises
    ------
    SchemaError, UnknownName
        As in `aerodb.tabulate`.
    """
    rows, index = [], []
    for coefficient_terms in known_terms([coefficient_of(fit) for fit in fits], prior, held):
        coefficient = coefficient_terms.coefficient
        local = [fit for fit in fits if coefficient_of(fit) == coefficient]
        for number, fit in enumerate(local):
            name = str(fit.estimates.attrs.get("name", "")) or f"fit {number}"
            fit_rows = _unplaced_rows(fit, coefficient_terms)
            rows += fit_rows
            index += [(coefficient, name)] * len(fit_rows)
    return _make_table(rows, index)


def _unplaced_rows(fit: Any, coefficient_terms: CoefficientTerms) -> list[tuple[Any, ...]]:
    """Return the rows of the terms of one fit that no table carries, in the order of `COLUMNS`."""
    rows = []
    estimates = fit.estimates
    for column, term in enumerate(map(str, estimates["term"].values)):
        part = _find_unplaced(column, term, fit, coefficient_terms)
        if part is None:
            continue
        estimate = float(estimates["estimate"].values[column])
        stderr = _total_stderr(estimates, column)
        t = abs(estimate) / max(stderr, np.finfo(float).tiny)
        significant = t >= SIGNIFICANT and not part.is_finer
        rows.append((term, estimate, stderr, t, part.carried, significant, part.reason))
    return rows


def describe_lacking_variables(
    coefficient_terms: CoefficientTerms, terms: Sequence[str]
) -> Iterator[str]:
    """Yield reason and remedy for each term of a model on whose variables no table depends.

    `terms` are the regressors of a model of the coefficient, as ``("1", "beta", "rhat")``.
    """
    coefficient = coefficient_terms.coefficient
    for term in terms:
        factors = _list_factors(term)
        needed = set(factors) - _STATE
        leaves = coefficient_terms.leaves.values()
        if not any(needed <= _terms.list_model_variables(leaf) for leaf in leaves):
            lack = _describe_lack(coefficient, sorted(needed) or factors)
            yield f"{lack}; {_suggest_remedies(coefficient, term)}"


def unplaced_controls(
    name: str,
    samples: xr.Dataset,
    coefficient_terms: CoefficientTerms,
    directions: Callable[[], np.ndarray],
    covariance: Covariance,
) -> pd.DataFrame:
    """Return the primary controls that moved in samples and on which no term depends.

    It is for samples without local models.

    Parameters
    ----------
    name : str
        Name of the samples.
    samples : Dataset (sample,)
        As in `aerodb.update.regress_tables`.
    coefficient_terms : CoefficientTerms
        Terms of the coefficient.
    directions : callable
        Returns orthonormal directions, (samples, directions), in which the samples move the tables.
    covariance : callable
        As in `aerodb.update.regress_tables`.

    Returns
    -------
    DataFrame
        As that of `unplaced_terms`.  The estimate is that of the control next to the tables.  Its
        standard error is that of the coloured residual.
    """
    coefficient = coefficient_terms.coefficient
    variables: set[str] = set()
    for leaf in coefficient_terms.leaves.values():
        variables.update(_terms.list_model_variables(leaf))
    candidates = []
    for control in _CONTROLS.get(coefficient, ()):
        is_free = control in samples and control not in variables
        if is_free and float(samples[control].std()) > _LEAST_MOVEMENT:
            candidates.append(control)
    if not candidates:
        return _make_table([], [])
    z = samples[coefficient].values.astype(float)
    # Q spans the directions of the tables and a constant.
    Q = np.linalg.qr(np.column_stack([directions(), np.ones(z.size)]))[0]
    rows = []
    for control in candidates:
        # Regression of z on the part of the control that the tables cannot reproduce.
        x = samples[control].values.astype(float)
        free = x - Q @ (Q.T @ x)
        size = float(np.linalg.norm(free))
        if size <= _LEAST_MOVEMENT * np.sqrt(z.size):
            continue
        estimate = float(free @ z) / size**2
        residual = z - Q @ (Q.T @ z) - estimate * free
        variance = covariance(samples, free[:, None] / size, residual)[0, 0]
        stderr = float(np.sqrt(variance)) / size
        t = abs(estimate) / max(stderr, np.finfo(float).tiny)
        reason = f"no term of {coefficient} in the database depends on {control}"
        rows.append((control, estimate, stderr, t, 0.0, t >= SIGNIFICANT, reason))
    return _make_table(rows, [(coefficient, name or "samples")] * len(rows))


def demand_places(found: pd.DataFrame, unplaced: str) -> list[str]:
    """Raise if a significant term has no place, or return one line for each of them.

    Parameters
    ----------
    found : DataFrame
        Unplaced terms, from `unplaced_terms`.
    unplaced : {"raise", "warn"}

    Raises
    ------
    UnknownName
        `unplaced` is neither "raise" nor "warn".
    SchemaError
        A significant term without a place and ``unplaced="raise"``; all of them.
    """
    if unplaced not in CHOICES:
        raise UnknownName(unplaced, CHOICES, "choice of unplaced")
    problems = _describe_unplaced(found[found["significant"].astype(bool)])
    if problems and unplaced == "raise":
        raise SchemaError(_REFUSED, problems)
    return problems


def _describe_unplaced(table: pd.DataFrame) -> list[str]:
    """Return one line for each coefficient and term, of the fit with the largest t value."""
    lines = []
    groups = table.groupby([table.index.get_level_values("coefficient"), "term"], sort=False)
    for (coefficient, term), rows in groups:
        number = int(np.argmax(rows["t"].to_numpy()))
        row, fit = rows.iloc[number], rows.index[number][1]
        others = ""
        if len(rows) > 1:
            others = f", and of {len(rows) - 1} more fits"
        lines.append(
            f"{coefficient}: {term} of {fit!r}{others}: estimate {row['estimate']:.4g} +- "
            f"{row['stderr']:.2g}, t {row['t']:.1f}; "
            f"{row['reason']}; {_suggest_remedies(str(coefficient), str(term))}"
        )
    return lines


def _suggest_remedies(coefficient: str, term: str) -> str:
    """Return how a term gets a place: by a listing, or as an opened term."""
    factors = _list_factors(term)
    variables = list(dict.fromkeys(factors))
    name = f"{coefficient}/{'_'.join(variables) or 'basic'}"
    form = ""
    if len(factors) > _terms.MAX_REGRESSORS:
        form = f"axes over {', '.join(variables)}, "
    elif factors:
        form = f"regressors = {factors!r}, ".replace("'", '"')
    remedy = (
        f'open the term: [terms."{name}"] with {form}stderr = its a-priori error in a '
        f"project file, or aerodb.replace_terms"
    )
    roles = dict.fromkeys(_LISTINGS[name] for name in factors if name in _LISTINGS)
    if not roles:
        return remedy
    return f"read the DATCOM listing for {' and '.join(roles)}, or {remedy}"


def _list_factors(term: str) -> list[str]:
    """Return the variables of a term, each as often as it is a factor; a ramp is its variable."""
    factors: list[str] = []
    # Products are separated by a single star, powers have two.
    for part in re.split(r"(?<!\*)\*(?!\*)", term):
        power = re.search(r"(?:\*\*|\^)(\d+)$", part)
        repeats = 1
        if power:
            repeats = int(power[1])
        factors += _list_variables(part) * repeats
    return factors


def _list_variables(term: str) -> list[str]:
    """Return the names of the variables in a term."""
    return _NAME.findall(_RAMP.sub(r"\1", term))


def _total_stderr(estimates: xr.Dataset, column: int) -> float:
    """Return the standard error of an estimate with the systematic errors of the instruments."""
    systematic = 0.0
    if "stderr_systematic" in estimates:
        systematic = float(estimates["stderr_systematic"].values[column])
    if not np.isfinite(systematic):
        systematic = 0.0
    if "stderr" in estimates:
        stderr = float(estimates["stderr"].values[column])
    else:
        stderr = float(np.sqrt(estimates["covariance"].values[column, column]))
    return float(np.hypot(stderr, systematic))


def _make_table(rows: Sequence[tuple[Any, ...]], index: Sequence[tuple[str, str]]) -> pd.DataFrame:
    """Return the rows of unplaced terms as a table."""
    labels = pd.MultiIndex.from_arrays(list(zip(*index)) or [[], []], names=["coefficient", "fit"])
    return pd.DataFrame(rows, columns=list(COLUMNS), index=labels)


def _find_unplaced(
    column: int, term: str, fit: Any, coefficient_terms: CoefficientTerms
) -> _UnplacedPart | None:
    """Return why no table carries a term of a fit, or None if a table does."""
    factors = _list_factors(term)
    needed = set(factors) - _STATE
    # Other multipliers of such a table, such as gear = 1 along the flight, are in its basis.
    leaves = {}
    for name, leaf in coefficient_terms.leaves.items():
        if needed <= _terms.list_model_variables(leaf):
            leaves[name] = leaf
    if not leaves:
        variables = sorted(needed) or factors
        return _UnplacedPart(0.0, _describe_lack(coefficient_terms.coefficient, variables), False)
    for name, leaf in leaves.items():
        is_term = _is_regressor(leaf, factors)
        if is_term and _free_nodes(name, leaf, coefficient_terms).all():
            return None
    regressors = getattr(fit, "regressors", fit.design).values
    columns = _columns_of_terms(leaves, fit.data, coefficient_terms)
    share = carried_share(regressors, column, columns)
    if share >= CARRIED:
        return None
    tables = f"the {len(leaves)} terms of {coefficient_terms.coefficient}"
    if len(leaves) <= _FEW:
        tables = ", ".join(leaves)
    reason = (
        f"{tables} in the database cannot carry it over the flown range ({100.0 * share:.0f} "
        f"% of it)"
    )
    is_finer = _is_finer(term, factors, fit, leaves=leaves, coefficient_terms=coefficient_terms)
    return _UnplacedPart(share, reason, is_finer)


def _describe_lack(coefficient: str, variables: Sequence[str]) -> str:
    """Return the reason of a term whose variables no table depends on."""
    if not variables:
        return f"{coefficient} has no term in the database"
    return f"no term of {coefficient} in the database depends on {' and '.join(variables)}"


def _is_regressor(leaf: xr.Dataset, factors: Sequence[str]) -> bool:
    """Return whether equal nodes of a table give the term itself, whatever its axes."""
    if sorted(_terms.list_regressors(leaf)) != sorted(factors):
        return False
    return _terms.power_factor(leaf) is None and not {"K1", "K2"} & set(leaf)


def _free_nodes(name: str, leaf: xr.Dataset, coefficient_terms: CoefficientTerms) -> np.ndarray:
    """Return which nodes can carry a regressor, array of bool (nodes,).

    They are the nodes with a standard error, and all nodes of a table that is fixed or exact.
    """
    if name in coefficient_terms.fixed or "stderr" not in leaf:
        return np.ones(leaf["value"].size, bool)
    free = leaf["stderr"].values.ravel() > 0.0
    is_exact = not free.any() and bool(leaf["value"].values.any())
    return free | is_exact


def _columns_of_terms(
    leaves: Mapping[str, xr.Dataset], data: xr.Dataset, coefficient_terms: CoefficientTerms
) -> list[np.ndarray]:
    """Return the basis columns of the free nodes that the samples touch, of each term."""
    columns = []
    for name, leaf in leaves.items():
        basis = basis_at(leaf, data).tocsc()[:, _free_nodes(name, leaf, coefficient_terms)]
        columns.append(basis[:, np.diff(basis.indptr) > 0].toarray())
    return columns


def carried_share(regressors: np.ndarray, place: int, columns: Sequence[np.ndarray]) -> float:
    """Return the share of a regressor that tables explain after removal of the other regressors.

    Parameters
    ----------
    regressors : array (samples, terms)
    place : int
        Column of the regressor.
    columns : sequence of array (samples, nodes)
        Basis of each table.
    """
    x, others = regressors[:, place], np.delete(regressors, place, axis=1)
    without_tables = _residual_squares(x, others)
    # The other regressors reproduce this one: it has no estimate by itself.
    if without_tables <= _ROUNDING * float(x @ x):
        return 1.0
    return 1.0 - _residual_squares(x, np.hstack([others, *columns])) / without_tables


def _residual_squares(x: np.ndarray, columns: np.ndarray) -> float:
    """Return the residual sum of squares of `x` on columns that may repeat each other."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    if not scaled.shape[1]:
        return float(x @ x)
    # Pseudo-inverse of the normal matrix: repeated columns have eigenvalues of zero.
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    used = values > _ROUNDING * values[-1]
    coefficients = vectors[:, used] @ ((vectors[:, used].T @ (scaled.T @ x)) / values[used])
    residual = x - scaled @ coefficients
    return float(residual @ residual)


def _is_finer(
    term: str,
    factors: Sequence[str],
    fit: Any,
    *,
    leaves: Mapping[str, xr.Dataset],
    coefficient_terms: CoefficientTerms,
) -> bool:
    """Return whether a table carries the straight part of a curved term along an axis.

    Then only its breakpoints are too far apart.
    """
    # A term without powers and ramps is not curved.
    if term == _POWER.sub("", _RAMP.sub(r"\1", term)):
        return False
    along_axis = {}
    for name, leaf in leaves.items():
        if set(factors) & {str(axis) for axis in leaf["value"].dims}:
            along_axis[name] = leaf
    if not along_axis or any(variable not in fit.data for variable in factors):
        return False
    straight = np.prod([fit.data[variable].values for variable in dict.fromkeys(factors)], axis=0)
    constant = np.ones(len(straight))
    columns = _columns_of_terms(along_axis, fit.data, coefficient_terms)
    return carried_share(np.column_stack([constant, straight]), 1, columns) >= CARRIED
