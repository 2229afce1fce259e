"""Air loads of a vehicle of several bodies from its motion, and coefficients of its wings.

    Q = M v' + C v + g - tau                            [Grauer2010] eq. (13)

Loads of surfaces that are known from other tests, such as a tail on a wind-tunnel balance, are
subtracted.  The remaining loads give lift and drag coefficients of the wings.  Standard errors
follow from the covariance of the motion.  Errors of the known surfaces are common to all samples
and are stored as sources, as for a flight record.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter
   aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from flightmech.axes import lift_drag
from flightmech.errors import IdentificationError, SchemaError
from flightmech.names import quantity_attributes
from flightmech.quantities import time_text
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.records.signals.fourier import finite_fourier, remove_straight_line
from flighttest.regression.equation_error.fit import Fit
from flighttest.regression.equation_error.fit_file import open_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.multibody.mechanics import (
    Posture,
    actuator_loads,
    energy,
    inertial_loads,
    spring_loads,
    tree_posture,
)
from flighttest.special_tests.multibody.motion_fit import TreeMotion, tree_states
from flighttest.special_tests.multibody.vehicle import LiftingBody, Vehicle

_COMPONENTS = ("X", "Y", "Z", "L", "M", "N")
# Lowest airspeed for coefficients [m/s].
_SLOWEST = 0.1
# Least divisor, against division by zero at rest [m/s, Pa].
_TINY = 1e-9
# Variables of the models of known surfaces.
_FLOW = ("alpha", "beta", "V")
_LOADS = {
    "units": "N, N m",
    "long_name": "air loads on the vehicle, about the origin of the base along its axes, and on "
    "the joints",
}
_ENERGY = {"units": "J", "long_name": "kinetic and potential energy of bodies and springs"}
# Colours of data, model and residual.
_DATA, _MODEL, _RESIDUAL = "black", "#bc6c25", "#2a6f97"

_SurfaceModel = tuple[RegressionModel, np.ndarray, np.ndarray]
"""Model, values (term,) and root of the covariance (term, source) of one coefficient."""


def air_loads(motion: TreeMotion, commands: xr.Dataset | None = None) -> xr.Dataset:
    """Return the air loads of a vehicle, and lift and drag coefficients of its wings.

    Parameters
    ----------
    motion : TreeMotion
        As from `fit_tree_motion`; the air is at rest.
    commands : Dataset (time,), optional
        Commands of the actuators, as from `read_flight`.

    Returns
    -------
    Dataset (time,)
        ``load (time, component)``, the air loads that act on the whole vehicle: X Y Z [N] and L M N
        [N m] about the origin of the base along its axes, and the moments on the independent joints
        [N m], with ``load_stderr``; ``known (time, component)``, the part of the known surfaces.
        ``CL``, ``CD`` of the remaining loads, along stability axes of the base, with ``CL_stderr``,
        ``CD_stderr`` (time,) and ``CL_error (error, time)`` for the fits of the known surfaces.
        States: ``V alpha beta qbar u v w p q r``, ``joint.NAME.angle`` and
        ``joint.NAME.angle_rate`` of all joints; each has its mean standard error as attribute
        ``stderr``.  ``energy`` [J].

    Raises
    ------
    SchemaError
        A command is missing, or a known surface depends on more than ``alpha``, ``beta``, ``V``.
    IdentificationError
        The airspeed is too low.

    Warns
    -----
    AeromatchWarning
        The flow at a known surface leaves the range of its fits.
    """
    vehicle = motion.vehicle
    inputs = _interpolate_commands(vehicle, commands, motion.time)
    surfaces = vehicle.aerodynamics
    models = {name: _surface_models(name, surface) for name, surface in surfaces.items()}
    evaluate = partial(_evaluate_columns, vehicle, inputs, models)
    columns = evaluate(motion.y, motion.y_dot, motion.y_ddot)
    if not columns["V"].min() > _SLOWEST:
        slowest = f"{columns['V'].min():.3g} m/s"
        raise IdentificationError(f"the airspeed falls to {slowest}; coefficients need airspeed")
    errors = motion.stderr(lambda *y: np.stack(list(evaluate(*y).values()), axis=1))
    stderr = dict(zip(columns, errors.T, strict=True))
    p, v, _ = motion.states
    _warn_outside_fits(vehicle, p, v)
    variables = _state_variables(columns, stderr) | _load_variables(vehicle, columns, stderr)
    for name in ("CL", "CD"):
        variables[f"{name}_stderr"] = ("time", stderr[name], {"units": "1"})
    variables["energy"] = ("time", energy(vehicle, p, v), _ENERGY)
    data = xr.Dataset(
        variables,
        {
            "time": ("time", motion.time, {"units": "s"}),
            "component": [*_COMPONENTS, *vehicle.independent],
        },
        {"noise": motion.noise, "cutoff": motion.cutoff},
    )
    return _add_sources(data, vehicle, models, p=p, v=v)


def _state_variables(
    columns: Mapping[str, np.ndarray], stderr: Mapping[str, np.ndarray]
) -> dict[str, tuple]:
    """Return states and coefficients with their mean standard errors."""
    variables: dict[str, tuple] = {}
    for name, x in columns.items():
        if not name.startswith(("load ", "known ")):
            mean = float(np.sqrt(np.mean(stderr[name] ** 2)))
            variables[name] = ("time", x, {**quantity_attributes(name), "stderr": mean})
    return variables


def _load_variables(
    vehicle: Vehicle, columns: Mapping[str, np.ndarray], stderr: Mapping[str, np.ndarray]
) -> dict[str, tuple]:
    """Return loads, their standard errors and the known part, (time, component) each."""
    components = [*_COMPONENTS, *vehicle.independent]
    loads = np.stack([columns[f"load {name}"] for name in components], axis=1)
    errors = np.stack([stderr[f"load {name}"] for name in components], axis=1)
    surface_part = np.stack([columns[f"known {name}"] for name in components], axis=1)
    dims = ("time", "component")
    return {
        "load": (dims, loads, _LOADS),
        "load_stderr": (dims, errors),
        "known": (dims, surface_part, _LOADS),
    }


def _warn_outside_fits(vehicle: Vehicle, p: np.ndarray, v: np.ndarray) -> None:
    """Warn if the flow at a known surface leaves the range of its fits."""
    for surface in vehicle.aerodynamics.values():
        if surface.fits:
            flow = _to_dataset(_surface_flow(vehicle, surface, p, v)[0])
            for coefficient in ("CL", "CD"):
                # `predict` warns; its values are not needed
                open_fit(Path(surface.fits) / f"{coefficient}.nc").predict(flow)


def surface_loads(
    vehicle: Vehicle,
    surface: LiftingBody,
    p: np.ndarray,
    v: np.ndarray,
    C: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Return the loads of a surface with coefficients, (time, component) as in `air_loads`.

    Parameters
    ----------
    vehicle : Vehicle
    surface : LiftingBody
    p, v : array (time, 7 + independent), (time, 6 + independent)
        As in `inertial_loads`.
    C : mapping of str to array (time,)
        ``CL`` and ``CD``; a missing one is zero.
    """
    flow, tree = _surface_flow(vehicle, surface, p, v)
    alpha, qS = flow["alpha"], 0.5 * vehicle.rho * flow["V"] ** 2 * surface.S
    zero = np.zeros_like(alpha)
    CL, CD = C.get("CL", zero), C.get("CD", zero)
    # from stability axes to axes of the body
    ca, sa = np.cos(alpha), np.sin(alpha)
    local = np.stack([CL * sa - CD * ca, zero, -CL * ca - CD * sa], axis=1)
    force = np.einsum("tij,tj->ti", tree.turn[surface.body], qS[:, None] * local)
    point = tree.point(surface.body, surface.point)
    joints = np.einsum("tik,ti->tk", tree.jacobian(surface.body, point), force)
    return np.concatenate([force, np.cross(point, force), joints], axis=1)


def _surface_flow(
    vehicle: Vehicle, surface: LiftingBody, p: np.ndarray, v: np.ndarray
) -> tuple[dict[str, np.ndarray], Posture]:
    """Return angle of attack, sideslip and airspeed at a surface, and the tree."""
    tree = tree_posture(vehicle, p[:, 7:])
    point = tree.point(surface.body, surface.point)
    # velocity of the point: base, rotation of the base, joints
    velocity = (
        v[:, :3]
        + np.cross(v[:, 3:6], point)
        + np.einsum("tik,tk->ti", tree.jacobian(surface.body, point), v[:, 6:])
    )
    alpha, beta, V = _flow_angles(*np.einsum("tji,tj->it", tree.turn[surface.body], velocity))
    return {"alpha": alpha, "beta": beta, "V": V}, tree


def _flow_angles(
    u: np.ndarray, v: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle of attack, sideslip and airspeed."""
    V = np.sqrt(u**2 + v**2 + w**2)
    return np.arctan2(w, u), np.arcsin(v / np.maximum(V, _TINY)), V


def _evaluate_columns(
    vehicle: Vehicle,
    commands: Mapping[str, np.ndarray],
    models: Mapping[str, Mapping[str, _SurfaceModel]],
    *y: np.ndarray,
) -> dict[str, np.ndarray]:
    """Return all columns with a standard error as a function of ``y, y_dot, y_ddot``."""
    p, v, v_dot = tree_states(*y)
    theta, theta_dot, theta_ddot = p[:, 7:], v[:, 6:], v_dot[:, 6:]
    # [Grauer2010] eq. (13): springs and actuators carry a part of the moments on the joints
    total = inertial_loads(vehicle, p, v, v_dot)
    total[:, 6:] -= spring_loads(vehicle, theta, theta_dot) + actuator_loads(
        vehicle, theta, theta_dot, theta_ddot=theta_ddot, commands=dict(commands)
    )
    surface_part = np.zeros_like(total)
    for name, surface in vehicle.aerodynamics.items():
        flow = _to_dataset(_surface_flow(vehicle, surface, p, v)[0])
        C = {}
        for coefficient, (model, values, _) in models[name].items():
            C[coefficient] = model.design(flow) @ values
        surface_part += surface_loads(vehicle, surface, p=p, v=v, C=C)
    alpha, beta, V = _flow_angles(*v[:, :3].T)
    qbar = 0.5 * vehicle.rho * V**2
    columns = {"V": V, "alpha": alpha, "beta": beta, "qbar": qbar}
    columns |= dict(zip("uvwpqr", v[:, :6].T, strict=True))
    joints = tree_posture(vehicle, theta).joints
    rates, _ = joints.rates(theta_dot, theta_ddot)
    for j, name in enumerate(vehicle.joints):
        columns[f"joint.{name}.angle"] = joints.angle[:, j]
        columns[f"joint.{name}.angle_rate"] = rates[:, j]
    qS = np.maximum(qbar, _TINY) * vehicle.reference.S
    remaining = (total - surface_part)[:, :3] / qS[:, None]
    columns["CL"], columns["CD"] = lift_drag(remaining[:, 0], remaining[:, 2], alpha)
    components = (*_COMPONENTS, *vehicle.independent)
    for prefix, loads in (("load", total), ("known", surface_part)):
        for name, column in zip(components, loads.T, strict=True):
            columns[f"{prefix} {name}"] = column
    return columns


def _surface_models(name: str, surface: LiftingBody) -> dict[str, _SurfaceModel]:
    """Return the models of the coefficients of a known surface."""
    models: dict[str, _SurfaceModel] = {}
    for coefficient, terms in (("CL", surface.CL), ("CD", surface.CD)):
        if surface.fits is not None:
            models[coefficient] = _model_of_fit(coefficient, surface.fits)
        elif terms:
            models[coefficient] = _model_of_terms(coefficient, terms)
    for coefficient, (model, _, _) in models.items():
        others = [variable for variable in model.variables if variable not in _FLOW]
        if others:
            problem = (
                f"{coefficient} depends on {', '.join(others)}; alpha, beta and V of its point "
                "are known"
            )
            raise SchemaError(f"aerodynamics.{name}", [problem])
    return models


def _model_of_terms(
    coefficient: str, terms: Mapping[str, float | tuple[float, float]]
) -> _SurfaceModel:
    """Return the model of terms with values, or with [value, standard error]."""
    values, errors = [], []
    for item in terms.values():
        value, error = item if isinstance(item, tuple) else (item, 0.0)
        values.append(float(value))
        errors.append(float(error))
    model = RegressionModel(coefficient, list(terms))
    return model, np.array(values), np.diag(np.array(errors))


def _model_of_fit(coefficient: str, folder: str) -> _SurfaceModel:
    """Return the model of a fit; its sources are random and systematic errors."""
    fit = open_fit(Path(folder) / f"{coefficient}.nc")
    estimates = fit.estimates
    # root of the covariance by its eigenvalues, which rounding may make negative
    values, vectors = np.linalg.eigh(estimates["covariance"].values)
    random = vectors * np.sqrt(np.maximum(values, 0.0))
    root = np.concatenate([random, estimates["systematic"].values], axis=1)
    terms = [str(term) for term in estimates["term"].values]
    model = RegressionModel(coefficient, terms, fit.model.reference)
    return model, estimates["estimate"].values, root


def _add_sources(
    data: xr.Dataset,
    vehicle: Vehicle,
    models: Mapping[str, Mapping[str, _SurfaceModel]],
    *,
    p: np.ndarray,
    v: np.ndarray,
) -> xr.Dataset:
    """Return the data with the changes for one standard error of each known surface."""
    labels, lifts, drags = [], [], []
    alpha, scale = data["alpha"].values, 1.0 / (data["qbar"].values * vehicle.reference.S)
    for name, surface in vehicle.aerodynamics.items():
        flow = _to_dataset(_surface_flow(vehicle, surface, p, v)[0])
        for coefficient, (model, _, root) in models[name].items():
            for k, change in enumerate((model.design(flow) @ root).T, 1):
                if not change.any():
                    continue
                # a larger known load leaves a smaller one for the wings
                loads = surface_loads(vehicle, surface, p=p, v=v, C={coefficient: change})
                force = -scale[:, None] * loads[:, :3]
                lift, drag = lift_drag(force[:, 0], force[:, 2], alpha)
                labels.append(f"{name} {coefficient} {k}")
                lifts.append(lift)
                drags.append(drag)
    if not labels:
        return data
    dims = ("error", "time")
    data = data.assign(CL_error=(dims, np.array(lifts)), CD_error=(dims, np.array(drags)))
    return data.assign_coords(error=labels)


def _to_dataset(flow: Mapping[str, np.ndarray]) -> xr.Dataset:
    return xr.Dataset({name: ("time", values) for name, values in flow.items()})


def _interpolate_commands(
    vehicle: Vehicle, commands: xr.Dataset | None, time: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the commands of the actuators at the times of the motion."""
    required = sorted({drive.command for drive in vehicle.actuator.values() if drive.command})
    if not required:
        return {}
    if commands is None:
        commands = xr.Dataset()
    missing = [name for name in required if name not in commands]
    if missing:
        problem = f"{', '.join(missing)} missing; the actuators need {', '.join(required)}"
        raise SchemaError("commands", [problem])
    # np.interp would hold the end values beyond the record of the commands.
    stamps = commands["time"].values
    if stamps[0] > time[0] or stamps[-1] < time[-1]:
        problem = (
            f"they cover {time_text(stamps[0])} to {time_text(stamps[-1])} s, the motion "
            f"{time_text(time[0])} to {time_text(time[-1])} s"
        )
        raise SchemaError("commands", [problem])
    return {name: np.interp(time, stamps, commands[name].values) for name in required}


def draw_wing_models(fits: Sequence[Fit], data: xr.Dataset, target: str | Path) -> None:
    """Draw data, model and residual of each fit over a record, with their spectra.

    The left panels are over time, the right panels over frequency up to the cut-off.

    Parameters
    ----------
    fits : sequence of Fit
        Fits of CL or CD.
    data : Dataset (time,)
        As from `air_loads`; the band about the data is two standard errors.
    target : path
        As for `draw_actuator`, with its errors.
    """
    demand_drawable(target)
    figure = new_figure(14.0, 3.5 * len(fits))
    axes = figure.subplots(len(fits), 2, squeeze=False, width_ratios=(2, 1))
    time = data["time"].values
    step = float(np.diff(time).mean())
    # frequencies of the record up to the cut-off, without the mean [Hz]
    f = np.arange(1, int(data.attrs["cutoff"] * step * len(time)) + 1) / (step * len(time))
    for fit, (over_time, spectrum) in zip(fits, axes, strict=True):
        _draw_fit(fit, data, over_time=over_time, spectrum=spectrum, f=f)
    axes[0][0].legend(fontsize="small", ncols=4)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    write_figure(figure, target, dpi=120)


def _draw_fit(fit: Fit, data: xr.Dataset, *, over_time: Any, spectrum: Any, f: np.ndarray) -> None:
    """Draw one fit over time and over frequency."""
    name, time = fit.model.coefficient, data["time"].values
    z, s = data[name].values, data[f"{name}_stderr"].values
    estimates = fit.estimates["estimate"].sel(term=list(fit.model.terms)).values
    y = fit.model.design(data) @ estimates
    over_time.fill_between(
        time,
        z - 2.0 * s,
        z + 2.0 * s,
        color="#d9d9d9",
        linewidth=0.0,
        label="2 standard errors",
    )
    over_time.plot(time, z, color=_DATA, linewidth=0.8, label="from the motion")
    over_time.plot(time, y, color=_MODEL, linewidth=1.0, linestyle="--", label="model")
    over_time.plot(time, z - y, color=_RESIDUAL, linewidth=0.6, label="residual")
    over_time.set_ylabel(name)
    title = f"{data.attrs.get('record', '')}: {fit.model}"
    over_time.set_title(title, fontsize="small", loc="left")
    step = float(np.diff(time).mean())
    for values, colour, style in ((z, _DATA, "-"), (y, _MODEL, "--"), (z - y, _RESIDUAL, "-")):
        magnitude = np.abs(finite_fourier(remove_straight_line(values), step, f))
        spectrum.plot(f, magnitude, color=colour, linewidth=0.8, linestyle=style)
    spectrum.set_ylabel(f"|transform of {name}| [s]")
    for axis in (over_time, spectrum):
        axis.grid(linewidth=0.3)
        axis.margins(x=0.01)
