"""Exported files flown by JSBSim: its forces and moments at random states against those of the
database.

Both compute the same products of double precision numbers in another order: 1e-12 of the force, or
of the moment, of each state is a thousand times their rounding.
"""

import importlib.util
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

import aerodb
from aerodb.store.schema import FORCE_AXES
from flightmech import terms
from flightmech.aircraft.aircraft import Aircraft
from flightmech.aircraft.engine import Engine
from flightmech.errors import SchemaError
from flightmech.units import FOOT, POUND_FORCE, SLUG

spec = importlib.util.spec_from_file_location(
    "jsbsim_flight", Path(__file__).with_name("jsbsim_flight.py")
)
flight = importlib.util.module_from_spec(spec)
spec.loader.exec_module(flight)

needs_jsbsim = pytest.mark.skipif(
    importlib.util.find_spec("jsbsim") is None, reason="jsbsim is not installed: pip install jsbsim"
)
ROUNDING = 1e-12
T37 = Path(__file__).parents[3] / "data" / "t37"
SIZE = {"S": 17.0, "cbar": 1.7, "b": 10.3}
CONTROLS = (
    "delta_e",
    "delta_a",
    "delta_r",
    "delta_t",
    "delta_ta",
    "delta_tr",
    "delta_d",
    "delta_s",
)
LIMITS = {name: (-0.4, 0.3) for name in CONTROLS} | {"delta_f": (0.0, 0.8)}
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
    "delta_d": [-0.2, 0.2],
    "delta_s": [-0.2, 0.2],
    "delta_f": [0.0, 0.3, 0.6],
    "gear": [0.0, 0.5, 1.0],
    "speedbrake": [0.2, 0.9],
    "engine1.throttle": [0.2, 0.8],
    "engine2.thrust": [500.0, 2000.0],
    "CT": [0.0, 0.005],
}
EXTRA = {
    "delta_t": "fcs/elevator-tab-pos-rad",
    "delta_ta": "fcs/aileron-tab-pos-rad",
    "delta_tr": "fcs/rudder-tab-pos-rad",
    "delta_d": "fcs/stabilizer-difference-pos-rad",
    "delta_s": "fcs/spoiler-difference-pos-norm",
    "engine1.throttle": "fcs/throttle-cmd-norm",
    "engine1.thrust": "fcs/engine1-thrust-lbs",
    "engine2.thrust": "fcs/engine2-thrust-lbs",
}


def synthetic(force_axes, seed=0):
    """Return a database with each axis and each regressor in some term, tables of 0 to 4 axes,
    factor tables, all force axes.
    """
    rng = np.random.default_rng(seed)

    def leaf(*axes, regressors=(), scale=1.0, factors=(), **more):
        K = {
            f"K{i}": terms.make_term(1.0 + 0.3 * rng.standard_normal(len(AXES[a])), {a: AXES[a]})[
                "value"
            ]
            for i, a in enumerate(factors, 1)
        }
        grid = {a: AXES[a] for a in axes}
        value = scale * rng.standard_normal([len(points) for points in grid.values()])
        return terms.make_term(value, grid, regressors, **K, **more)

    names = FORCE_AXES[force_axes]
    found = {f"{c}/basic": leaf("mach", "alpha", stderr=0.1, source="datcom") for c in names}
    found |= {
        f"{names[i % 6]}/over_{axis.replace('.', '_')}": leaf(axis, scale=0.3)
        for i, axis in enumerate(AXES)
    }
    regressors = [*AXES, "alphadothat", "betadothat", "dnz"]
    sizes = {"V": 1e-2, "qbar": 1e-4, "h": 1e-3, "h_agl": 1e-3, "engine2.thrust": 1e-3, "dnz": 1e-2}
    for i, word in enumerate(regressors):
        found[f"{names[i % 6]}/by_{word.replace('.', '_')}"] = leaf(
            regressors=[word], scale=sizes.get(word, 1.0)
        )
    found[f"{names[0]}/cube"] = leaf(
        "mach", "alpha", "delta_e", regressors=["qhat", "gear"], factors=("delta_f", "h_agl")
    )
    found[f"{names[1]}/four"] = leaf("beta", "mach", "delta_f", "alpha")
    found[f"{names[2]}/square"] = leaf("mach", regressors=["beta", "beta"], factors=("alpha",))
    found[f"{names[5]}/four_all"] = leaf(
        "h_agl", "delta_f", "alpha", "delta_r", regressors=["rhat"], factors=("x_cg",)
    )
    found["Cm/constant"] = leaf()
    found["Cm/one_mach"] = terms.make_term([[0.1, 0.3]], {"mach": [0.4], "alpha": [0.0, 0.2]})
    found["Ch_e/basic"] = leaf("alpha", "delta_e")
    return aerodb.make_database(
        found,
        title="synthetic",
        aircraft="test",
        **SIZE,
        x_ref=-3.0,
        y_ref=0.1,
        z_ref=0.2,
        force_axes=force_axes,
    )


def craft(**changes):
    thrust = terms.make_term(
        [[300.0, 250.0], [2500.0, 2000.0]], {"throttle": [0.0, 1.0], "mach": [0.0, 0.6]}
    )
    engines = (
        Engine((-1.0, -0.8, 0.1), (0.98, 0.1, -0.17), thrust, 1.5),
        Engine((-1.0, 0.8, 0.1), thrust=None),
    )
    own = {
        "name": "test",
        **SIZE,
        "mass": 2400.0,
        "Ixx": 10826.0,
        "Iyy": 8135.0,
        "Izz": 15162.0,
        "Ixy": 300.0,
        "Ixz": 500.0,
        "Iyz": -200.0,
    }
    own |= {
        "reference": (-3.0, 0.1, 0.2),
        "cg": (0.25, -0.05, 0.2),
        "limits": LIMITS,
        "engines": engines,
        "x_ref_mac": 0.27,
    }
    return Aircraft(**{**own, **changes})


def flown(path, db, aircraft, count=200, more=EXTRA):
    """Return our loads, JSBSim's loads and the conditions of random states."""
    given, commands = flight.states(count, seed=1)
    for i, command in enumerate(commands):
        command |= (
            {"fcs/throttle-cmd-norm": i / count, "fcs/engine2-thrust-lbs": 600.0 - i}
            if aircraft.engines
            else {}
        )
    found, *theirs = flight.fly(path, given, commands, tuple(more.values()))
    at = flight.conditions(found, aircraft)
    at |= {
        name: found[word] * (POUND_FORCE if name.endswith("thrust") else 1.0)
        for name, word in more.items()
    }
    at["CT"] = sum(at[f"engine{i}.thrust"] for i in range(1, len(aircraft.engines) + 1)) / (
        at["qbar"] * aircraft.S
    )
    return flight.loads(db, at, aircraft), theirs, at


@pytest.mark.nightly
@needs_jsbsim
@pytest.mark.parametrize("force_axes", ["stability", "wind", "body"])
def test_every_axis_and_regressor(force_axes, tmp_path):
    db, aircraft = synthetic(force_axes), craft()
    aerodb.exchange.export_jsbsim(db, tmp_path / "test.xml", aircraft)
    (force, moment), (F, M), at = flown(tmp_path / "test.xml", db, aircraft)
    assert flight.worst(force, F).max() < ROUNDING
    assert flight.worst(moment, M).max() < ROUNDING
    outside = {
        name: ((at[name] < min(p)) | (at[name] > max(p))).mean()
        for name, p in AXES.items()
        if name != "x_cg"
    }
    assert {name for name, share in outside.items() if share < 0.02} <= {
        "gear",
        "h_agl",
    }  # states lie inside and outside the tables
    assert all(np.ptp(at[name]) > 0.0 for name in (*outside, "alphadothat", "betadothat", "dnz"))


@pytest.mark.slow
@needs_jsbsim
def test_tables_of_four_axes_for_an_older_jsbsim(tmp_path):
    """The file was also loaded in JSBSim 1.2.1, with the same forces; 1.2.1 refuses the native
    tables.
    """
    db, aircraft = synthetic("stability"), craft()
    aerodb.exchange.export_jsbsim(db, tmp_path / "test.xml", aircraft, jsbsim_min="1.2")
    assert "axis4" not in (tmp_path / "test.xml").read_text()
    (force, moment), (F, M), _ = flown(tmp_path / "test.xml", db, aircraft, count=50)
    assert max(flight.worst(force, F).max(), flight.worst(moment, M).max()) < ROUNDING


@pytest.mark.nightly
@needs_jsbsim
def test_t37(t37_db, craft, tmp_path):
    """The database of the listings, c.g. off the moment reference in all directions."""
    size = {name: getattr(craft, name) for name in ("S", "cbar", "b", "reference")}
    inertia = {"mass": 2150.0, "Ixx": 10826.0, "Iyy": 8135.0, "Izz": 15162.0}
    aircraft = Aircraft("T-37", **size, **inertia, cg=(0.2, 0.05, 0.22), limits=LIMITS)
    aerodb.exchange.export_jsbsim(t37_db, tmp_path / "t37.xml", aircraft)
    (force, moment), (F, M), at = flown(tmp_path / "t37.xml", t37_db, aircraft, more={})
    assert max(flight.worst(force, F).max(), flight.worst(moment, M).max()) < ROUNDING
    assert np.ptp(at["h_agl"]) > 1000.0
    assert (at["h_agl"] < 10.0).any()


@pytest.mark.nightly
@needs_jsbsim
def test_lines_beyond_the_table(tmp_path):
    """A term with outside = linear, its tables continued to all angles of the states."""
    db = synthetic("stability")
    table = {"alpha": [0.0, 0.1, 0.2], "mach": [0.3, 0.6]}
    line = terms.make_term([[0.0, 0.1], [0.5, 0.7], [0.8, 1.5]], table, outside="linear")
    db = aerodb.replace_terms(db, {"CL/line": line})
    with pytest.raises(
        SchemaError,
        match=r"CL/line: goes on linearly .* give reach = \{'alpha': \(low, high\)\} for alpha, "
        r"mach",
    ):
        aerodb.exchange.export_jsbsim(db, tmp_path / "test.xml", craft())
    aerodb.exchange.export_jsbsim(
        db, tmp_path / "test.xml", craft(), reach={"alpha": (-1.0, 1.0), "mach": (0.0, 1.5)}
    )
    (force, moment), (F, M), at = flown(tmp_path / "test.xml", db, craft(), count=50)
    assert max(flight.worst(force, F).max(), flight.worst(moment, M).max()) < ROUNDING
    assert at["alpha"].max() > 0.3


@pytest.mark.slow
@needs_jsbsim
def test_mass_and_engines(tmp_path):
    """Angular accelerations of JSBSim from its own moments: 1e-4 of the moment is far below any
    product of inertia of the file.
    """
    aircraft = craft()
    aerodb.exchange.export_jsbsim(synthetic("wind"), tmp_path / "test.xml", aircraft)
    more = [f"accelerations/{axis}dot-rad_sec2" for axis in "pqr"] + [
        f"moments/{axis}-total-lbsft" for axis in "lmn"
    ]
    more += [f"forces/fb{axis}-external-lbs" for axis in "xyz"] + [
        f"moments/{axis}-external-lbsft" for axis in "lmn"
    ]
    given, commands = flight.states(20, 5)
    for command in commands:
        command["fcs/engine2-thrust-lbs"] = 500.0
    found, *_ = flight.fly(
        tmp_path / "test.xml",
        given,
        commands,
        (*more, "inertia/mass-slugs", "fcs/engine1-thrust-lbs"),
    )
    rates, rates_dot, M, F_engine, M_engine = (
        np.stack([found[name] for name in names], -1)
        for names in (("p", "q", "r"), more[:3], more[3:6], more[6:9], more[9:])
    )
    J = np.array(
        [
            [aircraft.Ixx, -aircraft.Ixy, -aircraft.Ixz],
            [-aircraft.Ixy, aircraft.Iyy, -aircraft.Iyz],
            [0.0, 0.0, aircraft.Izz],
        ]
    )
    J[2, :2] = J[:2, 2]
    J = J / (SLUG * FOOT**2)
    expected = rates_dot @ J + np.cross(rates, rates @ J)
    assert np.abs(expected - M).max() < 1e-4 * np.abs(M).max()
    assert found["inertia/mass-slugs"][0] == pytest.approx(
        aircraft.mass / SLUG, rel=1e-6
    )  # JSBSim's g0 has eight digits
    thrust = np.stack([found["fcs/engine1-thrust-lbs"], np.full(20, 500.0)], -1)
    direction, position = (
        np.array([getattr(engine, name) for engine in aircraft.engines])
        for name in ("direction", "position")
    )
    assert (
        np.abs(thrust @ direction - F_engine).max() < 1e-4 * 500.0
    )  # the direction is a unit vector to four digits
    turning = np.cross((position - aircraft.cg) / FOOT, direction)
    assert np.abs(thrust @ turning - M_engine).max() < 1e-3 * np.abs(M_engine).max()


def test_what_cannot_be_written_is_named(tmp_path):
    db = synthetic("stability")
    db = aerodb.replace_terms(
        db,
        {
            "CL/late": terms.make_term([0.0, 1.0], {"time": [0.0, 1.0]}),
            "Cm/fan": terms.make_term(1.0, regressors=["n1"]),
        },
    )
    with pytest.raises(SchemaError) as caught:
        aerodb.exchange.export_jsbsim(
            db,
            tmp_path / "test.xml",
            craft(S=18.0, reference=(0.0, 0.0, 0.0), engines=(), limits={"delta_e": (-0.3, 0.3)}),
        )
    text = str(caught.value)
    assert "CL/late: time is nothing that JSBSim knows" in text
    assert "Cm/fan: n1 is nothing that JSBSim knows" in text
    assert "by_CT: CT is nothing" in text
    assert "engine2.thrust is nothing" in text
    assert "S is 17 in the database and 18 in the aircraft; they must agree" in text
    assert "x_ref is -3 m in the database and 0 m in the aircraft" in text
    assert (
        "delta_a has no limits in the aircraft file, which scale its command; add [limits] "
        "delta_a = [low, high]" in text
    )
    assert not (tmp_path / "test.xml").exists()


def test_the_file_states_what_it_holds(tmp_path):
    """Functions by the names of the terms, frames of the axes, error and source of the nodes next
    to them, the same bytes each time.
    """
    db = synthetic("stability")
    db.attrs["title"] = "a <title> &\x0b more"
    db["CL/basic"].attrs |= {
        "comment": "clean -- as\nprinted",
        "references": "t37.out, lines 1--20",
    }
    for name in ("one.xml", "two.xml"):
        aerodb.exchange.export_jsbsim(db, tmp_path / name, craft())
    text = (tmp_path / "one.xml").read_text()
    assert text == (tmp_path / "two.xml").read_text()
    assert (
        "<!-- table(mach, alpha); nodes: datcom 12; standard error 0.1 ... 0.1; t37.out, "
        "lines 1- -20" in text
    )
    root = ET.fromstring(text)
    assert {
        (axis.get("name"), axis.get("frame")) for axis in root.iterfind("aerodynamics/axis")
    } == {
        *((name, "STABILITY") for name in "XYZ"),
        *((name, None) for name in ("ROLL", "PITCH", "YAW")),
    }
    assert {
        f.get("name")
        for f in root.iter("function")
        if (f.get("name") or "").startswith("aero/coefficient/")
    } == {f"aero/coefficient/{name}" for name in aerodb.terms(db)}
    assert root.findtext("fileheader/description") == "a <title> &  more"
    assert (
        root.find(".//function[@name='aero/coefficient/CL/basic']/description").text
        == "clean -- as printed"
    )
    assert float(root.findtext("metrics/wingarea")) * FOOT**2 == pytest.approx(SIZE["S"], rel=1e-15)


@pytest.mark.slow
def test_a_tab_without_limits_is_a_position_that_is_set_directly(tmp_path):
    db = aerodb.replace_terms(
        synthetic("stability"), {"Cm/tab": terms.make_term(-0.1, regressors=["delta_t"])}
    )
    limits = {name: pair for name, pair in craft().limits.items() if name != "delta_t"}
    aerodb.exchange.export_jsbsim(db, tmp_path / "test.xml", craft(limits=limits))
    root = ET.parse(tmp_path / "test.xml").getroot()
    assert "fcs/elevator-tab-pos-rad" in [
        item.text for item in root.findall("flight_control/property")
    ]
    assert "fcs/elevator-tab-pos-rad" not in [item.text for item in root.iter("output")]
    assert "fcs/pitch-trim-cmd-norm" not in [item.text for item in root.iter("input")]
