"""Identification of a landing gear, and its result.

The constants have standard errors and sources.  The result is available as text, as numbers and in
an aircraft.
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
from flighttest.reconstruction.flight_path import FlightPath
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
    "stiffness": "N/m",
    "stiffness_square": "N/m2",
    "damping": "N s/m",
    "damping_outwards": "N s/m",
    "orifice": "N s2/m2",
    "brake": "N",
    "brake_friction": "1",
    "cornering": "1/rad",
    "bend": "1",
    "mu_dry": "1",
    "rolling": "1",
    "side_stiffness": "N/m",
    "trail": "m",
    "inertia": "kg m2",
    "arm_stiffness": "N m/rad",
    "arm_damping": "N m s/rad",
    "arm_inertia": "kg m2",
}
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
# Load of the largest cornering stiffness over the largest recorded load, if the stiffness has no
# maximum within the records.
_FAR = 10.0
# Points of the table of a strut.
_TABLE = 9


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
        What the records do not determine, and the reason. The aircraft keeps its value.
    loads : LoadFit
        Regression on the wheel loads.
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
        """Return an aircraft with these constants; other constants do not change.

        Its history contains sources and standard errors.  If the records have only one angle of the
        nose wheel, the trail becomes 0.  The tyres were identified with that angle, and
        ``delta_nw`` is that angle in a replay.

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
        steering: dict[str, Any] = self._values_of("steering", _STEERING)
        if STEERED in self.undetermined and known.gear.steering.stiffness > 0.0:
            steering["trail"] = 0.0
        # An estimated friction, or the largest one that was used without a skid.
        friction = known.gear.mu_dry
        if FRICTION in self.constants:
            friction = self.constants[FRICTION].value
        elif FRICTION in self.loads.held:
            friction = self.loads.held[FRICTION]
        gear = replace(
            known.gear,
            contacts=contacts,
            steering=replace(known.gear.steering, **steering),
            mu_dry=friction,
        )
        values = ", ".join(
            f"{name} {constant.value:.4g} ({constant.stderr:.2g}, {constant.source})"
            for name, constant in self.constants.items()
        )
        lines = [
            known.history,
            f"landing gear identified from flight, standard errors and source in brackets: "
            f"{values}",
        ]
        if self.undetermined:
            lines.append(
                f"landing gear, not determined by these records: {', '.join(self.undetermined)}"
            )
        return replace(known, gear=gear, history="\n".join(filter(None, lines)))

    def _values_of(self, prefix: str, names: tuple[str, ...]) -> dict[str, float]:
        """Return the identified constants of a prefix by their names without it."""
        values = {}
        for name in names:
            if f"{prefix}.{name}" in self.constants:
                values[name] = self.constants[f"{prefix}.{name}"].value
        return values

    def _contact(self, contact: Contact) -> Contact:
        """Return a contact with the identified constants of its group."""
        for group in self.groups:
            if contact.name in group.names:
                return replace(contact, **self._contact_values(group))
        return contact

    def _contact_values(self, group: WheelGroup) -> dict[str, Any]:
        """Return the identified values of the contacts of a group."""
        values: dict[str, Any] = self._values_of(
            f"gear.{group.label}", ("stiffness", "damping", "side_stiffness")
        )
        # Fixed constants complete those that belong together.
        constants = dict(self.loads.held)
        for name, constant in self.constants.items():
            constants[name] = constant.value
        if "damping" in values or group.parameter("orifice") in self.constants:
            outwards = constants.get(group.parameter("damping_outwards"), 0.0)
            values["damping_ext"] = max(0.0, values.get("damping", 0.0) + outwards)
            orifice = constants.get(group.parameter("orifice"), 0.0)
            values["orifice"] = values["orifice_ext"] = orifice
        if ROLLING in self.constants:
            values["rolling"] = self.constants[ROLLING].value
        brakes = ("brake", "brake_friction")
        if any(group.parameter(name) in self.constants for name in brakes):
            for name in brakes:
                values[name] = constants.get(group.parameter(name), 0.0)
        if group.parameter("cornering") in self.constants:
            values |= self._cornering(group, constants)
        if group.parameter("stiffness_square") in self.constants:
            # The aircraft file has the square term as a table over the compression.
            square = constants.get(group.parameter("stiffness_square"), 0.0)
            s = np.linspace(0.0, 1.5 * self._largest("compression", group), _TABLE)
            values["strut"] = make_term(square * s**2, {"compression": s}, outside="linear")
        elif "stiffness" in values:
            values["strut"] = None
        return values

    def _cornering(self, group: WheelGroup, constants: Mapping[str, float]) -> dict[str, float]:
        """Return load and stiffness of the aircraft file, N_max and C_max of `explicit`."""
        bend = constants.get(group.parameter("bend"), 0.0)
        # Without a bend N_max lies far beyond the loads of the records.
        load = LOAD / np.sqrt(bend) if bend > 0.0 else _FAR * self._largest("load", group)
        return {
            "cornering_load": float(load),
            "cornering_stiffness": float(0.5 * constants[group.parameter("cornering")] * load),
        }

    def _largest(self, quantity: str, group: WheelGroup) -> float:
        """Return the largest compression or load of a group in all records. [m, N]"""
        wheels = list(group.names)
        largest = []
        for record in self.loads.loads:
            if quantity == "compression":
                values = record["compression"].sel(wheel=wheels)
            else:
                values = record["force"].sel(output=[f"load.{wheel}" for wheel in wheels])
            largest.append(float(np.nanmax(values.values)))
        return max(largest)

    def as_dict(self) -> dict[str, Any]:
        """Return constants, undetermined constants, and the estimated errors of the inputs."""
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
        """Return the estimated errors of the inputs with their standard errors."""
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
        for name, constant in self.constants.items():
            unit = _UNITS.get(name.rpartition(".")[2], "")
            note = f"{unit}, {constant.source}" if unit else constant.source
            lines.append(f"{name:<{wide}}{constant.value:>12.5g}{constant.stderr:>10.2g}  {note}")
        for name, reason in self.undetermined.items():
            lines.append(f"{name:<{wide}}  not determined: {reason}")
        lines += ["", "errors of the inputs, estimated along"]
        for name, (value, stderr) in self._inputs().items():
            lines.append(f"{name:<{wide}}{value:>12.4g}{stderr:>10.2g}")
        lines += ["", f"residual rms: {_rms_text(self.loads.fit)}"]
        if self.flown is not None:
            count = len(self.flown.residuals)
            lines.append(f"flown through {count} stretches, rms: {_rms_text(self.flown)}")
        return "\n".join(lines)


def _rms_text(fit: OutputError) -> str:
    """Return the root mean square of the residuals of all runs, output by output."""
    rms = np.sqrt(np.mean(fit.noise["stderr"].values ** 2, axis=0))
    names = fit.noise["output"].values
    return ", ".join(f"{name} {value:.3g}" for name, value in zip(names, rms))


# Constants that are proportional to the mass.
_FORCES = (
    "stiffness",
    "stiffness_square",
    "damping",
    "damping_outwards",
    "orifice",
    "brake",
)


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
        Taxi turns, coast-down, brake stops, differential braking, take-off rolls and landings
        together: reconstructions, or their states as for `wheel_loads`.  A reconstruction is
        preferable, because the side force of a taxi turn is as accurate as the lateral velocity.
    aircraft : Aircraft
        Positions of the wheels, mass, engines. Constants that the records do not determine keep the
        values of its gear.
    database : DataTree, optional
        Aerodynamics near the ground. Without it the air exerts no force.
    errors : mapping of str to float, optional
        Standard errors of the inputs: ``lift``, ``drag``, ``pitching`` (of the coefficients near
        the ground), ``thrust``, ``mass`` ``pedal`` (at its stop) (all relative), ``along``
        (specific force along the runway, attitude included) [m s-2], ``timing`` (of compressions
        against accelerations) [s], ``wind`` (largest, of each record) [m s-1].  Zero fixes an
        input.
    cutoff : float
        Cut-off frequency of the low-pass filter of all states. [Hz]
    flown : bool
        Whether side forces and steering, for which slip is a state, are estimated by output error
        on the gear of the kernel. A database is required.  The order of the steering is that of the
        aircraft. The steering requires ``delta_nw`` (command) and ``gear.steering`` (angle).

    Returns
    -------
    IdentifiedGear

    Raises
    ------
    IdentificationError
        No record, no wheels, or no wheel that touches the ground.
    UnknownName
        A missing state, or an unknown source of error.

    Notes
    -----
    The loads of the wheels are reconstructed from the motion.  One fit contains all balances of
    force and moment (`explicit`).  Then tyres and steering are fitted by simulation (`flown`).  The
    division is that of [LR743], Table 1.

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.4 and Table 1.
    """
    budget = {**ERRORS, **SYSTEMATIC, "wind": WIND_ERROR}
    for name, stderr in (errors or {}).items():
        if name not in budget:
            raise UnknownName(name, budget, "source of error")
        budget[name] = stderr
    if not records:
        raise IdentificationError("no records; give ground runs or landings")
    fit = regress_gear(records, aircraft, database=database, errors=budget, cutoff=cutoff)
    identified = IdentifiedGear(
        groups=wheel_groups(aircraft),
        constants=_constants(fit, budget),
        undetermined={**fit.undetermined, **_undetermined_steering(records)},
        loads=fit,
    )
    if not flown or database is None:
        return identified
    result = fly_gear(records, identified.aircraft(aircraft), database=database, loads=fit)
    if result is None:
        return identified
    # Estimates of the output error replace those of the regression.
    determined, failures = _flown_constants(result)
    constants = {**identified.constants, **determined}
    undetermined = dict(identified.undetermined)
    for name, reason in failures.items():
        if name not in constants:
            undetermined[name] = reason
    return replace(identified, constants=constants, undetermined=undetermined, flown=result)


def _undetermined_steering(records: Sequence) -> dict[str, str]:
    """Return why the steering is not determined, if command and angle are not both recorded."""
    if all(has_angle(record) for record in records):
        return {}
    return {
        STEERED: "the records have one angle of the nose wheel: it is taken for that of the wheel "
        "itself, without a trail"
    }


def _flown_constants(fit: OutputError) -> tuple[dict[str, GearConstant], dict[str, str]]:
    """Return determined constants, and the reason for each of the others."""
    e = fit.estimates
    constants, reasons = {}, {}
    columns = (e[key].values for key in ("parameter", "estimate", "stderr", "active"))
    for name, value, stderr, active in zip(*columns):
        if active:
            reasons[str(name)] = f"at its bound {value:g}"
        elif abs(value) < T_NEEDED * stderr:
            reasons[str(name)] = (
                f"{value:.3g} +- {stderr:.2g}, {T_NEEDED:g} standard errors from zero are needed"
            )
        else:
            constants[str(name)] = GearConstant(float(value), float(stderr), "output error")
    return constants, reasons


def _constants(fit: LoadFit, errors: Mapping[str, float]) -> dict[str, GearConstant]:
    """Return the constants of the regression with standard errors.

    The standard errors contain those of mass, pedals, forward specific force and clocks, which the
    residuals do not show.
    """
    e = fit.fit.estimates
    constants = {}
    for name in map(str, e["parameter"].values):
        group, _, constant = name.rpartition(".")
        if not group and name != ROLLING:
            continue
        value, stderr = (float(e[key].sel(parameter=name)) for key in ("estimate", "stderr"))
        parts = [stderr]
        # Contributions of inputs without a redundant measurement.
        if constant in _FORCES:
            parts.append(errors["mass"] * value)
        if constant in ("brake", "brake_friction"):
            parts.append(errors["pedal"] * value)
        if constant == ROLLING:
            parts.append(errors["along"] / G0)
        if constant == "damping":
            parts.append(errors["timing"] * fit.fit.parameters[f"{group}.stiffness"])
        constants[name] = GearConstant(value, float(np.linalg.norm(parts)), "wheel loads")
    return constants
