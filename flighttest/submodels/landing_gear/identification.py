"""An identified landing gear: constants with standard errors and source, as text, as numbers, and
in an aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.landing_gear import Contact
from flightmech.errors import IdentificationError, SchemaError, UnknownName
from flightmech.terms import make_term
from flightmech.units import G0
from flighttest.maximum_likelihood.result import OutputError
from flighttest.reconstruction.smoother import FlightPath
from flighttest.regression.separable.fit import regress_separable
from flighttest.regression.separable_model import SeparableModel
from flighttest.submodels.landing_gear.explicit import FRICTION, LOAD, ROLLING
from flighttest.submodels.landing_gear.output_error import fly_gear, has_angle
from flighttest.submodels.landing_gear.reconstructed_loads import (
    CUTOFF,
    ERRORS,
    SYSTEMATIC,
    WIND_ERROR,
    GroundRecord,
)
from flighttest.submodels.landing_gear.regression import T_NEEDED, LoadFit, regress_gear
from flighttest.submodels.landing_gear.wheel_positions import WheelGroup, wheel_groups

_UNITS = {
    "stiffness": "N/m", "stiffness_square": "N/m2", "damping": "N s/m", "damping_outwards": "N s/m", "orifice": "N s2/m2",
    "brake": "N", "brake_friction": "1", "cornering": "1/rad", "bend": "1", "mu_dry": "1", "rolling": "1", "side_stiffness": "N/m",
    "trail": "m", "inertia": "kg m2", "arm_stiffness": "N m/rad", "arm_damping": "N m s/rad", "arm_inertia": "kg m2",
}  # fmt: skip
_STEERING = (
    "stiffness",
    "trail",
    "inertia",
    "damping",
    "arm_stiffness",
    "arm_damping",
    "arm_inertia",
)
STEERED = "steering.trail"
_FAR = 10.0  # load of the greatest cornering stiffness over the largest seen, where none was seen
_TABLE = 9  # points of the table of a strut


class GearConstant(NamedTuple):
    """A constant with its standard error.

    Attributes
    ----------
    value, stderr : float
        [SI]
    source : str
        ``wheel loads`` or ``output error``.
    """

    value: float
    stderr: float
    source: str


@dataclass(frozen=True)
class IdentifiedGear:
    """Struts, tyres, brakes and steering as the records determine them.

    Attributes
    ----------
    groups : tuple of WheelGroup
    constants : dict of str to GearConstant
        By name: ``gear.left,right.stiffness``, ``rolling``, ``runway.mu_dry``,
        ``steering.stiffness`` ...
    undetermined : dict of str to str
        What the records cannot determine, and why; the aircraft keeps its value.
    loads : LoadFit
    flown : OutputError or None
        Output error on the gear of the kernel.
    """

    groups: tuple[WheelGroup, ...]
    constants: Mapping[str, GearConstant]
    undetermined: Mapping[str, str]
    loads: LoadFit
    flown: OutputError | None = None

    def value(self, name: str) -> tuple[float, float]:
        """Return a constant and its standard error.

        Raises
        ------
        UnknownName
            No such constant, or not determined.
        """
        if name not in self.constants:
            raise UnknownName(name, self.constants, "constant", self.undetermined.get(name, ""))
        return self.constants[name].value, self.constants[name].stderr

    def aircraft(self, known: Aircraft) -> Aircraft:
        """Return an aircraft with these constants; what is not determined stays as it is.  Its
        history has sources and standard errors.

        Where the records have one angle of the nose wheel, the trail becomes 0: the tyres were
        identified with that angle, and ``delta_nw`` is that angle in a replay.

        Raises
        ------
        SchemaError
            The aircraft has no gear with these wheels.
        """
        if known.gear is None or tuple(wheel_groups(known)) != self.groups:
            raise SchemaError(
                known.name,
                [
                    f"its wheels are not {'; '.join(group.label for group in self.groups)}; "
                    f"take the aircraft identified with"
                ],
            )
        contacts = tuple(self._contact(contact) for contact in known.gear.contacts)
        steering: dict[str, Any] = self._of("steering", _STEERING)
        if STEERED in self.undetermined and known.gear.steering.stiffness > 0.0:
            steering["trail"] = 0.0
        friction = (
            {"mu_dry": self.constants[FRICTION].value}
            if FRICTION in self.constants
            else self._used()
        )
        gear = replace(
            known.gear,
            contacts=contacts,
            steering=replace(known.gear.steering, **steering),
            **friction,
        )
        values = ", ".join(
            f"{name} {one.value:.4g} ({one.stderr:.2g}, {one.source})"
            for name, one in self.constants.items()
        )
        lines = [
            known.history,
            f"landing gear identified from flight, standard errors and source in brackets: {values}",
        ]
        if self.undetermined:
            lines.append(
                f"landing gear, not determined by these records: {', '.join(self.undetermined)}"
            )
        return replace(known, gear=gear, history="\n".join(filter(None, lines)))

    def _used(self) -> dict[str, Any]:
        """The friction that was used without a skid, where that is more than the aircraft file has."""
        return {"mu_dry": self.loads.held[FRICTION]} if FRICTION in self.loads.held else {}

    def _of(self, prefix: str, names: tuple[str, ...]) -> dict[str, float]:
        return {
            name: self.constants[f"{prefix}.{name}"].value
            for name in names
            if f"{prefix}.{name}" in self.constants
        }

    def _contact(self, contact: Contact) -> Contact:
        group = next((group for group in self.groups if contact.name in group.names), None)
        if group is None:
            return contact
        found: dict[str, Any] = self._of(
            f"gear.{group.label}", ("stiffness", "damping", "side_stiffness")
        )
        at = dict(self.loads.held) | {name: one.value for name, one in self.constants.items()}
        if "damping" in found or group.parameter("orifice") in self.constants:
            found["damping_ext"] = max(
                0.0, found.get("damping", 0.0) + at.get(group.parameter("damping_outwards"), 0.0)
            )
            found["orifice"] = found["orifice_ext"] = at.get(group.parameter("orifice"), 0.0)
        if ROLLING in self.constants:
            found["rolling"] = self.constants[ROLLING].value
        brakes = [
            name for name in ("brake", "brake_friction") if group.parameter(name) in self.constants
        ]
        if brakes:
            found |= {
                name: at.get(group.parameter(name), 0.0) for name in ("brake", "brake_friction")
            }
        if group.parameter("cornering") in self.constants:
            found |= self._cornering(group, at)
        square = at.get(group.parameter("stiffness_square"), 0.0)
        if group.parameter("stiffness_square") in self.constants:
            s = np.linspace(0.0, 1.5 * self._greatest("compression", group), _TABLE)
            found["strut"] = make_term(square * s**2, {"compression": s}, outside="linear")
        elif "stiffness" in found:
            found["strut"] = None
        return replace(contact, **found)

    def _cornering(self, group: WheelGroup, at: Mapping[str, float]) -> dict[str, float]:
        bend = at.get(group.parameter("bend"), 0.0)
        most = LOAD / np.sqrt(bend) if bend > 0.0 else _FAR * self._greatest("load", group)
        return {
            "cornering_load": float(most),
            "cornering_stiffness": float(0.5 * at[group.parameter("cornering")] * most),
        }

    def _greatest(self, what: str, group: WheelGroup) -> float:
        """Largest compression or load of a group in all records. [m, N]"""
        wheels = list(group.names)
        found = []
        for one in self.loads.loads:
            values = (
                one["compression"].sel(wheel=wheels)
                if what == "compression"
                else one["force"].sel(output=[f"load.{w}" for w in wheels])
            )
            found.append(float(np.nanmax(values.values)))
        return max(found)

    def as_dict(self) -> dict[str, Any]:
        """Return constants, what is not determined, and the errors of the inputs that were
        estimated along.
        """
        constants = {
            name: {"value": one.value, "stderr": one.stderr, "source": one.source}
            for name, one in self.constants.items()
        }
        return {
            "constants": constants,
            "not_determined": dict(self.undetermined),
            "errors_of_inputs": self._inputs(),
        }

    def _inputs(self) -> dict[str, list[float]]:
        e = self.loads.fit.estimates
        names = [str(name) for name in e["parameter"].values if str(name) not in self.constants]
        return {
            name: [float(e[key].sel(parameter=name)) for key in ("estimate", "stderr")]
            for name in names
        }

    def report(self) -> str:
        """Return the constants as a text table."""
        wide = max(len(name) for name in (*self.constants, *self.undetermined)) + 2
        lines = [
            f"landing gear from {len(self.loads.loads)} records",
            f"{'':<{wide}}{'estimate':>12}{'stderr':>10}",
        ]
        for name, one in self.constants.items():
            unit = _UNITS.get(name.rpartition(".")[2], "")
            lines.append(
                f"{name:<{wide}}{one.value:>12.5g}{one.stderr:>10.2g}  "
                f"{f'{unit}, {one.source}' if unit else one.source}"
            )
        lines += [
            f"{name:<{wide}}  not determined: {why}" for name, why in self.undetermined.items()
        ]
        lines += ["", "errors of the inputs, estimated along"]
        lines += [
            f"{name:<{wide}}{value:>12.4g}{stderr:>10.2g}"
            for name, (value, stderr) in self._inputs().items()
        ]
        noise = self.loads.fit.noise["stderr"].values
        outputs = [str(name) for name in self.loads.fit.noise["output"].values]
        rms = np.sqrt(np.mean(noise**2, axis=0))
        lines += [
            "",
            "residual rms: "
            + ", ".join(f"{name} {value:.3g}" for name, value in zip(outputs, rms)),
        ]
        if self.flown is not None:
            scatter = np.sqrt(np.mean(self.flown.noise["stderr"].values ** 2, axis=0))
            names = [str(name) for name in self.flown.noise["output"].values]
            left = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, scatter))
            lines.append(f"flown through {len(self.flown.residuals)} stretches, rms: {left}")
        return "\n".join(lines)


_STIFFEST = (0.5, 60.0)  # cornering stiffness over friction [rad-1]
_SOURCE = "measured loads"


def fit_strut(drops: Sequence[xr.Dataset], touching: float = 2e-3) -> dict[str, GearConstant]:
    """Fit F = K1 s + K2 s^2 + C s' |s'| to touch-downs.

    Parameters
    ----------
    drops : sequence of Dataset (time,)
        ``compression`` [m], ``rate`` [m s-1], ``load`` [N].
    touching : float
        Compression below which the wheel may be off the ground. [m]

    Returns
    -------
    dict of str to GearConstant
        ``stiffness`` [N m-1], ``stiffness_square`` [N m-2], ``orifice`` [N s2 m-2].

    Raises
    ------
    IdentificationError
        Too few samples, or terms that they do not distinguish.
    UnknownName
        A variable that the data do not hold.
    """
    model = SeparableModel.parse(
        "load = s + s^2 + rate*abs(rate)", units={"load": "N", "s": "m", "rate": "m s-1"}
    )
    data = [
        drop.rename(compression="s").isel(
            time=np.flatnonzero(drop["compression"].values > touching)
        )
        for drop in drops
    ]
    fit = regress_separable(model, data, "strut")
    terms = {"stiffness": "s", "stiffness_square": "s^2", "orifice": "rate*abs(rate)"}
    return {name: GearConstant(*fit.value(term), _SOURCE) for name, term in terms.items()}


def fit_side_force(points: xr.Dataset) -> dict[str, GearConstant]:
    """Fit Fy = -mu Fz tanh(g slip / mu) to side forces of a rolling wheel.

    Parameters
    ----------
    points : Dataset (time,) or (point,)
        ``load`` [N], ``slip`` [rad], ``side_force`` (to the right for a wheel that moves to its
        left) [N].

    Returns
    -------
    dict of str to GearConstant
        ``mu`` [1], ``cornering``: cornering stiffness over load [rad-1].

    Raises
    ------
    IdentificationError, UnknownName
        As `fit_strut`.
    """
    units = {"side_force": "N", "load": "N", "slip": "rad"}
    model = SeparableModel.parse("side_force = load*tanh(g*slip)", {"g": _STIFFEST}, units)
    (dim,) = points["load"].dims
    time = {
        "time": points["time"].values
        if dim == "time"
        else np.arange(points.sizes[dim], dtype=float)
    }
    data = xr.Dataset(
        {name: ("time", points[name].values) for name in units if name in points}, time
    )
    fit = regress_separable(model, data, "side force")
    values, C = fit.derived("-[load*tanh(g*slip)]", "-[load*tanh(g*slip)]*g")
    return {
        name: GearConstant(float(x), float(v**0.5), _SOURCE)
        for name, x, v in zip(("mu", "cornering"), values, C.diagonal())
    }


_FORCES = (
    "stiffness",
    "stiffness_square",
    "damping",
    "damping_outwards",
    "orifice",
    "brake",
)  # that grow with the mass


def identify_landing_gear(
    records: Sequence[FlightPath | GroundRecord | xr.Dataset],
    aircraft: Aircraft,
    database: xr.DataTree | None = None,
    errors: Mapping[str, float] | None = None,
    cutoff: float = CUTOFF,
    flown: bool = True,
) -> IdentifiedGear:
    """Identify struts, tyres, brakes, rolling friction and nose-wheel steering of a landing gear.

    Parameters
    ----------
    records : sequence of Path or Dataset (time,)
        Taxi turns, coast-down, brake stops, differential braking, take-off rolls, landings, all
        together: reconstructions, or their states as `wheel_loads` needs them.  Reconstruct them:
        the side force of a taxi turn is as accurate as the lateral velocity.
    aircraft : Aircraft
        Places of the wheels, mass, engines; what the records do not determine stays as its gear has
        it.
    database : DataTree, optional
        Aerodynamics near the ground; without it the air exerts no force.
    errors : mapping of str to float, optional
        Standard errors of what goes in: ``lift``, ``drag``, ``pitching`` (of the coefficients near
        the ground), ``thrust``, ``mass`` ``pedal`` (at its stop) (all relative), ``along``
        (specific force along the runway, attitude included) [m s-2], ``timing`` (of compressions
        against accelerations) [s], ``wind`` (at most, of each record) [m s-1].  Zero holds one.
    cutoff : float
        Low-pass of all states alike. [Hz]
    flown : bool
        Whether side forces and steering, for which slip is a state, are estimated by output error
        on the gear of the kernel; needs a database.  The order of the steering is that of the
        aircraft; it needs ``delta_nw`` (command) and ``gear.steering`` (angle).

    Returns
    -------
    IdentifiedGear

    Raises
    ------
    IdentificationError
        No record, no wheels, or none that touches the ground.
    UnknownName
        A state that is missing, or another source of error.

    Notes
    -----
    Loads of the wheels are reconstructed from the motion, and all balances of force and moment fitted together (`explicit`); then
    the tyres and the steering are flown (`flown`): the division of [LR743], Table 1.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.4 and Table 1.
    """
    known = {**ERRORS, **SYSTEMATIC, "wind": WIND_ERROR}
    for name in errors or {}:
        if name not in known:
            raise UnknownName(name, known, "source of error")
    if not records:
        raise IdentificationError("no records; give ground runs or landings")
    budget = {**known, **(errors or {})}
    fit = regress_gear(records, aircraft, database, budget, cutoff)
    undetermined = {**fit.undetermined, **_steering(records)}
    found = IdentifiedGear(wheel_groups(aircraft), _constants(fit, budget), undetermined, fit)
    if not flown or database is None:
        return found
    result = fly_gear(records, found.aircraft(aircraft), database, fit)
    if result is None:
        return found
    by = _flown_constants(result)
    constants = {
        **found.constants,
        **{name: one for name, one in by.items() if not isinstance(one, str)},
    }
    undetermined = {
        **found.undetermined,
        **{name: one for name, one in by.items() if isinstance(one, str) and name not in constants},
    }
    return replace(found, constants=constants, undetermined=undetermined, flown=result)


def _steering(records: Sequence) -> dict[str, str]:
    """Why the steering is not determined, where command and angle are not both recorded."""
    if all(has_angle(record) for record in records):
        return {}
    return {
        STEERED: "the records have one angle of the nose wheel: it is taken for that of the wheel "
        "itself, without a trail"
    }


def _flown_constants(found: OutputError) -> dict[str, GearConstant | str]:
    """Estimates, or why there is none."""
    e = found.estimates
    constants: dict[str, GearConstant | str] = {}
    for name, value, stderr, active in zip(
        map(str, e["parameter"].values),
        *(e[key].values for key in ("estimate", "stderr", "active")),
    ):
        if active:
            constants[name] = f"at its bound {value:g}"
        elif abs(value) < T_NEEDED * stderr:
            constants[name] = (
                f"{value:.3g} +- {stderr:.2g}, {T_NEEDED:g} standard errors from zero are needed"
            )
        else:
            constants[name] = GearConstant(float(value), float(stderr), "output error")
    return constants


def _constants(found: LoadFit, errors: Mapping[str, float]) -> dict[str, GearConstant]:
    """Estimates; their standard errors hold those of what no record shows: mass, pedals, forward
    specific force, clocks.
    """
    e = found.fit.estimates
    constants = {}
    for name in map(str, e["parameter"].values):
        group, _, constant = name.rpartition(".")
        if not group and name != ROLLING:
            continue
        value, stderr = (float(e[key].sel(parameter=name)) for key in ("estimate", "stderr"))
        parts = [stderr]
        if constant in _FORCES:
            parts.append(errors["mass"] * value)
        if constant in ("brake", "brake_friction"):
            parts.append(errors["pedal"] * value)
        if constant == ROLLING:
            parts.append(errors["along"] / G0)
        if constant == "damping":
            parts.append(errors["timing"] * found.fit.parameters[f"{group}.stiffness"])
        constants[name] = GearConstant(value, float(np.linalg.norm(parts)), "wheel loads")
    return constants
