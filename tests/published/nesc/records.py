"""Trajectories of the published tools, and ours in their columns and units."""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import cache
from itertools import combinations

import numpy as np
import xarray as xr

import flightmech

from .f16 import DATA, DEG, FT, KT, LBF, SLUG

GROUPS = {  # columns by the start of their names
    "height [ft]": "altitudeMsl_ft", "latitude [deg]": "latitude_deg",
    "longitude [deg]": "longitude_deg",
    "velocity over ground [ft/s]": "feVelocity_ft_s_", "attitude [deg]": "eulerAngle_deg_",
    "inertial rates [deg/s]": "bodyAngularRateWrtEi_deg_s_", "Mach number": "mach",
    "air density [slug/ft3]": "airDensity_slug_ft3",
    "aerodynamic force [lbf]": "aero_bodyForce_lbf_",
    "aerodynamic moment [ft lbf]": "aero_bodyMoment_ftlbf_",
}  # fmt: skip
LOADS = ("aero_bodyForce_lbf_", "aero_bodyMoment_ftlbf_")
ANGLES = ("longitude_deg", "eulerAngle_deg_Yaw", "eulerAngle_deg_Roll")  # compared modulo one turn
PSF, DENSITY = LBF / FT**2, SLUG / FT**3
EARTH_RADIUS, ECCENTRICITY_2, EARTH_RATE = 6378137.0, 0.0066943799901413165, 7.292115e-5

Columns = dict[str, np.ndarray]


@cache
def published(case: str, tool: str) -> Columns:
    """Return the columns of one tool, ``time`` among them; `case` is the number in the file names,
    ``"13p1"``.

    Times are rounded to milliseconds: tool 5 writes them in single precision.

    Raises
    ------
    FileNotFoundError
    """
    files = sorted(DATA.glob(f"Atmos_{case}_*/Atmos_{case}_sim_{tool}.csv"))
    if not files:
        raise FileNotFoundError(f"no trajectory of tool {tool} for case {case} in {DATA}")
    with files[0].open(encoding="utf-8") as lines:
        rows = list(csv.reader(lines))
    columns = {
        name: np.array([float(row[i]) for row in rows[1:]]) for i, name in enumerate(rows[0])
    }
    return {**columns, "time": np.round(columns["time"], 3)}


def tools(case: str) -> tuple[str, ...]:
    """Return the numbers of the tools that have a trajectory of a case; none when there is no
    record.
    """
    return tuple(sorted(path.stem[-2:] for path in DATA.glob(f"Atmos_{case}_*/*.csv")))


def as_recorded(run: xr.Dataset, craft: flightmech.Aircraft | None = None) -> Columns:
    """Return our run in the names and units of the records; with the aircraft also forces, and
    moments about the centre of mass.
    """
    y = {str(name): run[name].values for name in run.data_vars}
    found: Columns = {
        "time": np.round(run.time.values, 3),
        "altitudeMsl_ft": y["h"] / FT,
        "mach": y["mach"],
    }
    found |= {
        "longitude_deg": y["lon"] / DEG,
        "latitude_deg": y["lat"] / DEG,
        "altitudeRateWrtMsl_ft_min": y["hdot"] / FT * 60.0,
    }
    found |= {
        f"feVelocity_ft_s_{axis}": y[name] / FT
        for axis, name in zip("XYZ", ("vn", "ve", "vd"), strict=True)
    }
    for axis, angle, rate in zip(
        ("Roll", "Pitch", "Yaw"), ("phi", "theta", "psi"), "pqr", strict=True
    ):
        found[f"eulerAngle_deg_{axis}"], found[f"bodyAngularRateWrtEi_deg_s_{axis}"] = (
            y[angle] / DEG,
            y[rate] / DEG,
        )
    found |= {
        "trueAirspeed_nmi_h": y["V"] / KT,
        "dynamicPressure_lbf_ft2": y["qbar"] / PSF,
        "speedOfSound_ft_s": np.divide(
            y["V"], y["mach"], out=np.full(len(y["V"]), np.nan), where=y["mach"] > 0.0
        )
        / FT,
    }
    found |= {
        "airDensity_slug_ft3": y["rho"] / DENSITY,
        "ambientPressure_lbf_ft2": y["p_static"] / PSF,
    }
    found |= {"ambientTemperature_dgR": y["temperature"] * 1.8, **_place(y)}
    return found if craft is None else found | _loads(y, craft)


def _loads(y: Mapping[str, np.ndarray], craft: flightmech.Aircraft) -> Columns:
    qS = y["qbar"] * craft.S
    force = qS * np.array(
        [
            y["CL"] * np.sin(y["alpha"]) - y["CD"] * np.cos(y["alpha"]),
            y["CY"],
            -y["CL"] * np.cos(y["alpha"]) - y["CD"] * np.sin(y["alpha"]),
        ]
    )
    moment = qS * np.array([craft.b * y["Cl"], craft.cbar * y["Cm"], craft.b * y["Cn"]])
    moment -= np.cross(craft.cg, force, axisb=0, axisc=0)
    found = {
        f"aero_bodyForce_lbf_{axis}": values / LBF
        for axis, values in zip("XYZ", force, strict=True)
    }
    return found | {
        f"aero_bodyMoment_ftlbf_{axis}": values / (LBF * FT)
        for axis, values in zip("LMN", moment, strict=True)
    }


def _place(y: Mapping[str, np.ndarray]) -> Columns:
    """Position in Earth-fixed and inertial axes, which coincide at the start, inertial velocity,
    and the size of the gravitation.
    """
    found = {"localGravity_ft_s2": y["gravitation"] / FT}
    for axis in "XYZ":
        found[f"gePosition_ft_{axis}"], found[f"eiPosition_ft_{axis}"] = (
            y[f"earth.{axis.lower()}"] / FT,
            y[f"inertial.{axis.lower()}"] / FT,
        )
        found[f"eiVelocity_ft_s_{axis}"] = y[f"inertial.v{axis.lower()}"] / FT
    return found


def differences(a: Columns, b: Columns, until: float = np.inf) -> dict[str, float]:
    """Return the largest differences of the columns that both have, at the times that both have.

    Forces and moments count from the second line on: tool 5 writes the first one before its control
    law has moved anything.
    """
    shared, at_a, at_b = np.intersect1d(a["time"], b["time"], return_indices=True)
    at_a, at_b = at_a[shared <= until], at_b[shared <= until]
    gap = {name: a[name][at_a] - b[name][at_b] for name in a if name in b and name != "time"}
    return {
        name: _largest(name, values[1:] if name.startswith(LOADS) else values)
        for name, values in gap.items()
    }


def _largest(name: str, difference: np.ndarray) -> float:
    if name in ANGLES:
        difference = (difference + 180.0) % 360.0 - 180.0
    return float(np.nanmax(np.abs(difference)))


def spreads(case: str, until: float = np.inf) -> dict[tuple[str, str], dict[str, float]]:
    """Return the largest differences of each two tools."""
    return {
        (a, b): differences(published(case, a), published(case, b), until)
        for a, b in combinations(tools(case), 2)
    }


def grouped(found: Mapping[str, float]) -> dict[str, float]:
    """Return the largest difference of each of `GROUPS` that has a column."""
    columns = {
        group: [value for name, value in found.items() if name.startswith(start)]
        for group, start in GROUPS.items()
    }
    return {group: max(values) for group, values in columns.items() if values}
