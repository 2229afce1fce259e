"""Points of a balance to coefficients: tare off, axes, moment reference, errors; nuisance terms
estimated and taken off.

What is common to all points - calibration of the balance, angle, airspeed, tare, interference -
moves the coefficients of all points together.  It is kept as the change of every coefficient for
one standard error of each source, as for a flight record, so that whatever is fitted has these
errors besides the scatter of the points.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.axes import lift_drag, matrix_from_euler, transfer_moment
from flightmech.errors import IdentificationError, SchemaError
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flightmech.units import to_si
from flighttest.records.readers.columns import locate_column
from flighttest.records.readers.name_map import NameMap
from flighttest.records.readers.opening import open_recording
from flighttest.records.readers.recording import CLOCK_NAMES
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.wind_tunnel.balance import (
    COEFFICIENTS,
    FORCES,
    LOADS,
    MOMENTS,
    STATE,
    UNITS,
    BalanceSetup,
)

_NODES, _MOST = 25, 600  # of the surface along each angle; points drawn


def draw_surfaces(fits: Sequence[Fit], target: str | Path) -> None:
    """Draw each fit as a surface over ``alpha`` and ``beta`` inside the range of its points, with
    the points.

    Parameters
    ----------
    fits : sequence of Fit
        Other variables of a model are held at their mean.
    target : path
        File to write, atomically; its ending names the format (png, svg, pdf).
    """
    demand_drawable(target)
    figure = new_figure(7.0 * len(fits), 5.5)
    for k, fit in enumerate(fits, 1):
        points, name = fit.data, fit.model.coefficient
        axis = figure.add_subplot(1, len(fits), k, projection="3d")
        nodes = [np.linspace(*_range(points, angle), _NODES) for angle in ("alpha", "beta")]
        A, B = np.meshgrid(*nodes)
        held = {
            variable: ("sample", np.full(A.size, float(points[variable].mean())))
            for variable in fit.model.variables
        }
        grid = xr.Dataset({**held, "alpha": ("sample", A.ravel()), "beta": ("sample", B.ravel())})
        terms = list(fit.model.terms)
        surface = fit.model.design(grid) @ fit.estimates["estimate"].sel(term=terms).values
        axis.plot_wireframe(
            np.degrees(A),
            np.degrees(B),
            surface.reshape(A.shape),
            color="#bc6c25",
            linewidth=0.5,
            label="model",
        )
        thin = slice(None, None, max(1, points.sizes["sample"] // _MOST))
        z = points[name].values[thin]
        angles = [
            np.degrees(points[angle].values[thin]) if angle in points else np.zeros_like(z)
            for angle in ("alpha", "beta")
        ]
        axis.scatter(*angles, z, color="black", s=2, label="points")
        axis.set_xlabel("alpha [deg]")
        axis.set_ylabel("beta [deg]")
        axis.set_title(str(fit.model), fontsize="small", loc="left")
        axis.set_zlabel(name)
    figure.axes[0].legend(fontsize="small")
    write_figure(figure, target, dpi=120)


def _range(points: xr.Dataset, angle: str) -> tuple[float, float]:
    return (
        (float(points[angle].min()), float(points[angle].max())) if angle in points else (-0.1, 0.1)
    )


_CLOCK = 1.0  # step of points that have no time [s]
_DETERMINED = 1e-6  # smallest singular value of the tare over the largest


def balance_coefficients(path: str | Path, setup: BalanceSetup) -> xr.Dataset:
    """Return the coefficients of the points of a balance, as `coefficients` does those of a flight
    record.

    Parameters
    ----------
    path : str or Path
        CSV or any other file that records are read from: one row per point, with time where it was
        recorded along a motion.
    setup : BalanceSetup
        As from `read_setup`.  A measurand without an entry in its ``columns`` is looked for under
        its own name.

    Returns
    -------
    Dataset (time,)
        ``alpha``, ``beta`` [rad], ``V`` [m/s], ``qbar`` [Pa], further columns of the file under
        their own names, ``CL CD`` (stability axes), ``CX CY CZ``, ``Cl Cm Cn`` (body axes, about
        the moment reference point) as far as their loads are there, and ``CL_error (error, time)``
        etc. for the sources of the setup and of the tare, and those of the states. Points without
        time are one second apart.

    Raises
    ------
    UnknownName
        A column that the file does not have.
    SchemaError
        No angle, no airspeed or dynamic pressure, no load.
    IdentificationError
        No point with the wind on.

    Notes
    -----
    Loads of the points with the wind off are fitted by a constant and, as far as their attitudes determine it, by the weight of the
    model, sin(alpha) and cos(alpha) of a sting that holds it at alpha, and taken off.  Coefficients of a fixed balance are turned by alpha
    and beta from tunnel axes.
    """
    points, loads = _points(path, setup)
    off = (
        points["V"] < setup.wind_off
        if "V" in points
        else points["qbar"] < 0.5 * setup.rho * setup.wind_off**2
    )
    if off.all():
        raise IdentificationError(
            f"{path}: all {len(off)} points are below {setup.wind_off:g} m/s; points with "
            f"the wind on are needed"
        )
    measured = {name: points[name] for name in loads}
    corrected, tare = _without_tare(measured, points, off)
    on = ~off
    state = {name: values[on] for name, values in points.items()}
    corrected = {name: values[on] for name, values in corrected.items()}
    total = _coefficients(corrected, state, setup)
    shares: dict[str, dict[str, np.ndarray]] = {}
    for name, step in setup.errors.items():
        if step and name in corrected:
            shares[name] = _change({**corrected, name: corrected[name] + step}, state, setup, total)
        elif step and name in state:
            moved = _moved(state, name, step)
            # the states are regressors: a constant error of the angle is one of the constant of a
            # fit
            shares[name] = _change(corrected, moved, setup, total) | {
                other: moved[other] - state[other] for other in STATE if other in state
            }
    for (name, part), change in tare.items():
        shares[f"tare {Path(path).stem} {name} {part}"] = _change(
            {**corrected, name: corrected[name] + change[on]}, state, setup, total
        )
    return _dataset(state, total, shares, points["time"][on], Path(path).stem)


def without_nuisance(
    data: Sequence[xr.Dataset], model: RegressionModel, setup: BalanceSetup
) -> list[xr.Dataset]:
    """Return the points less tare and interference, estimated together with a model.

    Parameters
    ----------
    data : sequence of Dataset (time,)
        As from `balance_coefficients`; the terms are common to all of them.
    model : Model
        Of the coefficient.
    setup : BalanceSetup
        Its ``nuisance`` lists terms of the coefficient: ``tare``, a load that does not change with
        the wind, hence 1/(qbar S); or a product of columns, such as ``strut*alpha``.

    Returns
    -------
    list of Dataset (time,)
        The coefficient less the terms, whose standard errors are further sources: what is then
        fitted equals the fit with the terms in it, standard errors included.

    Raises
    ------
    IdentificationError
        Terms that the points cannot distinguish from the model.
    """
    terms, name = setup.nuisance.get(model.coefficient, ()), model.coefficient
    if not terms:
        return list(data)
    blocks = [
        np.column_stack([_nuisance(one, term, setup.reference.S) for term in terms]) for one in data
    ]
    N, X = np.concatenate(blocks), np.concatenate([model.design(one) for one in data])
    z = np.concatenate([one[name].values for one in data])
    A = np.column_stack([X, N])
    size = np.sqrt((A**2).sum(axis=0))
    singular = np.linalg.svd(A / np.where(size > 0.0, size, 1.0), compute_uv=False)
    if not (size > 0.0).all() or singular[-1] < _DETERMINED * singular[0]:
        raise IdentificationError(
            f"{model.coefficient}: the points cannot distinguish {', '.join(terms)} from "
            f"{', '.join(model.terms)}; vary airspeed or the "
            "columns of the terms, or add points with the wind off"
        )
    inverse = np.linalg.inv(A.T @ A)
    found = inverse @ A.T @ z
    v = z - A @ found
    C = float(v @ v) / (len(z) - A.shape[1]) * inverse[X.shape[1] :, X.shape[1] :]
    values, root = found[X.shape[1] :], np.linalg.cholesky(C)
    estimates = ", ".join(
        f"{term} {x:.4g} +- {s:.2g}" for term, x, s in zip(terms, values, np.sqrt(np.diag(C)))
    )
    clean = []
    for one, block in zip(data, blocks):
        changed = one.assign(
            {
                name: (
                    "time",
                    one[name].values - block @ values,
                    {**one[name].attrs, "nuisance": estimates},
                )
            }
        )
        clean.append(
            _with_sources(
                changed,
                {
                    f"nuisance {name} {k + 1}": {name: share}
                    for k, share in enumerate((block @ root).T)
                },
            )
        )
    return clean


def _points(path: str | Path, setup: BalanceSetup) -> tuple[dict[str, np.ndarray], list[str]]:
    """Columns in SI units, and which loads there are."""
    recording = open_recording(path, NameMap({}))
    tables = recording.tables
    found: dict[str, np.ndarray] = {}
    for name, si in UNITS.items():
        wanted = setup.columns.get(name)
        column = _column(tables, recording, wanted or name, path, wanted is not None)
        if column is not None:
            found[name] = np.asarray(to_si(column[0], column[1] or si, si))
    for name, wanted in setup.columns.items():
        if name not in UNITS:
            column = _column(tables, recording, wanted, path, True)
            assert column is not None  # required
            found[name] = np.asarray(to_si(column[0], column[1])) if column[1] else column[0]
    loads = [name for name in LOADS if name in found]
    problems = [] if "alpha" in found else ["no column of alpha"]
    problems += [] if "V" in found or "qbar" in found else ["no column of V or qbar"]
    problems += [] if loads else [f"no load; expected some of {', '.join(LOADS)}"]
    if problems:
        raise SchemaError(str(path), [f"{problem}; name it in [columns]" for problem in problems])
    size = len(found["alpha"])
    clock = next(
        (name for table in tables.values() for name in CLOCK_NAMES if name in table.columns), None
    )
    table = next(iter(tables.values()))
    found["time"] = np.asarray(table.columns[clock], float) if clock else _CLOCK * np.arange(size)
    good = np.logical_and.reduce([np.isfinite(values) for values in found.values()])
    found = {name: values[good] for name, values in found.items()}
    for name, value in {"beta": 0.0, "rho": setup.rho, **setup.constants}.items():
        found.setdefault(name, np.full(int(good.sum()), value))
    if "qbar" not in found:
        found["qbar"] = 0.5 * found["rho"] * found["V"] ** 2
    return found, loads


def _column(
    tables: Mapping, recording, wanted: str, path, required: bool
) -> tuple[np.ndarray, str] | None:
    """Values and unit of a column; points need no clock."""
    name, _, unit = wanted.partition("[")
    table = next(iter(tables.values()))
    if len(tables) == 1 and name.strip() in table.columns:
        return np.asarray(table.columns[name.strip()], float), unit.strip().rstrip(
            "]"
        ).strip() or table.units.get(name.strip(), "")
    place = locate_column(recording, wanted, path, required)
    return None if place is None else place[1:]


def _without_tare(
    measured: Mapping[str, np.ndarray], points: Mapping[str, np.ndarray], off: np.ndarray
) -> tuple[dict[str, np.ndarray], dict[tuple[str, int], np.ndarray]]:
    """Loads less the tare of the points with the wind off, and what one standard error of each part
    of the tare changes.
    """
    if not off.any():
        return dict(measured), {}
    changes: dict[tuple[str, int], np.ndarray] = {}
    alpha = points["alpha"]
    every = np.column_stack(
        [
            np.ones(len(alpha)),
            np.sin(alpha) - np.sin(alpha[off]).mean(),
            np.cos(alpha) - np.cos(alpha[off]).mean(),
        ]
    )
    use = [0]
    for k in (1, 2):  # only what the attitudes determine
        trial = every[off][:, [*use, k]]
        size = np.sqrt((trial**2).sum(axis=0))
        if (
            off.sum() > len(use) + 2
            and (size > 0.0).all()
            and np.linalg.svd(trial / size, compute_uv=False)[-1] > 0.05
        ):
            use.append(k)
    A, corrected = every[:, use], {}
    inverse = np.linalg.inv(A[off].T @ A[off])
    for name, values in measured.items():
        tare = inverse @ A[off].T @ values[off]
        v = values[off] - A[off] @ tare
        freedom = max(1, int(off.sum()) - len(use))
        root = np.linalg.cholesky(inverse) * np.sqrt(max(float(v @ v) / freedom, 0.0))
        corrected[name] = values - A @ tare
        changes |= {(name, k + 1): -A @ column for k, column in enumerate(root.T) if column.any()}
    return corrected, changes


def _coefficients(
    loads: Mapping[str, np.ndarray], state: Mapping[str, np.ndarray], setup: BalanceSetup
) -> dict[str, np.ndarray]:
    """Coefficients that the loads determine; a force that was not measured leaves those that need
    it out.
    """
    size, reference = len(state["alpha"]), setup.reference
    C = matrix_from_euler(*setup.balance.rotation).T  # from balance to body axes, or to tunnel axes
    known = np.array([name in loads for name in LOADS])
    F, M = (
        np.stack([loads.get(name, np.zeros(size)) for name in names], axis=1) @ C.T
        for names in (FORCES, MOMENTS)
    )
    needs_F, needs_M = (np.abs(C) > 1e-9 for _ in range(2))
    if not setup.balance.moves:
        to_body = matrix_from_euler(0.0, state["alpha"], -state["beta"])
        F, M = (np.einsum("nij,nj->ni", to_body, x) for x in (F, M))
    has_F, has_M = (
        ~(needs & ~known[part]).any(axis=1)
        for needs, part in ((needs_F, slice(0, 3)), (needs_M, slice(3, 6)))
    )
    if not setup.balance.moves:
        has_F, has_M = np.full(3, has_F.all()), np.full(3, has_M.all())
    scale = 1.0 / (state["qbar"] * reference.S)
    found: dict[str, np.ndarray] = {}
    for name, k in zip(("CX", "CY", "CZ"), range(3)):
        if has_F[k]:
            found[name] = scale * F[:, k]
    if has_F[0] and has_F[2]:
        found["CL"], found["CD"] = lift_drag(found["CX"], found["CZ"], state["alpha"])
    if has_M.any() and (has_F.all() or not np.any(setup.balance.offset)):
        M = transfer_moment(M, F, np.array(setup.balance.offset), np.zeros(3))
        lengths = reference.b, reference.c, reference.b
        found |= {
            name: scale * M[:, k] / lengths[k]
            for k, name in enumerate(("Cl", "Cm", "Cn"))
            if has_M[k]
        }
    return {name: found[name] for name in COEFFICIENTS if name in found}


def _change(
    loads, state, setup: BalanceSetup, total: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    return {
        name: values - total[name] for name, values in _coefficients(loads, state, setup).items()
    }


def _moved(state: Mapping[str, np.ndarray], name: str, step: float) -> dict[str, np.ndarray]:
    """The state with one measurand in error; airspeed and density are in the dynamic pressure."""
    moved = {**state, name: state[name] + step}
    if name in ("V", "rho") and "V" in state:
        moved["qbar"] = state["qbar"] * moved["rho"] / state["rho"] * (moved["V"] / state["V"]) ** 2
    return moved


def _dataset(
    state, total, shares: Mapping[str, Mapping[str, np.ndarray]], time: np.ndarray, record: str
) -> xr.Dataset:
    units = {**STATE, "time": "s"}
    columns = {
        name: ("time", values, {"units": units.get(name, "1")})
        for name, values in state.items()
        if name not in (*LOADS, "time")
    }
    columns |= {name: ("time", values, {"units": "1"}) for name, values in total.items()}
    return _with_sources(
        xr.Dataset(columns, {"time": ("time", time, {"units": "s"})}, {"record": record}), shares
    )


def _with_sources(data: xr.Dataset, shares: Mapping[str, Mapping[str, np.ndarray]]) -> xr.Dataset:
    """Return the points with further sources of common errors."""
    before = [str(name) for name in data["error"].values] if "error" in data.dims else []
    sources = [*before, *shares]
    size, columns = data.sizes["time"], {}
    for name in (*COEFFICIENTS, *STATE):
        if name not in data:
            continue
        rows = [
            *(
                data[f"{name}_error"].values
                if f"{name}_error" in data
                else np.zeros((len(before), size))
            )
        ]
        rows += [np.asarray(share.get(name, np.zeros(size))) for share in shares.values()]
        if rows and (name in COEFFICIENTS or np.any(rows)):
            columns[f"{name}_error"] = (("error", "time"), np.array(rows))
    if not columns:
        return data
    return data.drop_dims("error", errors="ignore").assign(columns).assign_coords(error=sources)


def _nuisance(data: xr.Dataset, term: str, S: float) -> np.ndarray:
    if term == "tare":
        return 1.0 / (data["qbar"].values * S)
    column = np.ones(data.sizes["time"])
    for name in _factors(term):
        if name not in data:
            raise SchemaError(
                "nuisance", [f"{term}: the points have no column {name}; name it in [columns]"]
            )
        column = column * data[name].values
    return column


def _factors(term: str) -> Iterable[str]:
    return (name.strip() for name in term.split("*"))
