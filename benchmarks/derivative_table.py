"""Derivatives of the T-37 and of the Citation-500-like database against model and published values,
as a table in Markdown.

    python benchmarks/derivative_table.py

T-37: the model flown for the recordings, JSBSim's T37, read from the installed package ``jsbsim``
(constants, or its tables at the Mach number).  Citation 500: the values of a Delft flight-dynamics
course for 59.9 m/s and CL 1.136, which public repositories carry (axert5/SVV_Flight_Dynamics,
DominikStiller/tudelft-svv-flight-dynamics), on q c/V, doubled here; its listings are the corpus
next to the repository.  Errors are the a-priori standard errors of the database at the nodes.
"""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import datcom_io
import flightmech
from flightmech.units import DEGREE, FOOT

ROOT = Path(__file__).parents[1]
CORPUS = ROOT.parent / "shared" / "data" / "datcom"
RATES = ("qhat", "alphadothat", "beta", "phat", "rhat")
# course values, stability axes, per radian; rates on q c/2V and p b/2V; drag and lift along
# stability axes
COURSE = {
    "CL_alpha": 5.16,
    "Cm_alpha": -0.43,
    "CL_qhat": 2 * 3.86,
    "Cm_qhat": 2 * -7.04,
    "CL_alphadothat": 2 * 1.43,
    "Cm_alphadothat": 2 * -3.70,
    "Cm_delta_e": -1.553,
    "CY_beta": -0.990,
    "Cl_beta": -0.077,
    "Cn_beta": 0.164,
    "CY_phat": -0.087,
    "Cl_phat": -0.344,
    "Cn_phat": -0.011,
    "Cl_rhat": 0.280,
    "Cn_rhat": -0.193,
}
# name to JSBSim function and factor: its aileron is the left one, so delta_a = -left
JSBSIM = {
    "Cm_alpha": ("Cmalpha", 1),
    "CL_qhat": ("CLq", 1),
    "Cm_qhat": ("Cmq", 1),
    "CL_alphadothat": ("CLadot", 1),
    "Cm_alphadothat": ("Cmadot", 1),
    "CL_delta_e": ("CLde", 1),
    "Cm_delta_e": ("Cmde", 1),
    "CY_beta": ("CYb", 1),
    "Cl_beta": ("Clb", 1),
    "Cn_beta": ("Cnb", 1),
    "CY_phat": ("CYp", 1),
    "Cl_phat": ("Clp", 1),
    "Cn_phat": ("Cnp", 1),
    "Cl_rhat": ("Clr", 1),
    "Cn_rhat": ("Cnr", 1),
    "Cl_delta_a": ("Clda", -1),
    "Cn_delta_a": ("Cnda", -1),
}


def derivatives(
    db: xr.DataTree, mach: float, alpha: float, stability: bool
) -> dict[str, tuple[float, float]]:
    """Return derivatives and their a-priori standard errors; moments of the lateral ones turned to
    stability axes or not.
    """
    found = {}
    for coefficient in ("CL", "Cm"):
        leaf = db[f"{coefficient}/basic"].to_dataset().sel(mach=mach)
        slope = leaf["value"].differentiate("alpha").sel(alpha=alpha, method="nearest")
        found[f"{coefficient}_alpha"] = (
            float(slope),
            {"CL": 0.08, "Cm": 0.20}[coefficient] * abs(float(slope)),
        )
    for name, leaf in aerodb.terms(db).items():
        coefficient, contribution = name.split("/")
        if contribution in RATES:
            found[f"{coefficient}_{contribution}"] = _node(leaf, mach=mach, alpha=alpha)
        elif contribution in ("elevator", "aileron") and coefficient != "CD":
            axis = {"elevator": "delta_e", "aileron": "delta_a"}[contribution]
            (high, error), (low, _) = (
                _node(leaf, mach=mach, alpha=alpha, **{axis: sign * 5 * DEGREE}) for sign in (1, -1)
            )
            found[f"{coefficient}_{axis}"] = (high - low) / (10 * DEGREE), error / (5 * DEGREE)
    return _turned(found, alpha) if stability else found


def _node(leaf: xr.Dataset, **where: float) -> tuple[float, float]:
    at = leaf[["value", "stderr"]].interp(
        {axis: x for axis, x in where.items() if axis in leaf["value"].dims}
    )
    return float(at["value"]), float(at["stderr"])


def _turned(
    found: Mapping[str, tuple[float, float]], alpha: float
) -> dict[str, tuple[float, float]]:
    """Return derivatives with moments, and rates of roll and yaw, along stability axes; standard
    errors are left as they are.
    """
    value = {name: pair[0] for name, pair in found.items()}
    T = np.array([[np.cos(alpha), np.sin(alpha)], [-np.sin(alpha), np.cos(alpha)]])
    Cl, Cn = T @ [value["Cl_beta"], value["Cn_beta"]]
    D = T @ [[value["Cl_phat"], value["Cl_rhat"]], [value["Cn_phat"], value["Cn_rhat"]]] @ T.T
    turned = {
        "Cl_beta": Cl,
        "Cn_beta": Cn,
        "Cl_phat": D[0, 0],
        "Cl_rhat": D[0, 1],
        "Cn_phat": D[1, 0],
        "Cn_rhat": D[1, 1],
    }
    turned["CY_phat"] = value["CY_phat"] / np.cos(alpha)
    return {name: (float(turned.get(name, pair[0])), pair[1]) for name, pair in found.items()}


def jsbsim_values(mach: float, alpha: float) -> dict[str, float]:
    """Return the derivatives of JSBSim's T37: constants, or its tables at a Mach number; the slope
    of its lift table at alpha.
    """
    import jsbsim

    root = ElementTree.parse(
        Path(jsbsim.get_default_root_dir()) / "aircraft" / "T37" / "T37.xml"
    ).getroot()
    functions = {
        item.get("name", "").rpartition("/")[2]: item
        for item in root.find("aerodynamics").iter("function")
    }
    found = {
        name: sign * _value(functions[function], mach) for name, (function, sign) in JSBSIM.items()
    }
    points = _rows(functions["CLalpha"])
    found["CL_alpha"] = float(
        np.gradient(np.interp([alpha - 0.01, alpha, alpha + 0.01], *points), 0.01)[1]
    )
    return found


def _value(function: ElementTree.Element, mach: float) -> float:
    constant = function.find(".//value")
    return (
        float(constant.text) if constant is not None else float(np.interp(mach, *_rows(function)))
    )


def _rows(function: ElementTree.Element) -> np.ndarray:
    return np.array(function.find(".//tableData").text.split(), float).reshape(-1, 2).T


def t37() -> xr.DataTree:
    """Return the a-priori database of the T-37 from the listings of the example."""
    listings = {
        "clean": "t37_clean.out",
        "flaps": "t37_flaps.out",
        "elevator": "t37_elevator_one_by_one.pdas.out",
        "aileron": "t37_aileron.out",
        "ground": "t37_ground.out",
        "ground_flap": "t37_ground_flap_one_by_one.pdas.out",
    }
    aircraft = flightmech.read_aircraft(ROOT / "data" / "t37" / "aircraft.toml")
    return aerodb.from_datcom(
        aircraft,
        **{
            role: datcom_io.read(ROOT / "data" / "t37" / "datcom" / name)
            for role, name in listings.items()
        },
        altitude=10000 * FOOT,
    )


def citation() -> xr.DataTree:
    """Return the database of the Citation-500-like jet from the listings of the corpus."""
    from dataclasses import replace

    aircraft = flightmech.read_aircraft(ROOT / "data" / "t37" / "aircraft.toml")
    jet = replace(
        aircraft, name="Citation-500-like", S=24.2, cbar=2.022, b=13.36, reference=(-6.3, 0.0, 0.15)
    )

    def read(name: str) -> datcom_io.Listing:
        return datcom_io.read(CORPUS / name / f"{name}.out")

    return aerodb.from_datcom(
        jet,
        clean=read("ce500_clean"),
        flaps=read("ce500_flaps")[0],
        elevator=read("ce500_elevator"),
        aileron=read("ce500_aileron"),
        ground=read("ce500_ground")[0],
        altitude=0.0,
    )


def show(title: str, ours: Mapping[str, tuple[float, float]], theirs: Mapping[str, float]) -> None:
    """Print a table."""
    print(f"\n{title}\n")
    print(
        "| derivative | database | standard error | compared with | difference in standard "
        "errors |\n|---|---|---|---|---|"
    )
    for name, value in theirs.items():
        own, error = ours[name]
        print(f"| {name} | {own:.3g} | {error:.2g} | {value:.3g} | {(value - own) / error:+.1f} |")


def main() -> None:
    """Print the tables."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        small = t37()
        large = citation() if CORPUS.is_dir() else None
    mach, alpha = 0.3, 2 * DEGREE
    theirs = jsbsim_values(mach, alpha)
    ours = derivatives(small, mach, alpha, stability=False)
    show(
        "T-37, Mach 0.3, 10 000 ft, alpha 2 deg, body axes",
        ours,
        {name: theirs[name] for name in ("CL_alpha", *JSBSIM)},
    )
    if large is None:
        print(f"\nno listings of the Citation 500 at {CORPUS}")
        return
    found = derivatives(large, 0.15, 8 * DEGREE, stability=True)
    show("Citation 500, Mach 0.15, sea level, alpha 8 deg, stability axes", found, COURSE)


if __name__ == "__main__":
    main()
