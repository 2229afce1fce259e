"""Landing gear of an aircraft from ground runs and landings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import xarray as xr

from flightmech import Aircraft
from flightmech.errors import IdentificationError, UnknownName
from flightmech.units import G0

from ..maximum_likelihood.result import OutputError
from ..reconstruction.smoother import Path
from .explicit import ROLLING
from .flown import fly_gear, has_angle
from .reconstructed_loads import CUTOFF, ERRORS, SYSTEMATIC, WIND_ERROR, GroundRecord
from .regression import T_NEEDED, LoadFit, regress_gear
from .result import STEERED, GearConstant, IdentifiedGear
from .wheels import wheel_groups

_FORCES = ("stiffness", "stiffness_square", "damping", "damping_outwards", "orifice", "brake")  # that grow with the mass


def identify_landing_gear(
    records: Sequence[Path | GroundRecord | xr.Dataset],
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
        Taxi turns, coast-down, brake stops, differential braking, take-off rolls, landings, all together: reconstructions, or their
        states as `wheel_loads` needs them.  Reconstruct them: the side force of a taxi turn is as accurate as the lateral velocity.
    aircraft : Aircraft
        Places of the wheels, mass, engines; what the records do not determine stays as its gear has it.
    database : DataTree, optional
        Aerodynamics near the ground; without it the air exerts no force.
    errors : mapping of str to float, optional
        Standard errors of what goes in: ``lift``, ``drag``, ``pitching`` (of the coefficients near the ground), ``thrust``, ``mass``
        ``pedal`` (at its stop) (all relative), ``along`` (specific force along the runway, attitude included) [m s-2], ``timing``
        (of compressions against accelerations) [s], ``wind`` (at most, of each record) [m s-1].  Zero holds one.
    cutoff : float
        Low-pass of all states alike. [Hz]
    flown : bool
        Whether side forces and steering, for which slip is a state, are estimated by output error on the gear of the kernel; needs a
        database.  The order of the steering is that of the aircraft; it needs ``delta_nw`` (command) and ``gear.steering`` (angle).

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
    constants = {**found.constants, **{name: one for name, one in by.items() if not isinstance(one, str)}}
    undetermined = {**found.undetermined, **{name: one for name, one in by.items() if isinstance(one, str) and name not in constants}}
    return replace(found, constants=constants, undetermined=undetermined, flown=result)


def _steering(records: Sequence) -> dict[str, str]:
    """Why the steering is not determined, where command and angle are not both recorded."""
    if all(has_angle(record) for record in records):
        return {}
    return {STEERED: "the records have one angle of the nose wheel: it is taken for that of the wheel itself, without a trail"}


def _flown_constants(found: OutputError) -> dict[str, GearConstant | str]:
    """Estimates, or why there is none."""
    e = found.estimates
    constants: dict[str, GearConstant | str] = {}
    for name, value, stderr, active in zip(map(str, e["parameter"].values), *(e[key].values for key in ("estimate", "stderr", "active"))):
        if active:
            constants[name] = f"at its bound {value:g}"
        elif abs(value) < T_NEEDED * stderr:
            constants[name] = f"{value:.3g} +- {stderr:.2g}, {T_NEEDED:g} standard errors from zero are needed"
        else:
            constants[name] = GearConstant(float(value), float(stderr), "output error")
    return constants


def _constants(found: LoadFit, errors: Mapping[str, float]) -> dict[str, GearConstant]:
    """Estimates; their standard errors hold those of what no record shows: mass, pedals, forward specific force, clocks."""
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
