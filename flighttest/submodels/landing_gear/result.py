"""Result of the identification of a landing gear.

The constants have standard errors and sources.  The result is available as text, as numbers and in
an aircraft.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.landing_gear import Contact
from flightmech.errors import SchemaError, UnknownName
from flightmech.terms import make_term
from flighttest.maximum_likelihood.result import OutputError
from flighttest.remarks import PrintedResult, Remark, remarks_to_json, warn_forbidden
from flighttest.submodels.landing_gear.explicit import FRICTION, LOAD, ROLLING
from flighttest.submodels.landing_gear.regression import (
    LoadFit,
    convergence_remarks,
)
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
class IdentifiedGear(PrintedResult):
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
    notes : tuple of Remark
        On the form of the tyre curve.
    """

    groups: tuple[WheelGroup, ...]
    constants: Mapping[str, GearConstant]
    undetermined: Mapping[str, str]
    loads: LoadFit
    flown: OutputError | None = None
    notes: tuple[Remark, ...] = ()

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

    @property
    def remarks(self) -> list[Remark]:
        """Remarks on fits that did not converge, and on the tyre curve."""
        remarks = [*self.loads.remarks, *self.notes]
        if self.flown is not None:
            remarks += convergence_remarks(self.flown, "output error")
        return remarks

    def aircraft(self, known: Aircraft) -> Aircraft:
        """Return an aircraft with these constants; other constants do not change.

        Its history contains sources and standard errors.  If the records have only one angle of the
        nose wheel, the trail becomes 0.  The tyres were identified with that angle, and
        ``delta_nw`` is that angle in a replay.

        Raises
        ------
        SchemaError
            The aircraft has no gear with these wheels.

        Warns
        -----
        AeromatchWarning
            A fit did not converge.
        """
        warn_forbidden(self.remarks, "landing gear")
        return self._with_constants(known)

    def _with_constants(self, known: Aircraft) -> Aircraft:
        """Return an aircraft with these constants."""
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
        values = []
        for name, constant in self.constants.items():
            values.append(f"{name} {constant.value:.4g} ({constant.stderr:.2g}, {constant.source})")
        lines = [
            known.history,
            f"landing gear identified from flight, standard errors and source in brackets: "
            f"{', '.join(values)}",
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
        constants = {name: constant._asdict() for name, constant in self.constants.items()}
        return {
            "constants": constants,
            "not_determined": dict(self.undetermined),
            "errors_of_inputs": self._inputs(),
            "converged": bool(self.loads.fit.estimates.attrs["converged"]),
            "remarks": remarks_to_json(self.remarks),
        }

    def _inputs(self) -> dict[str, list[float]]:
        """Return the estimated errors of the inputs with their standard errors."""
        e = self.loads.fit.estimates
        names = [str(name) for name in e["parameter"].values if str(name) not in self.constants]
        errors = {}
        for name in names:
            one = e.sel(parameter=name)
            errors[name] = [float(one["estimate"]), float(one["stderr"])]
        return errors

    def report_lines(self) -> list[str]:
        """Return the constants as lines."""
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
        return lines


def _rms_text(fit: OutputError) -> str:
    """Return the root mean square of the residuals of all runs, output by output."""
    rms = np.sqrt(np.mean(fit.noise["stderr"].values ** 2, axis=0))
    names = fit.noise["output"].values
    return ", ".join(f"{name} {value:.3g}" for name, value in zip(names, rms))
