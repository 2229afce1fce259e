"""Exported files flown by JSBSim: its forces and moments at random states against those of the database.

Both compute the same products of double precision numbers in another order: 1e-12 of the force, or of the moment, of each
state is a thousand times their rounding.
"""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.schema import FORCE_AXES
from flightmech import terms
from flightmech.aircraft import Aircraft, Engine
from flightmech.units import POUND_FORCE

spec = importlib.util.spec_from_file_location("jsbsim_flight", Path(__file__).with_name("jsbsim_flight.py"))
flight = importlib.util.module_from_spec(spec)
spec.loader.exec_module(flight)

needs_jsbsim = pytest.mark.skipif(importlib.util.find_spec("jsbsim") is None, reason="jsbsim is not installed: pip install jsbsim")
ROUNDING = 1e-12
T37 = Path(__file__).parents[2] / "data" / "t37"
SIZE = {"S": 17.0, "cbar": 1.7, "b": 10.3}
LIMITS = {name: (-0.4, 0.3) for name in ("delta_e", "delta_a", "delta_r", "delta_t", "delta_ta", "delta_tr")} | {"delta_f": (0.0, 0.8)}
AXES = {
    "alpha": [-0.2, 0.0, 0.1, 0.3],
    "beta": [-0.2, 0.05, 0.25],
    "mach": [0.2, 0.5, 0.8],
    "V": [60.0, 150.0, 250.0],
    "qbar": [3e3, 1e4, 3e4],
    "h": [500.0, 2000.0, 4000.0],
    "h_agl": [2.0, 10.0, 40.0, 3e4],
    "x_cg": [0.1, 0.2, 0.4],
    "phi": [-0.5, 0.5],
    "p": [-0.5, 0.5],
    "q": [-0.5, 0.5],
    "r": [-0.5, 0.5],
    "phat": [-0.03, 0.03],
    "qhat": [-0.003, 0.003],
    "rhat": [-0.02, 0.02],
    "delta_e": [-0.2, 0.0, 0.2],
    "delta_a": [-0.2, 0.2],
    "delta_r": [-0.2, 0.2],
    "delta_t": [-0.2, 0.2],
    "delta_ta": [-0.2, 0.2],
    "delta_tr": [-0.2, 0.2],
    "delta_f": [0.0, 0.3, 0.6],
    "gear": [0.0, 0.5, 1.0],
    "speedbrake": [0.2, 0.9],
    "engine1.throttle": [0.2, 0.8],
    "engine2.thrust": [500.0, 2000.0],
}
EXTRA = {
    "delta_t": "fcs/elevator-tab-pos-rad",
    "delta_ta": "fcs/aileron-tab-pos-rad",
    "delta_tr": "fcs/rudder-tab-pos-rad",
    "engine1.throttle": "fcs/throttle-cmd-norm",
    "engine1.thrust": "fcs/engine1-thrust-lbs",
    "engine2.thrust": "fcs/engine2-thrust-lbs",
}


def synthetic(force_axes, seed=0):
    """Return a database with each axis and each regressor in some term, tables of 0 to 4 axes, factor tables, all force axes."""
    rng = np.random.default_rng(seed)

    def leaf(*axes, regressors=(), scale=1.0, factors=(), **more):
        K = {f"K{i}": terms.make(1.0 + 0.3 * rng.standard_normal(len(AXES[a])), {a: AXES[a]})["value"] for i, a in enumerate(factors, 1)}
        grid = {a: AXES[a] for a in axes}
        value = scale * rng.standard_normal([len(points) for points in grid.values()])
        return terms.make(value, grid, regressors, **K, **more)

    names = FORCE_AXES[force_axes]
    found = {f"{c}/basic": leaf("mach", "alpha", stderr=0.1, source="datcom") for c in names}
    found |= {f"{names[i % 6]}/over_{axis.replace('.', '_')}": leaf(axis, scale=0.3) for i, axis in enumerate(AXES)}
    regressors = [*AXES, "alphadothat", "betadothat", "dnz"]
    sizes = {"V": 1e-2, "qbar": 1e-4, "h": 1e-3, "h_agl": 1e-3, "engine2.thrust": 1e-3, "dnz": 1e-2}
    for i, word in enumerate(regressors):
        found[f"{names[i % 6]}/by_{word.replace('.', '_')}"] = leaf(regressors=[word], scale=sizes.get(word, 1.0))
    found[f"{names[0]}/cube"] = leaf("mach", "alpha", "delta_e", regressors=["qhat", "gear"], factors=("delta_f", "h_agl"))
    found[f"{names[1]}/four"] = leaf("beta", "mach", "delta_f", "alpha")
    found[f"{names[2]}/square"] = leaf("mach", regressors=["beta", "beta"], factors=("alpha",))
    found[f"{names[5]}/four_all"] = leaf("h_agl", "delta_f", "alpha", "delta_r", regressors=["rhat"], factors=("x_cg",))
    found["Cm/constant"] = leaf()
    found["Cm/one_mach"] = terms.make([[0.1, 0.3]], {"mach": [0.4], "alpha": [0.0, 0.2]})
    found["Ch_e/basic"] = leaf("alpha", "delta_e")
    return aerodb.database(found, title="synthetic", aircraft="test", **SIZE, x_ref=-3.0, y_ref=0.1, z_ref=0.2, force_axes=force_axes)


def craft(**changes):
    thrust = terms.make([[300.0, 250.0], [2500.0, 2000.0]], {"throttle": [0.0, 1.0], "mach": [0.0, 0.6]})
    engines = (Engine((-1.0, -0.8, 0.1), (0.98, 0.1, -0.17), thrust, 1.5), Engine((-1.0, 0.8, 0.1), thrust=None))
    own = {"name": "test", **SIZE, "mass": 2400.0, "Ixx": 10826.0, "Iyy": 8135.0, "Izz": 15162.0, "Ixy": 300.0, "Ixz": 500.0, "Iyz": -200.0}
    own |= {"reference": (-3.0, 0.1, 0.2), "cg": (0.25, -0.05, 0.2), "limits": LIMITS, "engines": engines, "x_ref_mac": 0.27}
    return Aircraft(**{**own, **changes})


def flown(path, db, aircraft, count=200, seed=1):
    """Return our loads, JSBSim's loads and the conditions of random states."""
    given, commands = flight.states(count, seed)
    for i, command in enumerate(commands):
        command |= {"fcs/throttle-cmd-norm": i / count, "fcs/engine2-thrust-lbs": 600.0 - i} if aircraft.engines else {}
    more = EXTRA if aircraft.engines else {name: item for name, item in EXTRA.items() if not name.startswith("engine")}
    found, *theirs = flight.fly(path, given, commands, tuple(more.values()))
    at = flight.conditions(found, aircraft)
    at |= {name: found[word] * (POUND_FORCE if name.endswith("thrust") else 1.0) for name, word in more.items()}
    return flight.loads(db, at, aircraft), theirs, at


@needs_jsbsim
@pytest.mark.parametrize("force_axes", ["stability", "wind", "body"])
def test_every_axis_and_regressor(force_axes, tmp_path):
    db, aircraft = synthetic(force_axes), craft()
    aerodb.export_jsbsim(db, tmp_path / "test.xml", aircraft)
    (force, moment), (F, M), at = flown(tmp_path / "test.xml", db, aircraft)
    assert flight.worst(force, F).max() < ROUNDING
    assert flight.worst(moment, M).max() < ROUNDING
    outside = {name: ((at[name] < min(p)) | (at[name] > max(p))).mean() for name, p in AXES.items() if name != "x_cg"}
    assert {name for name, share in outside.items() if share < 0.02} <= {"gear", "h_agl"}  # states lie inside and outside the tables
    assert all(np.ptp(at[name]) > 0.0 for name in (*outside, "alphadothat", "betadothat", "dnz"))
