"""The quantities of a reconstructed path: everything that follows from trajectory, constants and
recorded channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, calibrated_airspeed
from flightmech.errors import UnknownName
from flightmech.names import REDUCED_RATES, quantity_attributes
from flightmech.support.figures import new_figure
from flightmech.units import G0
from flighttest.reconstruction.dynamics.kinematics import in_body, incidence_rates
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.output_equations import impact_static_pressures, no_sideslip
from flighttest.reconstruction.problem.problem import (
    PER_RUN,
    PathProblem,
    Sensor,
    body_rates,
    specific_force,
    wind_velocity,
)
from flighttest.reconstruction.problem.trajectory import (
    Solution,
    linearise,
    sensor_residuals,
    step_trajectory,
)
from flighttest.records.sensors.instruments import IMU
from flighttest.records.sensors.measurements import MEASURED
from flighttest.records.signals.conditioning import SLOW, demand_numbers, resample_to_grid
from flighttest.records.time_histories import break_at_gaps

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VERSIONS = ("raw", "corrected", "reconstructed")


def channel_signals(setup: Setup, solution: Solution) -> xr.Dataset:
    """Return raw, corrected and reconstructed signal of every channel that was measured.

    Returns
    -------
    Dataset (time, version)
        On the clock of the path: ``raw`` at the sample next to its time stamp, ``corrected`` next
        to the instant that it shows; NaN where the channel has no reading.  Attributes ``rms_raw``
        and ``rms_corrected``: rms of each against the reconstructed one.
    """
    problem = setup.problem
    found: dict[str, Any] = {}
    for sensor in problem.sensors:
        if sensor.model is no_sideslip:  # no instrument
            continue
        rest, k = sensor_residuals(problem, sensor, solution.x, solution.c)
        bare = _without_errors(problem, sensor, solution.c)
        late, k_late = sensor_residuals(problem, sensor, solution.x, bare)
        latency = problem.constants.get(solution.c, sensor.delay) if sensor.delay else 0.0
        shifted = replace(sensor, time=sensor.time - latency)
        true = sensor.z - sensor_residuals(problem, shifted, solution.x, bare)[0]
        for j, name in enumerate(sensor.names):
            columns = np.full((len(problem.time), len(VERSIONS)), np.nan)
            columns[k_late, 0], columns[k_late, 2] = sensor.z[:, j], sensor.z[:, j] - late[:, j]
            columns[k, 1], columns[k, 2] = (
                true[:, j] + rest[:, j] / problem.constants.get(solution.c, f"factor.{name}", 1.0),
                true[:, j],
            )
            rms = {
                "rms_raw": float(np.sqrt(np.mean(late[:, j] ** 2))),
                "rms_corrected": float(np.sqrt(np.mean(rest[:, j] ** 2))),
            }
            found[name] = (("time", "version"), columns, {**quantity_attributes(name), **rms})
    return xr.Dataset(
        found,
        coords={
            "time": ("time", problem.time, quantity_attributes("time")),
            "version": list(VERSIONS),
        },
    )


def _without_errors(problem: PathProblem, sensor: Sensor, c: np.ndarray) -> np.ndarray:
    """Return the constants with the errors of one sensor taken off."""
    ideal = {"static_error": 0.0, sensor.delay: 0.0}
    for name in sensor.names:
        ideal |= {f"bias.{name}": 0.0, f"factor.{name}": 1.0}
    return np.array(
        [ideal.get(name, value) for name, value in zip(problem.constants.names, c, strict=True)]
    )


_STYLE = {"raw": ("0.6", 0.8), "corrected": ("tab:blue", 0.8), "reconstructed": ("tab:red", 1.1)}


def compatibility_figure(
    compatibility: xr.Dataset, title: str, channels: Sequence[str] | None = None
) -> Figure:
    """Return raw, corrected and reconstructed signal of each channel over time as a figure
    ([Gresham] figure 5).

    Parameters
    ----------
    compatibility : Dataset (time, version)
        Of a path.
    title : str
        Name of the record.
    channels : sequence of str, optional
        All measured channels without it.

    Raises
    ------
    UnknownName
        A channel that was not measured.
    AeromatchError
        matplotlib is not installed.
    """
    known = list(map(str, compatibility.data_vars))
    chosen = list(channels) if channels is not None else known
    for name in chosen:
        if name not in known:
            raise UnknownName(name, known, "measured channel")
    rows = -(-len(chosen) // 2)
    figure = new_figure(11.0, 1.9 * rows + 0.8)
    axes = figure.subplots(rows, min(2, len(chosen)), sharex=True, squeeze=False)
    for ax, name in zip(axes.flat, chosen, strict=False):
        _draw_channel(ax, compatibility[name])
    for ax in axes.flat[len(chosen) :]:
        ax.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    axes.flat[0].legend(loc="best", fontsize="small", frameon=False)
    figure.suptitle(f"Data compatibility: {title}", fontsize="medium")
    return figure


def _draw_channel(ax, signals: xr.DataArray) -> None:
    shown, factor = (
        ("deg", np.degrees(1.0))
        if signals.attrs.get("units") == "rad"
        else (signals.attrs.get("units", ""), 1.0)
    )
    time = signals["time"].values
    for version, (colour, width) in _STYLE.items():
        values = signals.sel(version=version).values * factor
        ax.plot(*break_at_gaps(time, values), color=colour, linewidth=width, label=version)
    before, after = (factor * signals.attrs[key] for key in ("rms_raw", "rms_corrected"))
    ax.set_title(f"{signals.name}: rms {before:.3g} before, {after:.3g} after", fontsize="small")
    ax.set_ylabel(f"[{shown}]")
    ax.grid(linewidth=0.3)


_RAW = {*MEASURED, *IMU, "V_eas", "h_baro", "north", "east", *SLOW}


def solution_states(
    record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution
) -> xr.Dataset:
    """Return the states of a solution with the controls, engines and mass of the record on the same
    clock.
    """
    problem = setup.problem
    columns = path_columns(record, aircraft, setup, solution.x, solution.c)
    data = xr.Dataset(
        {n: ("time", v, quantity_attributes(n)) for n, v in columns.items()},
        coords={"time": ("time", problem.time, quantity_attributes("time"))},
    )
    data.attrs = {
        "record": str(record.attrs.get("title", "")),
        "rate": 1.0 / problem.dt,
        "iterations": solution.iterations,
        "unused": " ".join(setup.unused),
        "spikes": "; ".join(setup.spikes),
        "manoeuvres": str(record.attrs.get("manoeuvres", "[]")),
        "gusts": "none" if problem.gust is None else " ".join(f"{s:.3g}" for s in problem.gust),
    }
    return data


def path_columns(
    record: xr.DataTree, aircraft: Any, setup: Setup, x: np.ndarray, c: np.ndarray
) -> dict[str, np.ndarray]:
    """Return `motion_quantities` of a trajectory (N, n) and constants (nc,), with recorded channels and mass
    properties. [SI]
    """
    problem = setup.problem
    columns = motion_quantities(record, aircraft, setup, x, c)
    columns.update(_recorded(record, problem.time, problem.starts, set(columns)))
    columns.update(_mass(record, problem.time, aircraft, setup))
    return columns


def motion_quantities(
    record: xr.DataTree,
    aircraft: Any,
    setup: Setup,
    x: np.ndarray,
    c: np.ndarray,
    inertial: tuple[np.ndarray, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return the quantities that follow from a trajectory (N, n) and constants (nc,). [SI]

    Parameters
    ----------
    record : DataTree
    aircraft : Aircraft
    setup : Setup
    x : array (N, n)
    c : array (nc,)
    inertial : (array (N, 3), array (N, 3)), optional
        `body_rates` and `specific_force` of these constants, where they are known.
    """
    problem = setup.problem
    omega, force = inertial or (body_rates(problem, c), specific_force(problem, c))
    p, q, r = omega.T
    ax, ay, az = force.T
    phi, theta, psi, vn, ve, vd, h = np.ascontiguousarray(x[:, :7].T)
    wind_n, wind_e, wind_d = wind_velocity(problem, x, c).T
    u, v, w, down = in_body(phi, theta, psi, vn - wind_n, ve - wind_e, vd - wind_d)
    columns = {"phi": phi, "theta": theta, "psi": psi, "vn": vn, "ve": ve, "vd": vd, "h": h}
    columns |= {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}
    columns.update(zip(("p_dot", "q_dot", "r_dot"), problem.omega_dot.T, strict=True))
    columns |= {"ax": ax, "ay": ay, "az": az, "wind_n": wind_n, "wind_e": wind_e, "wind_d": wind_d}
    square = u * u + v * v + w * w
    V = np.sqrt(square)
    q_c, pressure = impact_static_pressures(
        problem, square, h, c, setup.temperature, setup.reference
    )
    T = setup.temperature - problem.constants.get(c, "bias.temperature")
    rho = pressure / (R_AIR * T)
    g = problem.gravity_at(h)
    free = [a + g * d for a, d in zip((ax, ay, az), down, strict=True)]
    alpha_dot, beta_dot = incidence_rates((u, v, w), (p, q, r), free)
    half = 1.0 / (2.0 * np.maximum(V, 1.0))
    columns.update(
        V=V,
        alpha=np.arctan2(w, u),
        beta=np.arcsin(np.clip(v / np.maximum(V, 1e-6), -1.0, 1.0)),
        V_cas=calibrated_airspeed(q_c),
        mach=V / np.sqrt(GAMMA * R_AIR * T),
        qbar=0.5 * rho * square,
        rho=rho,
        p_static=pressure,
        temperature=T,
        alpha_dot=alpha_dot,
        beta_dot=beta_dot,
    )
    for name, (rate, length) in REDUCED_RATES.items():
        if rate in columns:
            columns[name] = columns[rate] * getattr(aircraft, length) * half
    columns.update(
        hdot=-vd,
        gamma=np.arctan2(-vd, np.sqrt(vn * vn + ve * ve)),
        nz=-az / G0,
    )
    if "runway_elevation" in record.attrs:
        x_cg, y_cg, z_cg = setup.cg
        columns["h_agl"] = (
            h
            + (down[0] * x_cg + down[1] * y_cg + down[2] * z_cg)
            - float(record.attrs["runway_elevation"])
        )
    return columns


def _recorded(
    record: xr.DataTree, time: np.ndarray, starts: np.ndarray, known: set[str]
) -> dict[str, np.ndarray]:
    """Return controls, engine channels and whatever else the record holds in addition to the
    instruments, on the clock of the path.
    """
    grids = np.split(time, starts[1:])
    columns = {}
    for leaf, tree in record.children.items():
        node = tree.to_dataset()
        wanted = [str(name) for name in node.data_vars if name not in _RAW and name not in known]
        if not wanted:
            continue
        demand_numbers(
            {leaf: node[wanted].sel(time=slice(time[0], time[-1]))}, "recorded inputs of a path"
        )
        clock = node["time"].values
        for name in wanted:
            columns[name] = np.concatenate(
                [resample_to_grid(clock, node.variables[name].values, grid, name) for grid in grids]
            )
    return columns


def _mass(
    record: xr.DataTree, time: np.ndarray, aircraft: Any, setup: Setup
) -> dict[str, np.ndarray]:
    """Return mass along the path: gauged mass with the recorded fuel flow between, or a straight
    line through it.
    """
    place = dict(zip(("x_cg_b", "y_cg_b", "z_cg_b"), setup.cg, strict=True))
    columns = {name: np.full(len(time), value) for name, value in place.items()}
    node = next(
        (node.to_dataset() for node in record.children.values() if "mass" in node.data_vars), None
    )
    if node is None:
        columns["mass"] = np.full(len(time), float(aircraft.mass))
        return columns
    clock, gauged = node["time"].values, node["mass"].values
    engine = next(
        (
            n.to_dataset()
            for n in record.children.values()
            if any(str(name).endswith("fuel_flow") for name in n.data_vars)
        ),
        None,
    )
    if engine is not None:
        total = np.sum(
            [engine[name].values for name in engine.data_vars if str(name).endswith("fuel_flow")],
            axis=0,
        )
        t = engine["time"].values
        burnt = np.concatenate([[0.0], np.cumsum(0.5 * (total[1:] + total[:-1]) * np.diff(t))])
        columns["mass"] = float(np.mean(gauged + np.interp(clock, t, burnt))) - np.interp(
            time, t, burnt
        )
    else:
        line = np.polyfit(clock - clock[0], gauged, 1 if len(clock) > 10 else 0)
        columns["mass"] = np.polyval(line, time - clock[0])
    return columns


STATES = (
    # that coefficients and regressors are made of
    *(
        "V",
        "qbar",
        "mach",
        "alpha",
        "beta",
        "alpha_dot",
        "beta_dot",
        "p",
        "q",
        "r",
        "ax",
        "ay",
        "az",
        "phi",
        "h",
        "h_agl",
    ),
    # that replays start from or are judged on
    *("theta", "psi", "gamma", "V_cas", "nz"),
)


def state_errors(
    record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution
) -> xr.Dataset:
    """Return the change of the states for one standard error of each independent error of the
    constants.

    Parameters
    ----------
    record : DataTree
    aircraft : Aircraft
    setup, solution
        Of `reconstruction.solve`.

    Returns
    -------
    Dataset (error, time)
        `STATES`, in their units, single precision.  Errors of the instruments carry the name of
        their constant, those of the run ``"<constant> of <title of the record>"``.
    """
    problem, x, c = setup.problem, solution.x, solution.c
    names = problem.constants.names
    order = sorted(
        range(len(names)), key=lambda i: names[i] in PER_RUN
    )  # stable: the instruments first
    scale = np.sqrt(np.diag(solution.covariance))[order]
    correlation = solution.covariance[np.ix_(order, order)] / np.outer(scale, scale)
    L = scale[:, None] * np.linalg.cholesky(
        correlation + 1e-12 * np.eye(len(scale))
    )  # two constants may do all but the same
    full = np.zeros_like(L)
    full[order] = L  # of all constants, in their own order, by the errors
    x = np.asfortranarray(x)  # from here on single states are read
    inertial = body_rates(problem, c), specific_force(problem, c)
    nominal = motion_quantities(record, aircraft, setup, x, c, inertial)
    known = [name for name in STATES if name in nominal]
    found = {name: np.empty((len(order), len(x)), np.float32) for name in known}
    change = np.empty(len(x))
    drive = np.isin(names, [f"{kind}.{channel}" for kind in ("bias", "scale") for channel in IMU])
    equations = solution.equations or linearise(problem, solution.x, c)
    for k, (dc, dx) in enumerate(zip(full.T, equations.following(full), strict=True)):
        # a difference over a part of the error where it is large: a constant that nothing
        # determines has no bound
        part = 1.0 / max(1.0, np.abs(dc).max(), dx.max(), -dx.min())
        same = None if dc[drive].any() else inertial
        changed = motion_quantities(
            record, aircraft, setup, step_trajectory(x, part * dx), c + part * dc, same
        )
        for name in known:
            np.subtract(changed[name], nominal[name], out=change)
            found[name][k] = change if part == 1.0 else change / part
    title = str(record.attrs.get("title", ""))
    labels = [f"{names[i]} of {title}" if names[i] in PER_RUN else names[i] for i in order]
    return xr.Dataset(
        {
            name: (("error", "time"), change, quantity_attributes(name))
            for name, change in found.items()
        },
        coords={"error": labels, "time": ("time", problem.time, quantity_attributes("time"))},
    )
