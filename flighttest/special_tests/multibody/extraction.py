"""Air loads of a vehicle of several bodies from its motion, and the remainder for the wings as lift
and drag coefficients.

Q = M v' + C v + g - tau                                  [Grauer2010] eq. (13)

less the loads of surfaces that are known from elsewhere, such as a tail from a wind-tunnel balance.
Standard errors come from the covariance of the motion; those of the known surfaces are common to
all samples and kept as sources, as for a flight record.

References
----------
.. [Grauer2010] Grauer, Ulrich, Hubbard, Pines, Humbert, System identification of an ornithopter aerodynamics model, AIAA 2010-7632.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr

from flightmech.axes import lift_drag
from flightmech.errors import IdentificationError, SchemaError
from flightmech.names import quantity_attributes
from flightmech.support.figures import demand_drawable, new_figure, write_figure
from flighttest.records.signals.fourier import finite_fourier, remove_straight_line
from flighttest.regression.equation_error.fit import Fit, open_fit
from flighttest.regression.equation_error.model import RegressionModel
from flighttest.special_tests.multibody.mechanics import (
    actuator_loads,
    energy,
    inertial_loads,
    spring_loads,
    tree_posture,
)
from flighttest.special_tests.multibody.motion_fit import TreeMotion, tree_states
from flighttest.special_tests.multibody.vehicle import LiftingBody, Vehicle

_COMPONENTS = ("X", "Y", "Z", "L", "M", "N")
_SLOWEST = 0.1  # airspeed that coefficients need [m/s]


def air_loads(motion: TreeMotion, commands: xr.Dataset | None = None) -> xr.Dataset:
    """Return the air loads of a vehicle, and lift and drag coefficients of what no known surface
    explains.

    Parameters
    ----------
    motion : TreeMotion
        As from `fit_tree_motion`; the air is at rest.
    commands : Dataset (time,), optional
        Of the actuators, as from `read_flight`.

    Returns
    -------
    Dataset (time,)
        ``load (time, component)``, the air loads that act on the whole vehicle: X Y Z [N] and L M N
        [N m] about the origin of the base along its axes, and the moments on the independent joints
        [N m], with ``load_stderr``; ``known (time, component)``, the part of the known surfaces.
        ``CL``, ``CD`` of the rest, along stability axes of the base, with ``CL_stderr``,
        ``CD_stderr`` (time,) and ``CL_error (error, time)`` for the fits of the known surfaces.
        States: ``V alpha beta qbar u v w p q r``, ``joint.NAME.angle`` and
        ``joint.NAME.angle_rate`` of all joints; each has its mean standard error as attribute
        ``stderr``.  ``energy`` [J].

    Raises
    ------
    SchemaError
        A command that an actuator needs is missing, a fit that is none of CL or CD by ``alpha`` and
        ``beta``.
    IdentificationError
        The vehicle stands still.

    Warns
    -----
    AeromatchWarning
        The flow at a known surface leaves the range of its fits.
    """
    vehicle = motion.vehicle
    given = _commands(vehicle, xr.Dataset() if commands is None else commands, motion.time)
    models = {name: _models(name, surface) for name, surface in vehicle.aerodynamics.items()}
    evaluate = partial(_columns, vehicle, given, models)
    columns = evaluate(motion.y, motion.y_dot, motion.y_ddot)
    if not columns["V"].min() > _SLOWEST:
        raise IdentificationError(
            f"the airspeed falls to {columns['V'].min():.3g} m/s; coefficients need motion "
            f"through the air"
        )
    labels = list(columns)
    stderr = motion.stderr(lambda *y: np.stack(list(evaluate(*y).values()), axis=1))
    found: dict[str, tuple] = {}
    for name, s in zip(labels, stderr.T):
        if not name.startswith(("load ", "known ")):
            found[name] = (
                "time",
                columns[name],
                {**quantity_attributes(name), "stderr": float(np.sqrt(np.mean(s**2)))},
            )
    components = [*_COMPONENTS, *vehicle.independent]
    note = {
        "units": "N, N m",
        "long_name": "air loads on the vehicle, about the origin of the base along its axes, and "
        "on the joints",
    }
    found["load"] = (
        ("time", "component"),
        np.stack([columns[f"load {name}"] for name in components], axis=1),
        note,
    )
    found["load_stderr"] = (
        ("time", "component"),
        np.stack([stderr[:, labels.index(f"load {name}")] for name in components], axis=1),
    )
    found["known"] = (
        ("time", "component"),
        np.stack([columns[f"known {name}"] for name in components], axis=1),
        note,
    )
    for name in ("CL", "CD"):
        found[f"{name}_stderr"] = ("time", stderr[:, labels.index(name)], {"units": "1"})
    p, v, _ = motion.states
    for surface in vehicle.aerodynamics.values():
        if surface.fits:
            flow = _as_data(_flow(vehicle, surface, p, v)[0])
            for c in ("CL", "CD"):
                open_fit(Path(surface.fits) / f"{c}.nc").predict(
                    flow
                )  # warns where the flow leaves what was fitted
    found["energy"] = (
        "time",
        energy(vehicle, p, v),
        {"units": "J", "long_name": "kinetic and potential energy of bodies and springs"},
    )
    data = xr.Dataset(
        found,
        {"time": ("time", motion.time, {"units": "s"}), "component": components},
        {"noise": motion.noise, "cutoff": motion.cutoff},
    )
    return _with_sources(data, vehicle, models, p, v)


def surface_loads(
    vehicle: Vehicle,
    surface: LiftingBody,
    p: np.ndarray,
    v: np.ndarray,
    C: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Return the loads of a surface with the coefficients ``CL`` and ``CD`` (time,), as `air_loads`
    orders them (time, component).
    """
    flow, tree = _flow(vehicle, surface, p, v)
    alpha, qS = flow["alpha"], 0.5 * vehicle.rho * flow["V"] ** 2 * surface.S
    CL, CD = (C.get(name, np.zeros_like(alpha)) for name in ("CL", "CD"))
    ca, sa = np.cos(alpha), np.sin(alpha)
    own = qS[:, None] * np.stack(
        [CL * sa - CD * ca, np.zeros_like(alpha), -CL * ca - CD * sa], axis=1
    )
    force = np.einsum("tij,tj->ti", tree.turn[surface.body], own)
    point = tree.point(surface.body, surface.point)
    joints = np.einsum("tik,ti->tk", tree.jacobian(surface.body, point), force)
    return np.concatenate([force, np.cross(point, force), joints], axis=1)


def _flow(vehicle: Vehicle, surface: LiftingBody, p: np.ndarray, v: np.ndarray):
    """Angle of attack, sideslip and airspeed at a surface, and the tree."""
    tree = tree_posture(vehicle, p[:, 7:])
    point = tree.point(surface.body, surface.point)
    velocity = (
        v[:, :3]
        + np.cross(v[:, 3:6], point)
        + np.einsum("tik,tk->ti", tree.jacobian(surface.body, point), v[:, 6:])
    )
    u, side, w = np.einsum("tji,tj->it", tree.turn[surface.body], velocity)
    V = np.sqrt(u**2 + side**2 + w**2)
    return {"alpha": np.arctan2(w, u), "beta": np.arcsin(side / np.maximum(V, 1e-9)), "V": V}, tree


def _columns(
    vehicle: Vehicle, commands: Mapping[str, np.ndarray], models: Mapping, *y: np.ndarray
) -> dict[str, np.ndarray]:
    """All columns that have a standard error."""
    p, v, v_dot = tree_states(*y)
    theta, theta_dot, theta_ddot = p[:, 7:], v[:, 6:], v_dot[:, 6:]
    total = inertial_loads(vehicle, p, v, v_dot)
    total[:, 6:] -= spring_loads(vehicle, theta, theta_dot) + actuator_loads(
        vehicle, theta, theta_dot, theta_ddot, dict(commands)
    )
    known = np.zeros_like(total)
    for name, surface in vehicle.aerodynamics.items():
        flow, _ = _flow(vehicle, surface, p, v)
        C = {
            c: model.design(_as_data(flow)) @ values
            for c, (model, values, _) in models[name].items()
        }
        known += surface_loads(vehicle, surface, p, v, C)
    u, side, w = v[:, :3].T
    V = np.sqrt(u**2 + side**2 + w**2)
    alpha, qbar = np.arctan2(w, u), 0.5 * vehicle.rho * V**2
    found = {"V": V, "alpha": alpha, "beta": np.arcsin(side / np.maximum(V, 1e-9)), "qbar": qbar}
    found |= dict(zip("uvwpqr", v[:, :6].T))
    joints = tree_posture(vehicle, theta).joints
    rates, _ = joints.rates(theta_dot, theta_ddot)
    for j, name in enumerate(vehicle.joints):
        found |= {
            f"joint.{name}.angle": joints.angle[:, j],
            f"joint.{name}.angle_rate": rates[:, j],
        }
    rest = (total - known)[:, :3] / (np.maximum(qbar, 1e-9) * vehicle.reference.S)[:, None]
    found["CL"], found["CD"] = lift_drag(rest[:, 0], rest[:, 2], alpha)
    for prefix, values in (("load", total), ("known", known)):
        found |= {
            f"{prefix} {name}": column
            for name, column in zip((*_COMPONENTS, *vehicle.independent), values.T)
        }
    return found


def _models(
    name: str, surface: LiftingBody
) -> dict[str, tuple[RegressionModel, np.ndarray, np.ndarray]]:
    """Model, values and root of the covariance (term, source) of the coefficients of a surface."""
    found: dict[str, tuple[RegressionModel, np.ndarray, np.ndarray]] = {}
    if surface.fits is None:
        for c, terms in (("CL", surface.CL), ("CD", surface.CD)):
            if terms:
                pairs = [
                    (float(x[0]), float(x[1])) if isinstance(x, tuple) else (float(x), 0.0)
                    for x in terms.values()
                ]
                values, errors = np.array(pairs).T
                found[c] = RegressionModel(c, list(terms)), values, np.diag(errors)
    else:
        for c in ("CL", "CD"):
            fit = open_fit(Path(surface.fits) / f"{c}.nc")
            values, vectors = np.linalg.eigh(fit.estimates["covariance"].values)
            root = np.concatenate(
                [vectors * np.sqrt(np.maximum(values, 0.0)), fit.estimates["systematic"].values],
                axis=1,
            )
            found[c] = (
                RegressionModel(
                    c, [str(term) for term in fit.estimates["term"].values], fit.model.reference
                ),
                fit.estimates["estimate"].values,
                root,
            )
    for c, (model, _, _) in found.items():
        if other := [
            variable for variable in model.variables if variable not in ("alpha", "beta", "V")
        ]:
            raise SchemaError(
                f"aerodynamics.{name}",
                [f"{c} depends on {', '.join(other)}; alpha, beta and V of its point are known"],
            )
    return found


def _with_sources(
    data: xr.Dataset, vehicle: Vehicle, models: Mapping, p: np.ndarray, v: np.ndarray
) -> xr.Dataset:
    """The data with what one standard error of the fits of the known surfaces changes."""
    labels, changes = [], []
    alpha, scale = data["alpha"].values, 1.0 / (data["qbar"].values * vehicle.reference.S)
    for name, surface in vehicle.aerodynamics.items():
        design = _as_data(_flow(vehicle, surface, p, v)[0])
        for c, (model, _, root) in models[name].items():
            for k, column in enumerate((model.design(design) @ root).T, 1):
                if column.any():
                    force = (
                        -scale[:, None] * surface_loads(vehicle, surface, p, v, {c: column})[:, :3]
                    )
                    labels.append(f"{name} {c} {k}")
                    changes.append(lift_drag(force[:, 0], force[:, 2], alpha))
    if not labels:
        return data
    columns = {
        f"{c}_error": (("error", "time"), np.array([change[k] for change in changes]))
        for k, c in enumerate(("CL", "CD"))
    }
    return data.assign(columns).assign_coords(error=labels)


def _as_data(flow: Mapping[str, np.ndarray]) -> xr.Dataset:
    return xr.Dataset({name: ("time", values) for name, values in flow.items()})


def _commands(vehicle: Vehicle, commands: xr.Dataset, time: np.ndarray) -> dict[str, np.ndarray]:
    """Commands of the actuators at the times of the motion."""
    wanted = sorted({drive.command for drive in vehicle.actuator.values() if drive.command})
    if missing := [name for name in wanted if name not in commands]:
        raise SchemaError(
            "commands", [f"{', '.join(missing)} missing; the actuators need {', '.join(wanted)}"]
        )
    stamps = commands["time"].values if wanted else time
    if stamps[0] > time[0] or stamps[-1] < time[-1]:
        raise SchemaError(
            "commands",
            [
                f"they cover {stamps[0]:g} to {stamps[-1]:g} s, the motion {time[0]:g} to "
                f"{time[-1]:g} s"
            ],
        )
    return {name: np.interp(time, stamps, commands[name].values) for name in wanted}


_DATA, _MODEL, _REST = "black", "#bc6c25", "#2a6f97"


def draw_wing_models(fits: Sequence[Fit], data: xr.Dataset, target: str | Path) -> None:
    """Draw data, model and residual of each fit over a record: over time on the left, their spectra
    up to the cut-off on the right.

    Parameters
    ----------
    fits : sequence of Fit
        Of CL or CD.
    data : Dataset (time,)
        As from `air_loads`; its standard error is drawn as a band about the data.
    target : path
        As for `draw_actuator`, with its errors.
    """
    demand_drawable(target)
    figure = new_figure(14.0, 3.5 * len(fits))
    axes = figure.subplots(len(fits), 2, squeeze=False, width_ratios=(2, 1))
    time = data["time"].values
    step = float(np.diff(time).mean())
    f = np.arange(1, int(data.attrs["cutoff"] * step * len(time)) + 1) / (step * len(time))
    for fit, (over_time, spectrum) in zip(fits, axes):
        name = fit.model.coefficient
        z, s = data[name].values, data[f"{name}_stderr"].values
        values = fit.estimates["estimate"].sel(term=list(fit.model.terms)).values
        y = fit.model.design(data) @ values
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
        over_time.plot(time, z - y, color=_REST, linewidth=0.6, label="residual")
        over_time.set_ylabel(name)
        over_time.set_title(
            f"{data.attrs.get('record', '')}: {fit.model}", fontsize="small", loc="left"
        )
        for values, colour, style in ((z, _DATA, "-"), (y, _MODEL, "--"), (z - y, _REST, "-")):
            spectrum.plot(
                f,
                np.abs(finite_fourier(remove_straight_line(values), step, f)),
                color=colour,
                linewidth=0.8,
                linestyle=style,
            )
        spectrum.set_ylabel(f"|transform of {name}| [s]")
        for axis in (over_time, spectrum):
            axis.grid(linewidth=0.3)
            axis.margins(x=0.01)
    axes[0][0].legend(fontsize="small", ncols=4)
    axes[-1][0].set_xlabel("time [s]")
    axes[-1][1].set_xlabel("frequency [Hz]")
    write_figure(figure, target, dpi=120)
