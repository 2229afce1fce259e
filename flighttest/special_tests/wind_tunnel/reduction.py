"""Reduction of the points of a balance to coefficients: tare, axes, moment reference and errors.

Errors that are common to all points - calibration of the balance, angle, airspeed, tare,
interference - move the coefficients of all points together.  They are stored as the change of every
coefficient for one standard error of each source, as for a flight record.  A fit then has these
errors besides the scatter of the points.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.axes import lift_drag, matrix_from_euler, transfer_moment
from flightmech.errors import AeromatchWarning, IdentificationError, SchemaError
from flightmech.units import DEGREE
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.wind_tunnel.balance import (
    COEFFICIENTS,
    FORCES,
    LOADS,
    MOMENTS,
    STATE,
    BalanceSetup,
)
from flighttest.special_tests.wind_tunnel.points import read_points

# Smallest singular value of a model with nuisance terms over the largest.
_DETERMINED = 1e-6
# Smallest singular value of the scaled regressors of the tare.
_LEAST_SINGULAR = 0.05
# Angle of attack beyond those of the tare that the weight of the model allows. [rad]
_TARE_MARGIN = 1.0 * DEGREE
# Element of a rotation matrix below which a load has no part in a component.
_NO_SHARE = 1e-9

_Columns = Mapping[str, np.ndarray]


def balance_coefficients(path: str | Path, setup: BalanceSetup) -> xr.Dataset:
    """Return the coefficients of the points of a balance.

    The result is like that of `coefficients` for a flight record.

    Parameters
    ----------
    path : str or Path
        CSV or another file of a record: one row per point, with time if the points are samples of a
        motion.
    setup : BalanceSetup
        As from `read_setup`.  The column of a measurand without an entry in ``columns`` has the
        name of the measurand.

    Returns
    -------
    Dataset (time,)
        ``alpha``, ``beta`` [rad], ``V`` [m/s], ``qbar`` [Pa] and further columns of the file.
        ``CL CD`` (stability axes), ``CX CY CZ``, ``Cl Cm Cn`` (body axes, about the moment
        reference point), if their loads are measured.  ``CL_error (error, time)`` etc. for the
        sources of the setup, of the tare and of the states.  Points without time are one second
        apart.

    Raises
    ------
    UnknownName
        The file does not have a column of the setup.
    SchemaError
        The file has no angle, no airspeed or dynamic pressure, or no load.
    IdentificationError
        All points have the wind off.

    Warns
    -----
    AeromatchWarning
        The tare is from one point, or the wind-off points have not the attitudes of the others.

    Notes
    -----
    The tare is fitted to the loads of the points with the wind off, and subtracted.  It is a
    constant and, if the attitudes determine it, the weight of the model: sin(alpha) and cos(alpha)
    of a sting that turns the model by alpha.  Loads of a fixed balance are turned by alpha and beta
    from tunnel axes.
    """
    points, names = read_points(path, setup)
    off = _find_wind_off(points, setup, path)
    measured = {name: points[name] for name in names}
    corrected, tare = _subtract_tare(measured, points, off, moves=setup.balance.moves)
    wind_on = ~off
    state = {name: values[wind_on] for name, values in points.items()}
    loads = {name: values[wind_on] for name, values in corrected.items()}
    total = _compute_coefficients(loads, state, setup)
    changes = _setup_changes(loads, state, setup, total=total)
    record = Path(path).stem
    for (name, part), change in tare.items():
        changed = {**loads, name: loads[name] + change[wind_on]}
        changes[f"tare {record} {name} {part}"] = _change_coefficients(
            changed, state, setup, total=total
        )
    return _make_dataset(state, total, changes, record=record)


def _find_wind_off(points: _Columns, setup: BalanceSetup, path: str | Path) -> np.ndarray:
    """Return the points with the wind off; raise if there is no other point."""
    if "V" in points:
        off = points["V"] < setup.wind_off
    else:
        off = points["qbar"] < 0.5 * setup.rho * setup.wind_off**2
    if off.all():
        raise IdentificationError(
            f"{path}: all {len(off)} points are below {setup.wind_off:g} m/s; points with "
            f"the wind on are needed"
        )
    return off


def _setup_changes(
    loads: _Columns, state: _Columns, setup: BalanceSetup, *, total: _Columns
) -> dict[str, dict[str, np.ndarray]]:
    """Return the changes for one standard error of each source of the setup."""
    changes: dict[str, dict[str, np.ndarray]] = {}
    for name, step in setup.errors.items():
        if step and name in loads:
            changed = {**loads, name: loads[name] + step}
            changes[name] = _change_coefficients(changed, state, setup, total=total)
        elif step and name in state:
            changed = _change_state(state, name, step)
            changes[name] = _change_coefficients(loads, changed, setup, total=total)
            # states are regressors: a constant error of the angle is one of the constant of a fit
            for state_name in STATE:
                if state_name in state:
                    changes[name][state_name] = changed[state_name] - state[state_name]
    return changes


def without_nuisance(
    data: Sequence[xr.Dataset], model: RegressionModel, setup: BalanceSetup
) -> list[xr.Dataset]:
    """Return the points without tare and interference, which are estimated with a model.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        As from `balance_coefficients`; the terms are common to all of them.
    model : RegressionModel
        Model of the coefficient.
    setup : BalanceSetup
        Its ``nuisance`` lists terms of the coefficient.  ``tare`` is a load that does not change
        with the wind, so it is proportional to 1/(qbar S).  Other terms are products of columns,
        such as ``strut*alpha``.

    Returns
    -------
    list of Dataset (time,)
        The coefficient less the terms, whose standard errors are further sources.  A fit of the
        model then equals the fit with the terms, and has the same standard errors.

    Raises
    ------
    IdentificationError
        The points cannot distinguish the terms from the model.
    """
    terms, name = setup.nuisance.get(model.coefficient, ()), model.coefficient
    if not terms:
        return list(data)
    blocks = []
    for points in data:
        columns = [_nuisance_column(points, term, setup.reference.S) for term in terms]
        blocks.append(np.column_stack(columns))
    X = np.concatenate([model.design(points) for points in data])
    z = np.concatenate([points[name].values for points in data])
    A = np.column_stack([X, np.concatenate(blocks)])
    _check_rank(A, terms, model)
    # least squares of model and nuisance terms; the last columns are the nuisance terms
    inverse = np.linalg.inv(A.T @ A)
    theta = inverse @ A.T @ z
    v = z - A @ theta
    C = float(v @ v) / (len(z) - A.shape[1]) * inverse[X.shape[1] :, X.shape[1] :]
    values, root = theta[X.shape[1] :], np.linalg.cholesky(C)
    texts = []
    for term, value, error in zip(terms, values, np.sqrt(np.diag(C)), strict=True):
        texts.append(f"{term} {value:.4g} +- {error:.2g}")
    corrected = []
    for points, block in zip(data, blocks, strict=True):
        attributes = {**points[name].attrs, "nuisance": ", ".join(texts)}
        clean = points.assign({name: ("time", points[name].values - block @ values, attributes)})
        # columns of the root are independent sources
        changes = {}
        for k, change in enumerate((block @ root).T):
            changes[f"nuisance {name} {k + 1}"] = {name: change}
        corrected.append(_add_sources(clean, changes))
    return corrected


def _check_rank(A: np.ndarray, terms: Sequence[str], model: RegressionModel) -> None:
    """Raise IdentificationError if model and nuisance terms are collinear."""
    size = np.sqrt((A**2).sum(axis=0))
    singular = np.linalg.svd(A / np.where(size > 0.0, size, 1.0), compute_uv=False)
    if not (size > 0.0).all() or singular[-1] < _DETERMINED * singular[0]:
        raise IdentificationError(
            f"{model.coefficient}: the points cannot distinguish {', '.join(terms)} from "
            f"{', '.join(model.terms)}; vary airspeed or the columns of the terms, or add points "
            "with the wind off"
        )


def _nuisance_column(data: xr.Dataset, term: str, S: float) -> np.ndarray:
    """Return the regressor of a nuisance term."""
    if term == "tare":
        return 1.0 / (data["qbar"].values * S)
    column = np.ones(data.sizes["time"])
    for factor in term.split("*"):
        name = factor.strip()
        if name not in data:
            raise SchemaError(
                "nuisance", [f"{term}: the points have no column {name}; name it in [columns]"]
            )
        column = column * data[name].values
    return column


def _subtract_tare(
    measured: _Columns, points: _Columns, off: np.ndarray, *, moves: bool
) -> tuple[dict[str, np.ndarray], dict[tuple[str, int], np.ndarray]]:
    """Return loads without tare, and their changes for one standard error of each tare part."""
    if not off.any():
        return dict(measured), {}
    # Least squares of the wind-off points: the tare over the attitude.
    A = _tare_regressors(points["alpha"], off)
    _warn_of_tare(points["alpha"], off, has_weight=A.shape[1] > 1 or not moves)
    inverse = np.linalg.inv(A[off].T @ A[off])
    freedom = max(1, int(off.sum()) - A.shape[1])
    corrected: dict[str, np.ndarray] = {}
    changes: dict[tuple[str, int], np.ndarray] = {}
    for name, values in measured.items():
        tare = inverse @ A[off].T @ values[off]
        v = values[off] - A[off] @ tare
        # Columns of the root of the covariance are independent errors of the tare.
        root = np.linalg.cholesky(inverse) * np.sqrt(max(float(v @ v) / freedom, 0.0))
        corrected[name] = values - A @ tare
        for k, column in enumerate(root.T):
            if column.any():
                changes[name, k + 1] = -A @ column
    return corrected, changes


def _warn_of_tare(alpha: np.ndarray, off: np.ndarray, *, has_weight: bool) -> None:
    """Warn of a tare without a known scatter, or of other attitudes than those of the wind-on."""
    if off.sum() == 1:
        warnings.warn(
            "tare: one point with the wind off has no scatter, so the coefficients have no "
            "standard error of the tare; record it twice or more, or state the errors of the loads",
            AeromatchWarning,
            stacklevel=4,
        )
    low, high = alpha[off].min(), alpha[off].max()
    beyond = max(low - alpha[~off].min(), alpha[~off].max() - high)
    # The weight of a model that turns with its balance turns in the axes of the balance.
    if not has_weight and beyond > _TARE_MARGIN:
        warnings.warn(
            f"tare: the points with the wind off have alpha {low / DEGREE:.3g} ... "
            f"{high / DEGREE:.3g} deg, those with the wind on go {beyond / DEGREE:.3g} deg beyond: "
            f"the weight of the model is not known there; record the tare at all attitudes, or "
            f"state 'moves = false' in [balance] if the balance does not turn",
            AeromatchWarning,
            stacklevel=4,
        )


def _tare_regressors(alpha: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Return a constant, and the weight terms that the attitudes with the wind off determine."""
    sine, cosine = np.sin(alpha), np.cos(alpha)
    columns = np.column_stack(
        [np.ones(len(alpha)), sine - sine[off].mean(), cosine - cosine[off].mean()]
    )
    selected = [0]
    for k in (1, 2):
        trial = columns[off][:, [*selected, k]]
        size = np.sqrt((trial**2).sum(axis=0))
        # more points than terms, so that the scatter is known
        if off.sum() <= len(selected) + 2 or not (size > 0.0).all():
            continue
        if np.linalg.svd(trial / size, compute_uv=False)[-1] > _LEAST_SINGULAR:
            selected.append(k)
    return columns[:, selected]


def _compute_coefficients(
    loads: _Columns, state: _Columns, setup: BalanceSetup
) -> dict[str, np.ndarray]:
    """Return the coefficients that the loads determine."""
    reference, balance = setup.reference, setup.balance
    # from balance to body axes, or to tunnel axes
    C = matrix_from_euler(*balance.rotation).T
    F, M = _stack_loads(loads, FORCES, state) @ C.T, _stack_loads(loads, MOMENTS, state) @ C.T
    has_F, has_M = _has_components(loads, FORCES, C), _has_components(loads, MOMENTS, C)
    if not balance.moves:
        to_body = matrix_from_euler(0.0, state["alpha"], -state["beta"])
        F, M = np.einsum("nij,nj->ni", to_body, F), np.einsum("nij,nj->ni", to_body, M)
        # a turn by two angles mixes all components
        has_F, has_M = np.full(3, has_F.all()), np.full(3, has_M.all())
    scale = 1.0 / (state["qbar"] * reference.S)
    coefficients: dict[str, np.ndarray] = {}
    for k, name in enumerate(("CX", "CY", "CZ")):
        if has_F[k]:
            coefficients[name] = scale * F[:, k]
    if has_F[0] and has_F[2]:
        lift, drag = lift_drag(coefficients["CX"], coefficients["CZ"], state["alpha"])
        coefficients["CL"], coefficients["CD"] = lift, drag
    # the transfer of moments needs all forces, except for a balance at the reference point
    if has_M.any() and (has_F.all() or not np.any(balance.offset)):
        M = transfer_moment(M, F, np.array(balance.offset), np.zeros(3))
        lengths = {"Cl": reference.b, "Cm": reference.c, "Cn": reference.b}
        for k, (name, length) in enumerate(lengths.items()):
            if has_M[k]:
                coefficients[name] = scale * M[:, k] / length
    return {name: coefficients[name] for name in COEFFICIENTS if name in coefficients}


def _stack_loads(loads: _Columns, names: Sequence[str], state: _Columns) -> np.ndarray:
    """Return three loads (point, 3), zero for a load that is not measured."""
    zero = np.zeros(len(state["alpha"]))
    return np.stack([loads.get(name, zero) for name in names], axis=1)


def _has_components(loads: _Columns, names: Sequence[str], C: np.ndarray) -> np.ndarray:
    """Return which components after a rotation depend on measured loads only, (3,)."""
    is_missing = np.array([name not in loads for name in names])
    return ~((np.abs(C) > _NO_SHARE) & is_missing).any(axis=1)


def _change_coefficients(
    loads: _Columns, state: _Columns, setup: BalanceSetup, *, total: _Columns
) -> dict[str, np.ndarray]:
    """Return the coefficients of changed loads or states, less the coefficients `total`."""
    changed = _compute_coefficients(loads, state, setup)
    return {name: values - total[name] for name, values in changed.items()}


def _change_state(state: _Columns, name: str, step: float) -> dict[str, np.ndarray]:
    """Return the state with an error of one measurand.

    Airspeed and density change the dynamic pressure.
    """
    changed = {**state, name: state[name] + step}
    if name in ("V", "rho") and "V" in state:
        qbar = state["qbar"] * changed["rho"] / state["rho"]
        changed["qbar"] = qbar * (changed["V"] / state["V"]) ** 2
    return changed


def _make_dataset(
    state: _Columns, total: _Columns, changes: Mapping[str, _Columns], *, record: str
) -> xr.Dataset:
    """Return states, further columns and coefficients with the sources of their errors."""
    columns = {}
    for name, values in state.items():
        if name not in (*LOADS, "time"):
            columns[name] = ("time", values, {"units": STATE.get(name, "1")})
    for name, values in total.items():
        columns[name] = ("time", values, {"units": "1"})
    time = {"time": ("time", state["time"], {"units": "s"})}
    return _add_sources(xr.Dataset(columns, time, {"record": record}), changes)


def _add_sources(data: xr.Dataset, changes: Mapping[str, _Columns]) -> xr.Dataset:
    """Return the points with further sources of common errors."""
    sources: list[str] = []
    if "error" in data.dims:
        sources = [str(name) for name in data["error"].values]
    size, columns = data.sizes["time"], {}
    for name in (*COEFFICIENTS, *STATE):
        if name not in data:
            continue
        # a column without errors so far has zero for the earlier sources
        rows = list(np.zeros((len(sources), size)))
        if f"{name}_error" in data:
            rows = list(data[f"{name}_error"].values)
        for change in changes.values():
            rows.append(np.asarray(change.get(name, np.zeros(size))))
        # states without an error have no table
        if rows and (name in COEFFICIENTS or np.any(rows)):
            columns[f"{name}_error"] = (("error", "time"), np.array(rows))
    if not columns:
        return data
    data = data.drop_dims("error", errors="ignore").assign(columns)
    return data.assign_coords(error=[*sources, *changes])
