"""The F-16 of the check cases from its DAVE-ML files: aero, inertia and propulsion as one compiled
model.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import flightmech

DATA = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight" / "nesc_checkcases"
MODELS = DATA / "models"
FT, DEG, KT = 0.3048, np.pi / 180.0, 1852.0 / 3600.0
LBF, SLUG = 4.4482216153, 14.593902937  # NASA/TM-2015-218675, Table 73
CG_PERCENT = 25.0  # of the mean chord, in all cases; moments of the aero file are about 35 %
REFERENCE_MAC = 0.35


@cache
def database() -> xr.DataTree:
    """The aerodynamic model as terms, coefficients CX CY CZ along body axes, moments about 35 % of
    the mean chord.
    """
    return aerodb.exchange.import_daveml(MODELS / "F16_aero.dml")


@cache
def aircraft() -> flightmech.Aircraft:
    """Geometry of the aero file, mass properties of the inertia file, static thrust of the
    propulsion file along body x.
    """
    files = MODELS / "F16_inertia.dml", MODELS / "F16_prop.dml"
    return aerodb.exchange.import_daveml_aircraft(
        database(), *files, {"CG_PCT_MAC": CG_PERCENT}, name="F-16", x_ref_mac=REFERENCE_MAC
    )


@cache
def compiled() -> flightmech.SimModel:
    """The model that flies."""
    return flightmech.compile(replace(aircraft(), earth_outputs=True), database())
