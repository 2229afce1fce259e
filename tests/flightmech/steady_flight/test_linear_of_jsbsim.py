"""The linear model against that of another simulator: the T37 of the pip package ``jsbsim``, its
tables read where they are installed.

JSBSim flies over the round Earth and differences its own trim; everything else is the same
aeroplane, so what differs is ours.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.terms import make_term
from flightmech.units import FOOT, INCH, POUND, SLUG

jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")

V, H = 90.0, 1524.0
COEFFICIENT = {"DRAG": "CD", "SIDE": "CY", "LIFT": "CL", "ROLL": "Cl", "PITCH": "Cm", "YAW": "Cn"}
REGRESSOR = {
    "aero/alpha-rad": "alpha",
    "aero/beta-rad": "beta",
    "velocities/p-aero-rad_sec": "phat",
    "velocities/q-aero-rad_sec": "qhat",
    "velocities/r-aero-rad_sec": "rhat",
    "aero/alphadot-rad_sec": "alphadothat",
    "fcs/elevator-pos-rad": "delta_e",
    "fcs/rudder-pos-rad": "delta_r",
}
AXIS = {"aero/alpha-rad": "alpha", "aero/beta-rad": "beta", "velocities/mach": "mach"}
FACTORS = {
    "aero/qbar-psf",
    "metrics/Sw-sqft",
    "metrics/bw-ft",
    "metrics/cbarw-ft",
    "aero/bi2vel",
    "aero/ci2vel",
}
GROUND = {"aero/function/kCLge", "aero/function/kCDge"}  # 1 away from the ground
ELSEWHERE = {
    "fcs/flap-pos-norm",
    "gear/gear-pos-norm",
    "fcs/speedbrake-pos-norm",
}  # zero in this flight


def leaf(product: ET.Element) -> xr.Dataset | None:
    """Return a function of the aircraft file as a term, None when it is zero in clean flight."""
    words = [(item.text or "").strip() for item in product.findall("property")]
    if ELSEWHERE & set(words):
        return None
    value, axes = float(product.findtext("value") or 1.0), {}
    table = product.find("table")
    if table is not None:
        points = np.array((table.findtext("tableData") or "").split(), float).reshape(-1, 2)
        value, axes = (
            points[:, 1] * value,
            {AXIS[(table.findtext("independentVar") or "").strip()]: points[:, 0]},
        )
    regressors = []
    for word in words:
        if word == "fcs/mag-elevator-pos-rad":
            value, axes = np.array([0.5, 0.0, 0.5]) * value, {"delta_e": np.array([-0.5, 0.0, 0.5])}
        elif word == "fcs/left-aileron-pos-rad":
            value, regressors = -np.asarray(value), [*regressors, "delta_a"]
        elif word not in FACTORS | GROUND:
            regressors.append(REGRESSOR[word])
    return make_term(value, axes, regressors)


@pytest.fixture(scope="module")
def foreign():
    """JSBSim's linear model and its trim."""
    fdm = jsbsim.FGFDMExec(None)
    fdm.set_debug_level(0)
    fdm.load_model("T37")
    tanks = {f"propulsion/tank[{i}]/contents-lbs": 340.0 for i in range(2)}
    for name, value in {
        **tanks,
        "ic/h-sl-ft": H / FOOT,
        "ic/vt-fps": V / FOOT,
        "ic/gamma-deg": 0.0,
    }.items():
        fdm[name] = value
    fdm.run_ic()
    for name, value in {
        **tanks,
        "propulsion/set-running": -1,
        "gear/gear-cmd-norm": 0,
        "gear/gear-pos-norm": 0,
    }.items():
        fdm[name] = value
    fdm["simulation/do_simple_trim"] = 1
    found = jsbsim.FGLinearization(fdm)
    point = {
        "alpha": fdm["aero/alpha-rad"],
        "delta_e": fdm["fcs/elevator-pos-rad"],
        "mass": fdm["inertia/weight-lbs"] * POUND,
    }
    names = {
        "Vt": "V",
        "Alpha": "alpha",
        "Theta": "theta",
        "Q": "q",
        "Beta": "beta",
        "Phi": "phi",
        "P": "p",
        "R": "r",
    }
    A = np.array(found.system_matrix)
    states = [names.get(name, name) for name in found.x_names]
    unit = np.array([FOOT if name == "V" else 1.0 for name in states])
    coords = {"state": states, "state_": states}
    return xr.DataArray(A * unit[:, None] / unit[None, :], coords, ("state", "state_")), point


@pytest.fixture(scope="module")
def ours(foreign):
    """The same aeroplane compiled by us and linearised at the same flight."""
    root = ET.parse(Path(jsbsim.get_default_root_dir()) / "aircraft" / "T37" / "T37.xml").getroot()
    leaves = {}
    for axis in root.iterfind("aerodynamics/axis"):
        for function in axis.iterfind("function"):
            product = function.find("product")
            found = leaf(product) if product is not None else None
            if found is not None:
                leaves[
                    f"/{COEFFICIENT[axis.attrib['name']]}/{function.attrib['name'].rpartition('/')[2]}"
                ] = found
    db = xr.DataTree.from_dict(leaves)
    db.attrs["force_axes"] = "wind"  # JSBSim turns lift, drag and side force through alpha and beta
    inertia = {
        name: float(root.findtext(f"mass_balance/{name.lower()}")) * SLUG * FOOT**2
        for name in ("Ixx", "Iyy", "Izz")
    }
    engines = tuple(Engine((-40.0 * INCH, y * INCH, 0.0)) for y in (-30.0, 30.0))
    size = {"S": 182.0 * FOOT**2, "cbar": 5.47 * FOOT, "b": 33.83 * FOOT}
    aircraft = flightmech.Aircraft(
        "T37",
        **size,
        mass=foreign[1]["mass"],
        **inertia,
        cg=(0.0, 0.0, 8.8 * INCH),
        engines=engines,
    )
    sim = flightmech.compile(aircraft, db)
    return flightmech.linearize(sim, {"init.V": V, "init.h": H})


def test_trim(ours, foreign):
    """JSBSim starts at the equator, where gravity less the centrifugal force is 0.3 % below
    standard: 0.001 of CL, 2e-4 rad.
    """
    assert float(ours["x"].sel(state="alpha")) == pytest.approx(foreign[1]["alpha"], abs=3e-4)
    assert float(ours["u"].sel(input="delta_e")) == pytest.approx(foreign[1]["delta_e"], abs=3e-4)


def test_state_matrix(ours, foreign):
    """2 % of the largest entry of each row, scaled to equal speeds; V over V is left out: thrust of
    JSBSim changes with speed, ours not.
    """
    size = np.array([V if name == "V" else 1.0 for name in ours["state"].values])
    mine = ours["A"].values / size[:, None] * size[None, :]
    theirs = (
        foreign[0].sel(state=ours["state"].values, state_=ours["state"].values).values
        / size[:, None]
        * size[None, :]
    )
    for i, name in enumerate(ours["state"].values):
        for k, over in enumerate(ours["state"].values):
            if (name, over) != ("V", "V"):
                assert mine[i, k] == pytest.approx(
                    theirs[i, k], abs=0.02 * np.abs(theirs[i]).max()
                ), (name, over)


def test_modes(ours, foreign):
    """Fast modes within 1.5 %, frequency of the phugoid within 3 % (V over V)."""
    states = list(ours["state"].values)
    theirs = flightmech.modes(xr.Dataset({"A": foreign[0].sel(state=states, state_=states)}))
    mine = flightmech.modes(ours)
    assert mine["mode"].tolist() == theirs["mode"].tolist()
    for (_, a), (_, b) in zip(mine.iterrows(), theirs.iterrows()):
        if a["mode"] != "spiral":
            assert a["omega_n"] == pytest.approx(
                b["omega_n"], rel=0.03 if a["mode"] == "phugoid" else 0.015
            ), a["mode"]
            assert a["damping_ratio"] == pytest.approx(
                b["damping_ratio"], abs=0.03 if a["mode"] == "phugoid" else 0.005
            ), a["mode"]
        else:
            assert a["real"] == pytest.approx(b["real"], abs=5e-4)
