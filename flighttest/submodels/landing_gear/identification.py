"""Identification of a landing gear from ground runs and landings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import xarray as xr

from flightmech.aircraft.aircraft import Aircraft
from flightmech.errors import IdentificationError
from flightmech.units import G0
from flighttest.maximum_likelihood.result import OutputError
from flighttest.reconstruction.dynamics.error_sizes import complete_errors
from flighttest.reconstruction.flight_path import FlightPath
from flighttest.remarks import Remark
from flighttest.submodels.landing_gear.explicit import ROLLING
from flighttest.submodels.landing_gear.output_error import fly_gear, has_angle
from flighttest.submodels.landing_gear.reconstructed_loads import (
    CUTOFF,
    ERRORS,
    SYSTEMATIC,
    WIND_ERROR,
    GroundRecord,
)
from flighttest.submodels.landing_gear.regression import (
    T_NEEDED,
    LoadFit,
    regress_gear,
)
from flighttest.submodels.landing_gear.result import STEERED, GearConstant, IdentifiedGear
from flighttest.submodels.landing_gear.tyre_curve import curve_error
from flighttest.submodels.landing_gear.wheel_positions import wheel_groups

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
    budget = complete_errors({**ERRORS, **SYSTEMATIC, "wind": WIND_ERROR}, errors)
    if not records:
        raise IdentificationError("no records; give ground runs or landings")
    fit = regress_gear(records, aircraft, database=database, errors=budget, cutoff=cutoff)
    found = _with_curve_error(_constants(fit, budget), aircraft, fit)
    identified = IdentifiedGear(
        groups=wheel_groups(aircraft),
        constants=found.constants,
        undetermined={**fit.undetermined, **found.reasons, **_undetermined_steering(records)},
        loads=fit,
        notes=found.notes,
    )
    if not flown or database is None:
        return identified
    start = identified._with_constants(aircraft)
    result = fly_gear(records, start, database=database, loads=fit)
    if result is None:
        return identified
    # Estimates of the output error replace those of the regression.
    determined, failures = _flown_constants(result)
    found = _with_curve_error(determined, aircraft, fit)
    constants = {**identified.constants, **found.constants}
    undetermined = dict(identified.undetermined)
    for name, reason in {**failures, **found.reasons}.items():
        if name not in constants:
            undetermined[name] = reason
    # A stiffness of the output error replaces that of the wheel loads, with its remark.
    notes = [note for note in identified.notes if note.term not in found.constants]
    return replace(
        identified,
        constants=constants,
        undetermined=undetermined,
        flown=result,
        notes=(*notes, *found.notes),
    )


def _undetermined_steering(records: Sequence) -> dict[str, str]:
    """Return why the steering is not determined, if command and angle are not both recorded."""
    if all(has_angle(record) for record in records):
        return {}
    return {
        STEERED: "the records have one angle of the nose wheel: it is taken for that of the wheel "
        "itself, without a trail"
    }


class _CurvedTyres(NamedTuple):
    """Constants with the error of the tyre curve, why others are undetermined, and remarks."""

    constants: dict[str, GearConstant]
    reasons: dict[str, str]
    notes: tuple[Remark, ...]


def _with_curve_error(
    constants: Mapping[str, GearConstant], aircraft: Aircraft, fit: LoadFit
) -> _CurvedTyres:
    """Return constants whose cornering stiffness has the error of the form of the tyre curve."""
    widened = dict(constants)
    reasons: dict[str, str] = {}
    notes: list[Remark] = []
    values = {**fit.held, **fit.fit.parameters}
    values |= {name: constant.value for name, constant in constants.items()}
    for group in wheel_groups(aircraft):
        name = group.parameter("cornering")
        if name in constants:
            value, stderr, _ = constants[name]
            curve = curve_error(values, group, fit.loads)
            if curve is None:
                reasons[name] = "no wheel of the group rolls with a slip angle"
                del widened[name]
                continue
            error = value * curve.relative
            widened[name] = constants[name]._replace(stderr=float(np.hypot(stderr, error)))
            if curve.is_least:
                text = (
                    f"{name}: another tyre curve gives a stiffness that differs by "
                    f"{curve.relative:.0%} or more, the limit of the search: the wheels slide; add "
                    f"turns with slip angles below 6 deg"
                )
                notes.append(Remark("tyre curve", text, name, value=curve.relative))
    return _CurvedTyres(widened, reasons, tuple(notes))


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
