"""A project with the databases of a match, small: two terms with errors, one edited, and what was
flown.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import xarray as xr

sys.path.insert(0, str(Path(__file__).parent))
from bench import small_project

import aerodb
from flightmech import terms

DEG = np.radians(1.0)
FINAL, DATCOM, EDITED = (
    f"{{work}}/{name}" for name in ("match/final.nc", "match/datcom.nc", "databases/edited.nc")
)
ROOT = {
    "title": "T-37",
    "aircraft": "T-37",
    "force_axes": "stability",
    "S": 16.9,
    "cbar": 1.67,
    "b": 10.3,
    "x_ref": -3.0,
    "y_ref": 0.0,
    "z_ref": 0.0,
}


def project_with_databases(folder: Path) -> tuple[Path, Path]:
    """Return project file and working folder."""
    project, work = small_project(folder / "t37"), folder / "work"
    (work / "match").mkdir(parents=True)
    aerodb.save(
        database([-18.0, -17.0, -16.0], [4.0, 4.0, 4.0], "datcom"), work / "match" / "datcom.nc"
    )
    aerodb.save(
        database([-49.0, -50.0, -48.0], [1.0, 0.5, 2.0], "flight"), work / "match" / "final.nc"
    )
    flown().to_netcdf(work / "match" / "flown.nc", engine="h5netcdf")
    return project, work


def database(damping: list[float], stderr: list[float], source: str) -> xr.DataTree:
    """Return a database with a lift table of Mach number and angle of attack and a damping over
    angle of attack.
    """
    alpha, mach = (
        np.array([-4.0, 0.0, 4.0, 8.0]) * DEG,
        np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
    )
    lift = 0.2 + 5.0 * alpha * (1.0 + mach[:, None])
    basic = terms.make_term(
        lift, {"mach": mach, "alpha": alpha}, stderr=np.full(lift.shape, 0.02), source="datcom"
    )
    qhat = terms.make_term(
        damping, {"alpha": np.array([0.0, 4.0, 8.0]) * DEG}, ["qhat"], stderr=stderr, source=source
    )
    flap = terms.make_term([0.0, 0.3], {"delta_f": np.array([0.0, 40.0]) * DEG}, source="datcom")
    return aerodb.make_database({"CL/basic": basic, "CL/flap": flap, "Cm/qhat": qhat}, **ROOT)


def flown() -> xr.DataTree:
    """Return what a match writes of two fits, the second with full flaps."""
    rest = {"mach": 0.25, "gear": 0.0, "speedbrake": 0.0, "h_agl": 1500.0}
    rows = [
        {
            "fit": "a: pitch",
            "coefficient": "Cm",
            "term": "qhat",
            "estimate": -52.0,
            "stderr": 1.5,
            "alpha": 4 * DEG,
            "delta_f": 0.0,
            **rest,
        },
        {
            "fit": "b: pitch",
            "coefficient": "Cm",
            "term": "qhat",
            "estimate": -55.0,
            "stderr": 2.5,
            "alpha": 6 * DEG,
            "delta_f": 40 * DEG,
            **rest,
        },
        {
            "fit": "b: pitch",
            "coefficient": "CL",
            "term": "1",
            "estimate": 0.9,
            "stderr": 0.1,
            "alpha": 6 * DEG,
            "delta_f": 40 * DEG,
            **rest,
        },
    ]
    columns = {
        "samples": ("manoeuvre", "alpha", "mach", "CL"),
        "manoeuvres": (
            "record",
            "label",
            "h",
            "mach",
            "CL",
            "alpha",
            "mass",
            "delta_f",
            "gear",
            "speedbrake",
            "h_agl",
        ),
        "submodels": ("submodel", "part", "technique", "residual"),
    }
    tables = {
        name: xr.Dataset({key: ("row", np.zeros(1)) for key in keys})
        for name, keys in columns.items()
    }
    tables["estimates"] = xr.Dataset({key: ("row", [row[key] for row in rows]) for key in rows[0]})
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={"title": "flown"}),
            **{f"/{name}": table for name, table in tables.items()},
        }
    )
