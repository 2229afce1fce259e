"""A small invented aeroplane, and flights of it: truth that the tests choose."""

import numpy as np
import xarray as xr

import aerodb
import flightmech
from flightmech import terms

AIRCRAFT = flightmech.Aircraft(
    name="trainer",
    S=17.0,
    cbar=1.7,
    b=10.3,
    mass=2200.0,
    Ixx=10800.0,
    Iyy=8100.0,
    Izz=15100.0,
    cg=(0.0, 0.0, 0.2),
    engines=(
        flightmech.aircraft.Engine(position=(0.0, -0.7, 0.0)),
        flightmech.aircraft.Engine(position=(0.0, 0.7, 0.0)),
    ),
)
ALPHA = np.radians([-10.0, 0.0, 10.0, 20.0])
_RATES = {
    "CL/qhat": 8.0,
    "Cm/qhat": -18.0,
    "Cm/alphadothat": -6.0,
    "Cl/phat": -0.45,
    "Cl/rhat": 0.12,
    "Cn/phat": -0.03,
    "Cn/rhat": -0.12,
}
_OTHERS = {
    "CY/beta": -0.6,
    "Cl/beta": -0.09,
    "Cn/beta": 0.08,
    "CL/elevator": 0.4,
    "Cm/elevator": -1.1,
}
_OTHERS |= {"Cl/aileron": -0.17, "Cn/rudder": -0.07, "CY/rudder": 0.15}
_REGRESSORS = {"elevator": "delta_e", "aileron": "delta_a", "rudder": "delta_r", "gear": "gear"}


def database():
    """Return the true database."""
    leaves = {
        "CL/basic": terms.make_term(0.2 + 5.0 * ALPHA, {"alpha": ALPHA}),
        "CD/basic": terms.make_term(0.02 + 1.3 * ALPHA**2, {"alpha": ALPHA}),
        "Cm/basic": terms.make_term(0.02 - 0.7 * ALPHA, {"alpha": ALPHA}),
        "Cm/gear": terms.make_term(-0.03, regressors=["gear"]),
    }
    for name, value in (_RATES | _OTHERS).items():
        word = name.split("/")[1]
        leaves[name] = terms.make_term(value, regressors=[_REGRESSORS.get(word, word)])
    root = {
        "title": "trainer",
        "aircraft": "trainer",
        "S": 17.0,
        "cbar": 1.7,
        "b": 10.3,
        "force_axes": "stability",
    }
    return aerodb.make_database(leaves, **root, x_ref=0.0, y_ref=0.0, z_ref=0.0)


def scaled(db, **factors):
    """Return `db` with terms multiplied: ``scaled(db, Cm_qhat=0.3)``."""
    found = aerodb.terms(db)
    names = {key: key.replace("_", "/", 1) for key in factors}
    return aerodb.replace_terms(
        db,
        {
            name: found[name].assign(value=found[name]["value"] * factors[key])
            for key, name in names.items()
        },
    )


def flight(db, duration=20.0, **controls):
    """Return what a perfect reconstruction of a flight would give: 20 s at 50 Hz, trimmed at 85 m/s
    in wind and warm air.

    Parameters
    ----------
    duration : float
        [s]
    **controls : list of (time, deflection)
        Corners of control movements added to the trim, ``delta_e=[(5.5, 0.0), (5.6, -0.05)]``.
    """
    time = np.round(np.arange(0.0, duration + 0.001, 0.02), 9)
    inputs = {
        name: ("time", np.interp(time, *np.transpose(corners)))
        for name, corners in controls.items()
    }
    inputs |= {"wind_n": ("time", time * 0.0 + 5.0), "wind_e": ("time", time * 0.0 - 3.0)}
    start = {
        "init.V": 85.0,
        "init.h": 1500.0,
        "init.psi": 6.2,
        "env.delta_T": 12.0,
        "env.qnh": 100500.0,
        "mode.engine": 2,
        "mode.trim": 1,
    }
    found = flightmech.simulate(
        flightmech.compile(AIRCRAFT, db), xr.Dataset(inputs, coords={"time": time}), start
    )
    states = found.drop_vars(
        [name for name in found if str(name).startswith(("applied.", "trim.", "out_of"))]
    )
    states = states.drop_vars(["lat", "lon"])
    applied = {
        name: ("time", found[f"applied.{name}"].values)
        for name in ("delta_e", "delta_a", "delta_r")
    }
    gear = np.asarray(inputs["gear"][1]) if "gear" in inputs else np.zeros_like(time)
    fixed = {
        "mass": 2200.0,
        "z_cg_b": 0.2,
        "delta_f": 0.0,
        "wind_n": 5.0,
        "wind_e": -3.0,
        "wind_d": 0.0,
    }
    return states.assign(
        **applied,
        gear=("time", gear),
        **{name: ("time", np.full_like(time, x)) for name, x in fixed.items()},
    )


TOML = """
name = "trainer"
S = 17.0
cbar = 1.7
b = 10.3
mass = 2200.0
Ixx = 10800.0
Iyy = 8100.0
Izz = 15100.0
cg = [0.0, 0.0, 0.2]
[[engine]]
position = [0.0, -0.7, 0.0]
[[engine]]
position = [0.0, 0.7, 0.0]
"""
