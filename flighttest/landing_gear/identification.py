"""Landing gear of an aircraft from ground runs and landings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from flightmech import Aircraft
from flightmech.errors import IdentificationError, UnknownName

from ..reconstruction.smoother import Path
from .explicit import ROLLING
from .reconstructed_loads import CUTOFF, ERRORS, WIND_ERROR, GroundRecord
from .regression import LoadFit, regress_gear
from .result import GearConstant, IdentifiedGear
from .wheels import wheel_groups

_FORCES = ("stiffness", "stiffness_square", "damping", "damping_outwards", "orifice", "brake")  # that grow with the mass


def identify_landing_gear(
    records: Sequence[Path | GroundRecord | xr.Dataset],
    aircraft: Aircraft,
    database: xr.DataTree | None = None,
    errors: Mapping[str, float] | None = None,
    cutoff: float = CUTOFF,
) -> IdentifiedGear:
    """Identify struts, tyres, brakes and rolling friction of a landing gear.

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
        (relative), ``wind`` (at most, of each record) [m s-1].  Zero holds one.
    cutoff : float
        Low-pass of all states alike. [Hz]

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
    Loads of the wheels are reconstructed from the motion, and all balances of force and moment fitted together (`explicit`).

    References
    ----------
    .. [LR743] Report LR-743, 1993, 4.5.4 and Table 1.
    """
    known = {**ERRORS, "wind": WIND_ERROR}
    for name in errors or {}:
        if name not in known:
            raise UnknownName(name, known, "source of error")
    if not records:
        raise IdentificationError("no records; give ground runs or landings")
    budget = {**known, **(errors or {})}
    fit = regress_gear(records, aircraft, database, budget, cutoff)
    return IdentifiedGear(wheel_groups(aircraft), _constants(fit, budget["mass"]), fit.undetermined, fit)


def _constants(found: LoadFit, mass_error: float) -> dict[str, GearConstant]:
    """Estimates whose standard errors hold that of the mass: every force that was reconstructed grows with it."""
    e = found.fit.estimates
    constants = {}
    for name in map(str, e["parameter"].values):
        constant = name.rpartition(".")[2]
        if "." not in name and name != ROLLING:
            continue
        value, stderr = (float(e[key].sel(parameter=name)) for key in ("estimate", "stderr"))
        systematic = mass_error * value if constant in _FORCES else 0.0
        constants[name] = GearConstant(value, float(np.hypot(stderr, systematic)), "wheel loads")
    return constants
