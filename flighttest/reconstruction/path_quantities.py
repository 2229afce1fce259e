"""Quantities of a reconstructed path: motion, air data, recorded channels and mass."""

from __future__ import annotations

import json
import warnings
from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, calibrated_airspeed
from flightmech.aircraft.aircraft import tanks_of
from flightmech.errors import AeromatchWarning
from flightmech.names import REDUCED_RATES, quantity_attributes
from flightmech.quantities import time_text
from flightmech.support.arrays import integrate_trapezoids
from flightmech.units import G0
from flighttest.reconstruction.dynamics.kinematics import in_body, incidence_rates
from flighttest.reconstruction.problem.assembly import Setup
from flighttest.reconstruction.problem.output_equations import impact_static_pressures
from flighttest.reconstruction.problem.problem import body_rates, specific_force, wind_velocity
from flighttest.reconstruction.problem.trajectory import Solution
from flighttest.records.sensors.instruments import IMU
from flighttest.records.sensors.measurements import MEASURED, lies_in_windows, without_blanks
from flighttest.records.signals.clock_gaps import channel_gaps, gaps_in
from flighttest.records.signals.conditioning import SLOW, demand_numbers
from flighttest.records.signals.resampling import resample_to_grid

# Channels of the record that the reconstructed quantities replace.
_RAW = {*MEASURED, *IMU, "V_eas", "h_baro", "north", "east", *SLOW}
CHANNEL_GAPS = "channel_gaps"
"""Attribute of states: gaps of recorded controls and devices, as JSON. [s]

A line bridges them in the states.
"""
_LEAST_SPEED = 1e-6  # m/s, keeps the sideslip angle finite at rest
_LEAST_REDUCING_SPEED = 1.0  # m/s, in reduced rates
_FEW_GAUGINGS = 10  # of the mass, up to which its mean is taken instead of a straight line


def solution_states(
    record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution
) -> xr.Dataset:
    """Return the states of a solution, with controls, engines and mass of the record.

    Returns
    -------
    Dataset (time,)
        On the clock of the path. [SI]
    """
    problem = setup.problem
    columns = path_columns(record, aircraft, setup=setup, x=solution.x, c=solution.c)
    variables = {}
    for name, values in columns.items():
        variables[name] = ("time", values, quantity_attributes(name))
    clock = ("time", problem.time, quantity_attributes("time"))
    states = xr.Dataset(variables, coords={"time": clock})
    gusts = "none"
    if problem.gust is not None:
        gusts = " ".join(f"{sigma:.3g}" for sigma in problem.gust)
    states.attrs = {
        "record": str(record.attrs.get("title", "")),
        "rate": 1.0 / problem.dt,
        "iterations": solution.iterations,
        "unused": " ".join(setup.unused),
        "spikes": "; ".join(setup.spikes),
        "manoeuvres": str(record.attrs.get("manoeuvres", "[]")),
        "gusts": gusts,
        CHANNEL_GAPS: json.dumps(_channel_gaps(record)),
    }
    return states


def _channel_gaps(record: xr.DataTree) -> dict[str, list[tuple[float, float]]]:
    """Return start and end of every gap by channel, of recorded channels of the states. [s]"""
    gaps = {}
    for node in record.children.values():
        data = node.to_dataset()
        for name in map(str, data.data_vars):
            if name not in _RAW and (found := channel_gaps(data, name)):
                gaps[name] = found
    return gaps


def path_columns(
    record: xr.DataTree, aircraft: Any, setup: Setup, x: np.ndarray, c: np.ndarray
) -> dict[str, np.ndarray]:
    """Return `motion_quantities` with recorded channels and mass properties. [SI]

    The arguments are as in `motion_quantities`.
    """
    problem = setup.problem
    columns = motion_quantities(record, aircraft, setup=setup, x=x, c=c)
    # windows of the path: a channel is not interpolated between two windows
    grids = np.split(problem.time, problem.starts[1:])
    columns |= _recorded_channels(record, grids, excluded=_RAW | columns.keys())
    columns |= _cg_along(record, problem.time, aircraft, mean=setup.cg)
    columns["mass"] = _mass_along(record, problem.time, aircraft)
    return columns


def motion_quantities(
    record: xr.DataTree,
    aircraft: Any,
    setup: Setup,
    x: np.ndarray,
    c: np.ndarray,
    inertial: tuple[np.ndarray, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """Return the quantities that follow from a trajectory and constants. [SI]

    Parameters
    ----------
    record : DataTree
        For the elevation of the runway.
    aircraft : Aircraft
        For span and mean chord.
    setup : Setup
    x : array (N, n)
        Trajectory.
    c : array (nc,)
        Constants.
    inertial : (array (N, 3), array (N, 3)), optional
        `body_rates` and `specific_force` of these constants, if they are computed already.

    Returns
    -------
    dict of array (N,)
        Attitude, velocities, rates, specific force at the c.g., wind, air data, reduced rates,
        flight-path angle, load factor and heights.
    """
    problem = setup.problem
    omega, force = inertial or (body_rates(problem, c), specific_force(problem, c))
    p, q, r = omega.T
    ax, ay, az = force.T
    phi, theta, psi, vn, ve, vd, h = np.ascontiguousarray(x[:, :7].T)
    wind_n, wind_e, wind_d = wind_velocity(problem, x, c).T
    u, v, w, down = in_body(phi, theta, psi, n=vn - wind_n, e=ve - wind_e, d=vd - wind_d)
    columns = {"phi": phi, "theta": theta, "psi": psi, "vn": vn, "ve": ve, "vd": vd, "h": h}
    columns |= {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}
    columns.update(zip(("p_dot", "q_dot", "r_dot"), problem.omega_dot.T, strict=True))
    columns |= {"ax": ax, "ay": ay, "az": az, "wind_n": wind_n, "wind_e": wind_e, "wind_d": wind_d}
    square = u * u + v * v + w * w
    V = np.sqrt(square)
    columns["V"] = V
    columns["alpha"] = np.arctan2(w, u)
    columns["beta"] = np.arcsin(np.clip(v / np.maximum(V, _LEAST_SPEED), -1.0, 1.0))
    columns |= _air_columns(setup, c, square=square, V=V, h=h)
    # acceleration at the c.g. in body axes: specific force and gravity
    g = problem.gravity_at(h)
    free = [a + g * d for a, d in zip((ax, ay, az), down, strict=True)]
    alpha_dot, beta_dot = incidence_rates((u, v, w), (p, q, r), free)
    columns |= {"alpha_dot": alpha_dot, "beta_dot": beta_dot}
    columns |= _reduce_rates(columns, aircraft)
    columns.update(
        hdot=-vd,
        gamma=np.arctan2(-vd, np.sqrt(vn * vn + ve * ve)),
        nz=-az / G0,
    )
    if "runway_elevation" in record.attrs:
        # from the c.g. back to the body origin
        cg = _cg_along(record, problem.time, aircraft, mean=setup.cg)
        below = down[0] * cg["x_cg_b"] + down[1] * cg["y_cg_b"] + down[2] * cg["z_cg_b"]
        columns["h_agl"] = h + below - float(record.attrs["runway_elevation"])
    return columns


def _reduce_rates(columns: dict[str, np.ndarray], aircraft: Any) -> dict[str, np.ndarray]:
    """Return the reduced rates, such as q cbar / 2 V, of all rates that there are. [1]"""
    half = 1.0 / (2.0 * np.maximum(columns["V"], _LEAST_REDUCING_SPEED))
    reduced = {}
    for name, (rate, length) in REDUCED_RATES.items():
        if rate in columns:
            reduced[name] = columns[rate] * getattr(aircraft, length) * half
    return reduced


def _air_columns(
    setup: Setup, c: np.ndarray, square: np.ndarray, V: np.ndarray, h: np.ndarray
) -> dict[str, np.ndarray]:
    """Return air data from the airspeed V and its square, the height and the temperature."""
    problem = setup.problem
    q_c, pressure = impact_static_pressures(
        problem, square, h=h, c=c, temperature=setup.temperature, reference=setup.reference
    )
    T = setup.temperature - problem.constants.get(c, "bias.temperature")
    rho = pressure / (R_AIR * T)
    return {
        "V_cas": calibrated_airspeed(q_c),
        "mach": V / np.sqrt(GAMMA * R_AIR * T),
        "qbar": 0.5 * rho * square,
        "rho": rho,
        "p_static": pressure,
        "temperature": T,
    }


def _recorded_channels(
    record: xr.DataTree, grids: list[np.ndarray], excluded: set[str]
) -> dict[str, np.ndarray]:
    """Return controls, engine channels and all other channels on the clock of the path."""
    windows = [(grid[0], grid[-1]) for grid in grids]
    columns = {}
    for leaf, tree in record.children.items():
        node = tree.to_dataset()
        names = [str(name) for name in node.data_vars if name not in excluded]
        if not names:
            continue
        clock = node.variables["time"].values
        samples = {name: node.variables[name].values for name in names}
        if not all(np.isfinite(values).all() for values in samples.values()):
            # Blank cells are bridged by a line, as lost rows are; `CHANNEL_GAPS` has the longer
            # ones. What is infinite, or blank in all windows, has no values to bridge.
            inside = node[names].isel(time=lies_in_windows(windows, clock))
            unusable = [name for name in names if not _has_bridge(inside[name].values)]
            demand_numbers({leaf: inside[unusable]}, "recorded inputs of a path")
            _warn_of_bridges(node[names], windows)
            samples = {name: without_blanks(clock, values) for name, values in samples.items()}
        for name, values in samples.items():
            pieces = [resample_to_grid(clock, values, grid, name) for grid in grids]
            columns[name] = np.concatenate(pieces)
    return columns


def _has_bridge(x: np.ndarray) -> bool:
    """Return whether a line through the values of a channel (time,) bridges its blank cells."""
    return bool(np.isfinite(x).any() and not np.isinf(x).any())


def _warn_of_bridges(node: xr.Dataset, windows: list[tuple[float, float]]) -> None:
    """Warn once of the channels (time,) that a line bridges over a gap in a window."""
    texts = []
    for name in map(str, node.data_vars):
        if np.isfinite(node[name].values).all():
            continue
        gaps = [gap for gap in channel_gaps(node, name) if _is_inside(gap, windows)]
        texts += [f"{name} from {time_text(start)} to {time_text(stop)} s" for start, stop in gaps]
    if texts:
        text = (
            f"a line bridges the blank cells of {', '.join(texts)}; leave these times out of the "
            f"windows of fits and cases"
        )
        warnings.warn(text, AeromatchWarning, stacklevel=2)


def _is_inside(gap: tuple[float, float], windows: list[tuple[float, float]]) -> bool:
    """Return whether a window contains a part of a gap. [s]"""
    return any(gaps_in(window, [gap]) for window in windows)


def _mass_along(record: xr.DataTree, time: np.ndarray, aircraft: Any) -> np.ndarray:
    """Return the mass along the path (time,). [kg]

    It is the gauged mass with the recorded fuel flow in between, or a straight line through the
    gauged mass. A record without gauged mass has the mass of the aircraft with the recorded
    contents of its tanks.
    """
    gauges = _gauged_leaf(record)
    if gauges is None:
        return _mass_with_tanks(record, time, aircraft)
    clock, gauged = gauges["time"].values, gauges["mass"].values
    engine = _fuel_leaf(record)
    if engine is None:
        degree = 0
        if len(clock) > _FEW_GAUGINGS:
            degree = 1
        line = np.polyfit(clock - clock[0], gauged, degree)
        return np.polyval(line, time - clock[0])
    # fuel burnt since the start of the record
    t = engine["time"].values
    names = [name for name in engine.data_vars if str(name).endswith("fuel_flow")]
    # blank cells outside the windows would make every later mass NaN
    flows = [without_blanks(t, engine[name].values) for name in names]
    flow = np.sum(flows, axis=0)
    burnt = integrate_trapezoids(t, flow)
    # The mean over all gaugings gives the mass at the start.
    start_mass = float(np.mean(gauged + np.interp(clock, t, burnt)))
    return start_mass - np.interp(time, t, burnt)


def _cg_along(
    record: xr.DataTree, time: np.ndarray, aircraft: Any, mean: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the coordinates of the c.g. along the path (time,). [m]

    A coordinate is as recorded. Without a record it follows the recorded contents of the tanks, and
    without these it is the mean (3,): a case starts with the c.g. at its start, not with a mean.
    """
    fuel = _fuel_of_tanks(record, time, aircraft)
    mass = np.full(len(time), float(aircraft.mass))
    moment = np.outer(mass, np.array(aircraft.cg, float))
    for tank in tanks_of(aircraft):
        if tank.name in fuel:
            change = fuel[tank.name] - tank.content
            mass = mass + change
            moment += np.outer(change, tank.position)
    columns = {}
    for k, name in enumerate(("x_cg_b", "y_cg_b", "z_cg_b")):
        recorded = _interpolated(record, name, time)
        if recorded is not None:
            columns[name] = recorded
        else:
            columns[name] = moment[:, k] / mass if fuel else np.full(len(time), mean[k])
    return columns


def _mass_with_tanks(record: xr.DataTree, time: np.ndarray, aircraft: Any) -> np.ndarray:
    """Return the mass of the aircraft with the recorded contents of its tanks (time,). [kg]"""
    mass = np.full(len(time), float(aircraft.mass))
    fuel = _fuel_of_tanks(record, time, aircraft)
    for tank in tanks_of(aircraft):
        if tank.name in fuel:
            mass += fuel[tank.name] - tank.content
    return mass


def _fuel_of_tanks(record: xr.DataTree, time: np.ndarray, aircraft: Any) -> dict[str, np.ndarray]:
    """Return the recorded contents of tanks along the path (time,), by the name of the tank.

    [kg]
    """
    fuel = {}
    for tank in tanks_of(aircraft):
        content = _interpolated(record, f"tank.{tank.name}.fuel", time)
        if content is not None:
            # a gauge may show a little more than full
            fuel[tank.name] = np.clip(content, 0.0, tank.capacity)
    return fuel


def _interpolated(record: xr.DataTree, name: str, time: np.ndarray) -> np.ndarray | None:
    """Return a slow channel along the path (time,), or None without any recorded value."""
    for node in record.children.values():
        # The variables themselves: a node makes a Dataset of them at each other question.
        variables = node.variables
        if name in variables and np.isfinite(variables[name].values).any():
            clock = variables["time"].values
            return np.interp(time, clock, without_blanks(clock, variables[name].values))
    return None


def _gauged_leaf(record: xr.DataTree) -> xr.Dataset | None:
    """Return the first leaf with gauged mass, without its blank cells."""
    for node in record.children.values():
        if "mass" in node.variables:
            data = node.to_dataset()
            known = np.isfinite(data["mass"].values)
            return data.isel(time=known) if known.any() else data
    return None


def _fuel_leaf(record: xr.DataTree) -> xr.Dataset | None:
    """Return the first leaf with the fuel flow of an engine."""
    for node in record.children.values():
        if any(str(name).endswith("fuel_flow") for name in node.variables):
            return node.to_dataset()
    return None
