"""Propellers, piston engines and turboprops of JSBSim, against frames of JSBSim itself."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import aerodb
import flightmech
from aerodb.exchange.jsbsim.propulsion.engines import import_jsbsim_engine
from aerodb.exchange.jsbsim.propulsion.propellers import import_jsbsim_propeller
from aerodb.exchange.jsbsim.propulsion.writing import export_jsbsim_engine
from flightmech import air
from flightmech.aircraft import Engine
from flightmech.aircraft.propulsion.shaft_tables import list_constants
from flightmech.errors import ParseError, SchemaError
from flightmech.simulation.kernel import STATE, Simulation
from flightmech.terms import make_term
from flightmech.units import FOOT, POUND_FORCE

jsbsim = pytest.importorskip("jsbsim", reason="the wheel jsbsim is not installed")
ENGINES = Path(jsbsim.__file__).parent / "engine"
SHARED = Path(__file__).parents[4] / "shared" / "data" / "estimators" / "propeller_engine"
# constants of JSBSim: pascals per pound per square foot, pounds per kilogram, slug/ft3
PSF, POUNDS, SLUGS = 47.88, 2.2046, 515.378818
HORSEPOWER = 550.0 * FOOT * POUND_FORCE

# Frames of JSBSim's Cessna 172P: 95 kt at three heights, throttles and mixtures.
FLIGHT = """
import json, jsbsim
f = jsbsim.FGFDMExec(None)
f.set_debug_level(0)
f.load_model("c172p")
e = "propulsion/engine/"
names = {
    "map": e + "map-pa", "power": e + "power-hp", "fuel": e + "fuel-flow-rate-pps",
    "thrust": e + "thrust-lbs", "J": e + "advance-ratio", "CT": e + "thrust-coefficient",
    "absorbed": e + "propeller-power-ftlbps", "afr": e + "AFR", "p": "atmosphere/P-psf",
    "T": "atmosphere/T-R", "rho": "atmosphere/rho-slugs_ft3",
    "throttle": "fcs/throttle-pos-norm", "mixture": "fcs/mixture-pos-norm",
}
frames = []
for height, throttle, mixture in ((2000, 0.8, 0.9), (8000, 1.0, 0.75), (500, 0.4, 1.0)):
    f["ic/h-sl-ft"], f["ic/vc-kts"] = height, 95
    f.run_ic()
    f["propulsion/set-running"] = -1
    f["fcs/throttle-cmd-norm"], f["fcs/mixture-cmd-norm"] = throttle, mixture
    for k in range(361):
        # the speed that a frame begins with is the one it computes with
        rpm = f[e + "propeller-rpm"]
        f.run()
        if k % 60 == 0 and k:
            frames.append({name: f[key] for name, key in names.items()} | {"rpm": rpm})
print("FRAMES" + json.dumps(frames))
"""


@pytest.fixture(scope="module")
def frames() -> list[dict[str, float]]:
    run = subprocess.run(
        [sys.executable, "-c", FLIGHT], capture_output=True, text=True, check=True, timeout=120
    )
    line = next(row for row in run.stdout.splitlines() if row.startswith("FRAMES"))
    return json.loads(line.removeprefix("FRAMES"))


def cessna() -> tuple[flightmech.SimModel, float]:
    """The engine of the Cessna 172P alone, and the diameter of its propeller."""
    mover = import_jsbsim_engine(ENGINES / "eng_io320.xml")
    blades, _ = import_jsbsim_propeller(ENGINES / "prop_75in2f.xml", engine_rpm=mover.rated_rpm)
    engine = Engine((0.0, 0.0, 0.0), propeller=mover.on(blades), piston=mover.piston)
    fields = {"S": 16.2, "cbar": 1.5, "b": 11.0, "Ixx": 1300.0, "Iyy": 1800.0, "Izz": 2700.0}
    craft = flightmech.Aircraft("c172p", **fields, mass=1000.0, x_ref_mac=0.25, engines=(engine,))
    tree = flightmech_tree()
    return flightmech.compile(craft, tree), blades.diameter


def flightmech_tree():
    import xarray as xr  # the tree is made here alone

    return xr.DataTree.from_dict({"/CD/basic": make_term(0.0)})


def at_frame(sim: flightmech.SimModel, frame: dict[str, float], diameter: float) -> dict:
    """The outputs in the state of a frame."""
    pressure, temperature = frame["p"] * PSF, frame["T"] / 1.8
    height = brentq(lambda h: float(air.atmosphere(h).p_static) - pressure, -500.0, 5e3, xtol=1e-9)
    offset = temperature - float(air.atmosphere(height).temperature)
    speed = frame["J"] * frame["rpm"] / 60.0 * diameter
    run = Simulation(sim.model)
    parameters = {
        "init.V": speed,
        "init.h": height,
        "env.delta_T": offset,
        "mode.earth": 0.0,
        "mode.engine": 0.0,
    }
    for name, value in parameters.items():
        run.set_parameter(sim.parameters.index(name), value)
    u = np.array([row.value for row in sim.entries(0)])
    for name in ("throttle", "mixture"):
        u[sim.inputs.index(f"engine1.{name}")] = frame[name]
    run.set_inputs(u)
    run.initialize()
    names = [row.name for row in sim.entries(STATE)]
    x = run.state.copy()
    states = {"rpm": frame["rpm"] * 2.0 * np.pi / 60.0, "manifold_pressure": frame["map"]}
    for name, value in states.items():
        x[names.index(f"state.engine1.{name}")] = value
    run.state = x
    return dict(zip(sim.outputs, run.outputs(), strict=True))


def test_frames_of_the_cessna(frames):
    """Coefficients, power and fuel of 18 frames: the same equations, to the constants of JSBSim."""
    sim, diameter = cessna()
    assert len(frames) == 18
    for frame in frames:
        y = at_frame(sim, frame, diameter)
        n = frame["rpm"] / 60.0
        assert y["engine1.J"] == pytest.approx(frame["J"], rel=1e-12)
        # 745.7 and 745.69987 W are both a horsepower of JSBSim
        assert y["engine1.shaft_power"] == pytest.approx(frame["power"] * HORSEPOWER, rel=1e-6)
        assert y["engine1.fuel_flow"] == pytest.approx(frame["fuel"] / POUNDS, rel=1e-6)
        assert 1.0 / y["engine1.fuel_air_ratio"] == pytest.approx(frame["afr"], rel=1e-7)
        # the speed of sound differs by 1.4e-6: where the factor of the tip Mach number acts
        acts = y["engine1.tip_mach"] > 0.85
        tolerance = 2e-5 if acts else 1e-8
        assert y["engine1.CT_prop"] == pytest.approx(frame["CT"], rel=tolerance)
        absorbed = frame["absorbed"] * FOOT * POUND_FORCE / (frame["rho"] * SLUGS)
        assert y["engine1.CP_prop"] * n**3 * diameter**5 == pytest.approx(absorbed, rel=tolerance)


def test_own_points_of_the_cessna():
    """Power and thrust of nine recorded points of JSBSim, from rpm, manifold pressure and
    density.
    """
    path = SHARED / "own_jsbsim_c172p_engine_points.csv"
    if not path.is_file():
        pytest.skip(f"no {path}: the shared material is not next to the checkout")
    rows = np.genfromtxt(path, delimiter=",", names=True)
    blades, _ = import_jsbsim_propeller(ENGINES / "prop_75in2f.xml", engine_rpm=280.0)
    for row in rows:
        n = row["rpm"] / 60.0
        at = {"J": row["advance_ratio"]}
        value = float(blades.tables["CT_prop"]["value"].interp(J=at["J"]))
        thrust = value * row["rho_slugft3"] * SLUGS * n**2 * blades.diameter**4
        # at most 2851 rpm, where the factor of the tip Mach number takes 2 %
        assert thrust == pytest.approx(row["thrust_lb"] * POUND_FORCE, rel=0.03)
    slow = rows[rows["rpm"] < 2300.0]
    n = slow["rpm"] / 60.0
    value = blades.tables["CT_prop"]["value"].interp(J=slow["advance_ratio"]).values
    thrust = value * slow["rho_slugft3"] * SLUGS * n**2 * blades.diameter**4
    np.testing.assert_allclose(thrust, slow["thrust_lb"] * POUND_FORCE, rtol=1.5e-3)


def test_comment_is_not_a_table():
    """An old table in an XML comment stands before the valid one: CT at rest is 0.073, not
    0.068.
    """
    blades, remarks = import_jsbsim_propeller(ENGINES / "prop_75in2f.xml", engine_rpm=280.0)
    assert float(blades.tables["CT_prop"]["value"][0]) == 0.073
    assert blades.diameter == pytest.approx(75.0 * 0.0254)
    assert not blades.governed
    assert "C_POWER is never negative: the failed engine does not windmill" in remarks


@pytest.mark.slow
def test_variable_pitch():
    blades, remarks = import_jsbsim_propeller(ENGINES / "prop_81in2v.xml")
    assert blades.governed
    assert blades.rpm_high == pytest.approx(2400.0 * 2.0 * np.pi / 60.0)
    # the table begins at J 0.1; JSBSim holds its first value to J 0
    table = blades.tables["CT_prop"]["value"]
    assert table["J"].values[:2].tolist() == [0.0, 0.1]
    np.testing.assert_array_equal(table.values[0], table.values[1])
    # 1 deg/s per rpm
    assert blades.governor_gain == pytest.approx(1.0 / 6.0)
    assert any("feathering is not read" in text for text in remarks)
    # the file has no version, so JSBSim turns its gyroscopic moment round
    assert any('lacks version="1.1"; here it is -omega x H' in text for text in remarks)


def test_turboprop():
    """Power over speeds and altitude, limits, fuel and temperature of the M601."""
    mover = import_jsbsim_engine(ENGINES / "engtm601.xml")
    assert mover.limits["power_limit"] == pytest.approx(700.0 * HORSEPOWER)
    assert mover.limits["torque_limit"] == pytest.approx(1751.0 * FOOT * POUND_FORCE)
    power = mover.tables["shaft_power"]
    rpm = 2000.0 * 2.0 * np.pi / 60.0
    assert float(power["value"].sel(engine_rpm=rpm, n1=1.0)) == pytest.approx(700.0 * HORSEPOWER)
    # at sea level and 50 kt the power is 1.011 of that at rest
    factor = power["K1"]
    assert factor.values[6].tolist() == [1.0, 1.011, 1.029, 1.043, 1.083, 1.15]
    assert float(factor["pressure_ratio"][6]) == pytest.approx(2135.0 / 2116.22, rel=1e-5)
    assert mover.deck is not None
    itt = mover.deck.tables["itt"]
    assert float(itt["value"].sel(n1=1.0)) == 730.0 + 273.15
    # PSFC 0.669 lb/(hp h) at N1 100 %, where the efficiency is 1
    consumption = float(mover.tables["shaft_bsfc"]["value"].sel(n1=1.0))
    assert consumption == pytest.approx(0.669 * 0.45359237 / 3600.0 / HORSEPOWER)


@pytest.mark.slow
def test_turboprop_flies():
    """The M601 on a propeller of its size: governed speed, power within the limits."""
    mover = import_jsbsim_engine(ENGINES / "engtm601.xml")
    blades, _ = import_jsbsim_propeller(ENGINES / "prop_PT6.xml")
    engine = Engine((0.0, 0.0, 0.0), propeller=mover.on(blades), deck=mover.deck)
    fields = {"S": 28.0, "cbar": 1.9, "b": 15.0, "Ixx": 2e4, "Iyy": 2e4, "Izz": 4e4}
    craft = flightmech.Aircraft(
        "commuter", **fields, mass=5000.0, x_ref_mac=0.25, engines=(engine,)
    )
    sim = flightmech.compile(craft, flightmech_tree())
    run = Simulation(sim.model)
    for name, value in {"init.V": 80.0, "init.h": 1000.0, "mode.engine": 0.0}.items():
        run.set_parameter(sim.parameters.index(name), value)
    u = np.array([row.value for row in sim.entries(0)])
    u[sim.inputs.index("engine1.throttle")] = 0.7
    run.set_inputs(u)
    run.initialize()
    y = dict(zip(sim.outputs, run.outputs(), strict=True))
    assert y["engine1.n1"] == pytest.approx(0.6 + 0.7 * 0.4)
    assert 0.0 < y["engine1.shaft_power"] < 700.0 * HORSEPOWER
    assert y["engine1.rpm"] <= blades.rpm_high * (1.0 + 1e-12)
    n = y["engine1.rpm"] / (2.0 * np.pi)
    absorbed = y["engine1.CP_prop"] * y["rho"] * n**3 * blades.diameter**5
    assert absorbed == pytest.approx(y["engine1.shaft_power"], rel=1e-9)


@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("PT6A-27.xml", "its thrust is not shaft power"),
        ("PT6A-68.xml", "its thrust is not shaft power"),
        ("J69-T25.xml", "its thrust is not shaft power"),
        ("direct.xml", "one of <piston_engine>, <turboprop_engine>"),
    ],
)
def test_engines_that_are_not_read(file, text):
    """A thrust engine with the name of a turboprop is not read as shaft power."""
    with pytest.raises(ParseError, match=text):
        import_jsbsim_engine(ENGINES / file)


def test_diameter_without_a_unit():
    """99 without a unit are 99 ft in JSBSim."""
    with pytest.raises(ParseError, match=r"a diameter of 30\.18 m.*unit=\"IN\""):
        import_jsbsim_propeller(ENGINES / "vrtule2.xml")


def test_aircraft_with_its_engine():
    path = Path(jsbsim.__file__).parent / "aircraft" / "c172p" / "c172p.xml"
    craft = aerodb.exchange.import_jsbsim_aircraft(path)
    (engine,) = craft.engines
    assert engine.piston is not None
    assert engine.propeller is not None
    assert engine.propeller.rotation == 1
    # thruster at x -37.7, z 26.6 in, AERORP of the file at 43.2, 0, 59.4 in
    arm = np.array(engine.position) + np.array(craft.reference)
    np.testing.assert_allclose(arm, np.array([37.7, 0.0, -26.6]) * 0.0254, rtol=1e-12)
    # p_factor 5 in per rad
    moment = engine.propeller.tables["CM_prop"]["value"].values
    thrust = engine.propeller.tables["CT_prop"]["value"].values
    np.testing.assert_allclose(moment, thrust * 5.0 / 75.0, rtol=1e-12)


def test_short_propeller_is_refused(tmp_path):
    text = (ENGINES / "prop_75in2f.xml").read_text()
    begin = text.index("1.2   -0.006")
    end = text.index("</tableData>", begin)
    file = tmp_path / "short.xml"
    file.write_text(text[:begin] + text[end:])
    with pytest.raises(SchemaError, match="continue both tables until the thrust is negative"):
        import_jsbsim_propeller(file, engine_rpm=280.0)


def same_tables(a, b) -> None:
    """Tables of two engines agree to the rounding of the units."""
    assert set(a) == set(b)
    for name, leaf in a.items():
        for table in leaf.data_vars:
            np.testing.assert_allclose(
                leaf[table].values, b[name][table].values, rtol=1e-9, atol=1e-12
            )


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("engine", "propeller"),
    [
        ("eng_io320.xml", "prop_75in2f.xml"),
        ("engIO360C.xml", "prop_81in2v.xml"),
        ("engtm601.xml", "prop_PT6.xml"),
    ],
)
def test_written_files_are_read_again(tmp_path, engine, propeller):
    """Import, export, import: the same constants and tables."""
    mover = import_jsbsim_engine(ENGINES / engine)
    blades, _ = import_jsbsim_propeller(ENGINES / propeller, engine_rpm=mover.rated_rpm)
    whole = Engine(
        (0.0, 0.0, 0.0), propeller=mover.on(blades), piston=mover.piston, deck=mover.deck
    )
    names = export_jsbsim_engine(whole, tmp_path, "again")
    again = import_jsbsim_engine(tmp_path / f"{names[0]}.xml")
    turned, _ = import_jsbsim_propeller(tmp_path / f"{names[1]}.xml", engine_rpm=again.rated_rpm)
    same_tables(blades.tables, turned.tables)
    for name in ("diameter", "inertia", "rpm_high", "low_pitch", "highest", "gear_ratio"):
        assert getattr(turned, name) == pytest.approx(getattr(blades, name), rel=1e-12), name
    if mover.piston is not None:
        assert again.piston is not None
        same_tables(mover.piston.tables, again.piston.tables)
        for name in list_constants(type(mover.piston)):
            value = getattr(mover.piston, name)
            assert getattr(again.piston, name) == pytest.approx(value, rel=1e-9), name
    else:
        assert mover.deck is not None
        assert again.deck is not None
        same_tables(mover.tables, again.tables)
        same_tables(mover.deck.tables, again.deck.tables)
        assert again.limits == pytest.approx(mover.limits)


WRITTEN = """
import jsbsim, sys
f = jsbsim.FGFDMExec(None)
f.set_debug_level(0)
f.set_aircraft_path(sys.argv[1])
f.load_model("trainer")
f["ic/h-sl-ft"], f["ic/vc-kts"] = 3000, 95
f.run_ic()
f["propulsion/set-running"] = -1
f["fcs/throttle-cmd-norm"], f["fcs/mixture-cmd-norm"] = 0.9, 0.9
for k in range(600):
    rpm = f["propulsion/engine/propeller-rpm"]
    f.run()
e = "propulsion/engine/"
print("WRITTEN", rpm, f[e + "power-hp"], f[e + "thrust-lbs"], f[e + "advance-ratio"],
      f["atmosphere/rho-slugs_ft3"], f["inertia/weight-lbs"])
f["ic/q-rad_sec"], f["ic/r-rad_sec"] = 0.2, 0.3
f.run_ic()
f["propulsion/set-running"] = -1
rpm, q, r = f[e + "propeller-rpm"], f["velocities/qi-rad_sec"], f["velocities/ri-rad_sec"]
f.run()
print("TURNING", rpm, q, r, f["moments/m-prop-lbsft"], f["moments/n-prop-lbsft"])
"""


@pytest.mark.slow
def test_jsbsim_flies_the_written_aircraft(tmp_path):
    """JSBSim starts the written engine; its thrust is that of our table at its rpm and J."""
    mover = import_jsbsim_engine(ENGINES / "eng_io320.xml")
    blades, _ = import_jsbsim_propeller(ENGINES / "prop_75in2f.xml", engine_rpm=mover.rated_rpm)
    engine = Engine((1.0, 0.0, 0.0), propeller=mover.on(blades), piston=mover.piston)
    fields = {"S": 16.2, "cbar": 1.5, "b": 11.0, "Ixx": 1300.0, "Iyy": 1800.0, "Izz": 2700.0}
    craft = flightmech.Aircraft("trainer", **fields, mass=1000.0, x_ref_mac=0.25, engines=(engine,))
    folder = tmp_path / "trainer"
    folder.mkdir()
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/pitch_rate": make_term(-12.0, regressors=["qhat"]),
    }
    sizes = {name: fields[name] for name in ("S", "cbar", "b")}
    place = {"x_ref": 0.0, "y_ref": 0.0, "z_ref": 0.0}
    database = aerodb.make_database(
        leaves, title="trainer", aircraft="trainer", **sizes, **place, force_axes="stability"
    )
    aerodb.exchange.export_jsbsim(database, folder / "trainer.xml", craft)
    run = subprocess.run(
        [sys.executable, "-c", WRITTEN, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    printed = {row.split()[0]: row.split()[1:] for row in run.stdout.splitlines() if row.strip()}
    # The thrust has no arm and no P-factor: pitch and yaw have the moment -omega x H alone, with the
    # rates one frame later.
    rpm, q, r, pitching, yawing = map(float, printed["TURNING"])
    momentum = blades.inertia * rpm * np.pi / 30.0
    unit = FOOT * POUND_FORCE
    assert rpm > 500.0
    assert pitching * unit == pytest.approx(-r * momentum, rel=0.05)
    assert yawing * unit == pytest.approx(q * momentum, rel=0.05)

    rpm, power, thrust, advance, rho, weight = map(float, printed["WRITTEN"])
    assert rpm > 1500.0
    assert power > 50.0
    n = rpm / 60.0
    CT = float(blades.tables["CT_prop"]["value"].interp(J=advance))
    expected = CT * rho * SLUGS * n**2 * blades.diameter**4
    # the factor of the tip Mach number may take some per cent
    assert thrust * POUND_FORCE == pytest.approx(expected, rel=0.06)
    assert weight * 0.45359237 == pytest.approx(1000.0, rel=1e-3)
