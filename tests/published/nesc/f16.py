"""The F-16 of the check cases from its DAVE-ML files: aero, inertia and propulsion as one compiled model."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import flightmech
from aerodb.exchange import daveml
from flightmech.terms import make

DATA = Path(__file__).parents[3] / ".." / "shared" / "data" / "flight" / "nesc_checkcases"
MODELS = DATA / "models"
FT, DEG, KT = 0.3048, np.pi / 180.0, 1852.0 / 3600.0
LBF, SLUG, SLUG_FT2 = 4.4482216153, 14.593902937, 1.3558179483  # NASA/TM-2015-218675, Table 73
CG_PERCENT = 25.0  # of the mean chord, in all cases; moments of the aero file are about 35 %
REFERENCE_MAC = 0.35


@cache
def database() -> xr.DataTree:
    """The aerodynamic model as terms, coefficients CX CY CZ along body axes, moments about 35 % of the mean chord."""
    return aerodb.import_daveml(MODELS / "F16_aero.dml")


@cache
def thrust() -> xr.Dataset:
    """Static thrust over throttle, Mach number and height [N]; linear in each, so the breakpoints of the file say all of it."""
    model = daveml.read(MODELS / "F16_prop.dml")
    mach, feet = (axis.points for axis in model.functions["T_MIL"].axes)
    lever = np.array([0.0, model.variables["MIL_PWR"].initial, 100.0])
    PWR, RMACH, ALT = np.meshgrid(lever, mach, feet, indexing="ij")
    force = model.evaluate({"PWR": PWR, "RMACH": RMACH, "ALT": ALT})["FEX"]
    return make(force * LBF, {"throttle": lever / 100.0, "mach": mach, "h": feet * FT})


@cache
def aircraft() -> flightmech.Aircraft:
    """Geometry of the aero file, mass properties of the inertia file, engine without lag along body x."""
    mass = {key: float(value) for key, value in daveml.read(MODELS / "F16_inertia.dml").evaluate({"CG_PCT_MAC": CG_PERCENT}).items()}
    root = database().attrs
    return flightmech.Aircraft(
        "F-16", root["S"], root["cbar"], root["b"], mass["XMASS"] * SLUG,
        mass["XIXX"] * SLUG_FT2, mass["XIYY"] * SLUG_FT2, mass["XIZZ"] * SLUG_FT2,
        mass["XIXY"] * SLUG_FT2, mass["XIZX"] * SLUG_FT2, mass["XIYZ"] * SLUG_FT2,
        x_ref_mac=REFERENCE_MAC,
        cg=(mass["DXCG"] * FT, mass["DYCG"] * FT, mass["DZCG"] * FT),
        engines=(flightmech.Engine((0.0, 0.0, 0.0), thrust=thrust()),),
    )  # fmt: skip


@cache
def compiled() -> flightmech.SimModel:
    """The model that flies."""
    return flightmech.compile(aircraft(), database())
