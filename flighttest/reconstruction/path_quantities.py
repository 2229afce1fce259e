"""The quantities of a reconstructed path: everything that follows from trajectory, constants and recorded channels."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from flightmech.air import GAMMA, R_AIR, calibrated_airspeed
from flightmech.names import attrs
from flightmech.units import G0

from ..dynamics.kinematics import in_body, incidence_rates
from ..sensors.instruments import IMU
from ..sensors.measurements import MEASURED
from ..signals.conditioning import SLOW, demand_numbers, to_grid
from .problem.assembly import Setup
from .problem.output_equations import pressures
from .problem.problem import body_rates, specific_force, wind
from .problem.trajectory import Solution

_RAW = {*MEASURED, *IMU, "V_eas", "h_baro", "north", "east", *SLOW}


def path_states(record: xr.DataTree, aircraft: Any, setup: Setup, solution: Solution) -> xr.Dataset:
    """Return the states of a solution with the controls, engines and mass of the record on the same clock."""
    problem = setup.problem
    columns = columns_of(record, aircraft, setup, solution.x, solution.c)
    data = xr.Dataset({n: ("time", v, attrs(n)) for n, v in columns.items()}, coords={"time": ("time", problem.time, attrs("time"))})
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


def columns_of(record: xr.DataTree, aircraft: Any, setup: Setup, x: np.ndarray, c: np.ndarray) -> dict[str, np.ndarray]:
    """Return `motion` of a trajectory (N, n) and constants (nc,), with recorded channels and mass properties. [SI]"""
    problem = setup.problem
    columns = motion(record, aircraft, setup, x, c)
    columns.update(_recorded(record, problem.time, problem.starts, set(columns)))
    columns.update(_mass(record, problem.time, aircraft, setup))
    return columns


def motion(
    record: xr.DataTree, aircraft: Any, setup: Setup, x: np.ndarray, c: np.ndarray, inertial: tuple[np.ndarray, np.ndarray] | None = None
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
    wind_n, wind_e, wind_d = wind(problem, x, c).T
    u, v, w, down = in_body(phi, theta, psi, vn - wind_n, ve - wind_e, vd - wind_d)
    columns = {"phi": phi, "theta": theta, "psi": psi, "vn": vn, "ve": ve, "vd": vd, "h": h}
    columns |= {"u": u, "v": v, "w": w, "p": p, "q": q, "r": r}
    columns.update(zip(("p_dot", "q_dot", "r_dot"), problem.omega_dot.T, strict=True))
    columns |= {"ax": ax, "ay": ay, "az": az, "wind_n": wind_n, "wind_e": wind_e, "wind_d": wind_d}
    square = u * u + v * v + w * w
    V = np.sqrt(square)
    q_c, pressure = pressures(problem, square, h, c, setup.temperature, setup.reference)
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
        phat=p * aircraft.b * half,
        qhat=q * aircraft.cbar * half,
        rhat=r * aircraft.b * half,
        alphadothat=alpha_dot * aircraft.cbar * half,
        betadothat=beta_dot * aircraft.b * half,
        hdot=-vd,
        gamma=np.arctan2(-vd, np.sqrt(vn * vn + ve * ve)),
        nz=-az / G0,
    )
    if "runway_elevation" in record.attrs:
        x_cg, y_cg, z_cg = setup.cg
        columns["h_agl"] = h + (down[0] * x_cg + down[1] * y_cg + down[2] * z_cg) - float(record.attrs["runway_elevation"])
    return columns


def _recorded(record: xr.DataTree, time: np.ndarray, starts: np.ndarray, known: set[str]) -> dict[str, np.ndarray]:
    """Return controls, engine channels and whatever else the record holds in addition to the instruments, on the clock of the path."""
    grids = np.split(time, starts[1:])
    columns = {}
    for leaf, tree in record.children.items():
        node = tree.to_dataset()
        wanted = [str(name) for name in node.data_vars if name not in _RAW and name not in known]
        if not wanted:
            continue
        demand_numbers({leaf: node[wanted].sel(time=slice(time[0], time[-1]))}, "recorded inputs of a path")
        clock = node["time"].values
        for name in wanted:
            columns[name] = np.concatenate([to_grid(clock, node.variables[name].values, grid, name) for grid in grids])
    return columns


def _mass(record: xr.DataTree, time: np.ndarray, aircraft: Any, setup: Setup) -> dict[str, np.ndarray]:
    """Return mass along the path: gauged mass with the recorded fuel flow between, or a straight line through it."""
    place = dict(zip(("x_cg_b", "y_cg_b", "z_cg_b"), setup.cg, strict=True))
    columns = {name: np.full(len(time), value) for name, value in place.items()}
    node = next((node.to_dataset() for node in record.children.values() if "mass" in node.data_vars), None)
    if node is None:
        columns["mass"] = np.full(len(time), float(aircraft.mass))
        return columns
    clock, gauged = node["time"].values, node["mass"].values
    engine = next((n.to_dataset() for n in record.children.values() if any(str(name).endswith("fuel_flow") for name in n.data_vars)), None)
    if engine is not None:
        total = np.sum([engine[name].values for name in engine.data_vars if str(name).endswith("fuel_flow")], axis=0)
        t = engine["time"].values
        burnt = np.concatenate([[0.0], np.cumsum(0.5 * (total[1:] + total[:-1]) * np.diff(t))])
        columns["mass"] = float(np.mean(gauged + np.interp(clock, t, burnt))) - np.interp(time, t, burnt)
    else:
        line = np.polyfit(clock - clock[0], gauged, 1 if len(clock) > 10 else 0)
        columns["mass"] = np.polyval(line, time - clock[0])
    return columns
