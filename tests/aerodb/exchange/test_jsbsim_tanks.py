"""Tanks and feeds of JSBSim aircraft files, read, written and flown by JSBSim."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import aerodb
import flightmech
from flightmech.aircraft.engine import Engine
from flightmech.aircraft.fuel import Fuel
from flightmech.aircraft.propulsion.fuel_transfer import Transfer
from flightmech.aircraft.propulsion.tank import Tank
from flightmech.errors import AeromatchWarning, SchemaError
from flightmech.terms import make_term
from flightmech.units import FOOT, POUND, SLUG

jsbsim = pytest.importorskip("jsbsim", reason="the wheel jsbsim is not installed")
AIRCRAFT = Path(jsbsim.__file__).parent / "aircraft"


@pytest.fixture(scope="module")
def cessna() -> flightmech.Aircraft:
    return aerodb.exchange.import_jsbsim_aircraft(AIRCRAFT / "c172p" / "c172p.xml")


def database(craft: flightmech.Aircraft):
    leaves = {
        "CL/basic": make_term([-0.6, 1.4], {"alpha": [-0.2, 0.2]}),
        "CD/basic": make_term(0.035),
        "Cm/basic": make_term([0.2, -0.2], {"alpha": [-0.2, 0.2]}),
        "Cm/pitch_rate": make_term(-12.0, regressors=["qhat"]),
    }
    sizes = {name: getattr(craft, name) for name in ("S", "cbar", "b")}
    place = dict(zip(("x_ref", "y_ref", "z_ref"), craft.reference, strict=True))
    return aerodb.make_database(
        leaves, title="c", aircraft="c", **sizes, **place, force_axes="stability"
    )


def test_tanks_of_the_cessna_172p(cessna):
    """Two tanks of 185 lb with 100 lb each, 112 in from the plane of symmetry."""
    left, right = cessna.fuel.tanks
    assert (left.name, right.name) == ("tank0", "tank1")
    assert left.content == right.content == pytest.approx(100.0 * POUND)
    assert left.capacity == pytest.approx(185.0 * POUND)
    arms = np.array([left.position, right.position]) + np.array(cessna.reference)
    np.testing.assert_allclose(arms, np.array([[-56, -112, -59.4], [-56, 112, -59.4]]) * 0.0254)
    assert cessna.engines[0].feed == ("tank0", "tank1")
    assert cessna.fuel.mass == pytest.approx(200.0 * POUND)
    assert "state.tank.tank0.fuel" in [
        row.name for row in flightmech.compile(cessna, database(cessna)).entries(3)
    ]


def test_the_piston_engine_burns_what_its_tanks_lose(cessna):
    """Equal tanks give equal parts; their sum is the integral of the fuel flow."""
    sim = flightmech.compile(cessna, database(cessna))
    start = {"init.V": 50.0, "init.h": 500.0, "mode.engine": 0.0, "engine1.throttle": 1.0}
    time = np.linspace(0.0, 2.0, 201)
    record = xr.Dataset(coords={"time": time})
    flown = flightmech.simulate(sim, record, start)
    lost = 100.0 * POUND - flown["tank.tank0.fuel"].values
    np.testing.assert_allclose(lost, 100.0 * POUND - flown["tank.tank1.fuel"].values, rtol=1e-12)
    burnt = np.trapezoid(flown["engine1.fuel_flow"].values, time)
    assert 2.0 * lost[-1] == pytest.approx(burnt, rel=1e-6)
    assert burnt > 0.005
    dry = flightmech.simulate(sim, record, start | {f"tank.tank{k}.cutoff": 1.0 for k in (0, 1)})
    assert float(dry["engine1.burning"][-1]) < 0.1


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("<feed>1</feed>", "<feed>7</feed>", "engine 1 is fed from tank 7 of 2"),
        ("<feed>0</feed>\n            <feed>1</feed>", "", "engine 1 has no <feed>"),
        ('<contents unit="LBS"> 100 </contents>', "", "tank 0 has no <contents>"),
        ("> 100 </contents>", "> 0 </contents>", "the tanks are empty"),
        ("> 100 </contents>", "> 9 </contents><priority>0</priority>", "tank 0 is not selected, "),
    ],
)
def test_fuel_that_is_not_read_stays_a_mass(tmp_path, old, new, reason):
    text = (AIRCRAFT / "c172p" / "c172p.xml").read_text()
    assert old in text
    for folder in (tmp_path / "engine", tmp_path / "aircraft" / "c"):
        folder.mkdir(parents=True)
    for name in ("eng_io320.xml", "prop_75in2f.xml"):
        file = AIRCRAFT.parent / "engine" / name
        (tmp_path / "engine" / name).write_bytes(file.read_bytes())
    path = tmp_path / "aircraft" / "c" / "c.xml"
    path.write_text(text.replace(old, new))
    craft = aerodb.exchange.import_jsbsim_aircraft(path)
    assert craft.fuel is None
    assert craft.engines[0].feed == ()
    assert f"fuel is a mass that stays: {reason}" in craft.history


def loaded(cessna: flightmech.Aircraft) -> flightmech.Aircraft:
    """The Cessna with unequal tanks, of which the right one is emptied first."""
    tanks = (
        Tank((0.1, -2.8, -0.4), 80.0, 3, "left", 60.0),
        Tank((0.1, 2.8, -0.4), 80.0, 1, "right", 2.0),
    )
    engine = replace(cessna.engines[0], feed=("left", "right"))
    return replace(cessna, engines=(engine,), fuel=Fuel(62.0, tanks=tanks))


def test_written_tanks_are_read_again(cessna, tmp_path):
    """Mass, c.g. and inertia are split between the empty aircraft and its tanks, and added
    again.
    """
    craft = loaded(cessna)
    path = tmp_path / "c.xml"
    aerodb.exchange.export_jsbsim(database(craft), path, craft)
    again = aerodb.exchange.import_jsbsim_aircraft(path)
    for name in ("mass", "Ixx", "Iyy", "Izz", "Ixz"):
        assert getattr(again, name) == pytest.approx(getattr(craft, name), rel=1e-9), name
    np.testing.assert_allclose(again.cg, craft.cg, atol=1e-12)
    assert (again.Ixy, again.Iyz) == pytest.approx((craft.Ixy, craft.Iyz), abs=1e-6)
    assert again.engines[0].feed == ("tank0", "tank1")
    for tank, before in zip(again.fuel.tanks, craft.fuel.tanks, strict=True):
        assert tank.position == pytest.approx(before.position, abs=1e-12)
        assert (tank.capacity, tank.content) == pytest.approx((before.capacity, before.content))
    assert [tank.order for tank in again.fuel.tanks] == [2, 1]


def pumped(cessna: flightmech.Aircraft) -> flightmech.Aircraft:
    """The Cessna with a third tank, which feeds no engine and is pumped into the others."""
    craft = loaded(cessna)
    tip = Tank((0.0, -4.0, -0.5), 30.0, 1, "tip", 20.0)
    pumps = (
        Transfer("tip", "left", rate=0.1, fill=80.0, band=0.5, leave=2.0, on=True),
        Transfer("left", "right", rate=1.5, fill=6.0, band=3.0),
    )
    tanks = (*craft.fuel.tanks, tip)
    return replace(craft, fuel=Fuel(82.0, tanks=tanks, transfers=pumps))


def test_written_pumps_are_read_again(cessna, tmp_path):
    craft = pumped(cessna)
    path = tmp_path / "c.xml"
    aerodb.exchange.export_jsbsim(database(craft), path, craft)
    again = aerodb.exchange.import_jsbsim_aircraft(path)
    assert [tank.name for tank in again.fuel.tanks] == ["tank0", "tank1", "tank2"]
    assert [pump.item for pump in again.fuel.transfers] == ["tank2.tank0", "tank0.tank1"]
    for pump, before in zip(again.fuel.transfers, craft.fuel.transfers, strict=True):
        for name in ("rate", "fill", "band", "leave"):
            assert getattr(pump, name) == pytest.approx(getattr(before, name), rel=1e-12), name
        assert pump.on == before.on
    assert "is not read, so that no fuel is pumped" not in again.history


def test_a_flow_of_another_form_is_remarked(cessna, tmp_path):
    """A pump without its float valve would fill a tank beyond its capacity: it is not read."""
    craft = pumped(cessna)
    path = tmp_path / "c.xml"
    aerodb.exchange.export_jsbsim(database(craft), path, craft)
    path.write_text(path.read_text().replace("<max>", "<sum>").replace("</max>", "</sum>"))
    again = aerodb.exchange.import_jsbsim_aircraft(path)
    assert again.fuel.transfers == ()
    assert "the function of propulsion/tank[0]/external-flow-rate-pps is not read" in again.history


def test_tanks_of_engines_without_propellers_are_named(cessna, tmp_path):
    craft = loaded(cessna)
    jet = replace(craft, engines=(Engine((0.0, 0.0, 0.0), feed=("left", "right")),))
    with pytest.warns(AeromatchWarning, match="tanks left, right: .* not written; write an FMU"):
        aerodb.exchange.export_jsbsim(database(jet), tmp_path / "c.xml", jet)


def test_a_crossfeed_is_refused_with_the_way_out(cessna, tmp_path):
    craft = loaded(cessna)
    engine = replace(craft.engines[0], feed=("left",), crossfeed=("right",))
    craft = replace(craft, engines=(engine,))
    with pytest.raises(SchemaError, match="engine 1: the cross-feed from right has no form in JSB"):
        aerodb.exchange.export_jsbsim(database(craft), tmp_path / "c.xml", craft)


PUMPED = """
import json, jsbsim, sys
f = jsbsim.FGFDMExec(None)
f.set_debug_level(0)
f.set_aircraft_path(sys.argv[1])
f.load_model("c")
f.set_dt(0.005)
f["ic/h-sl-ft"], f["ic/vc-kts"] = 3000, 95
f.run_ic()
names = [f"propulsion/tank[{k}]/contents-lbs" for k in range(2)]
found = []
for k in range(1600):
    f["fcs/transfer-left-right-on"] = 0 if k < 400 else 1
    f.run()
    found.append([f["simulation/sim-time-sec"], *(f[name] for name in names)])
print("FLIGHT" + json.dumps(found))
"""


def test_jsbsim_moves_fuel_as_the_pump_does(cessna, tmp_path):
    """The engine is off; JSBSim's steps against the exponential of the float valve, and the sum."""
    pump = Transfer("left", "right", rate=1.5, fill=6.0, band=3.0)
    craft = loaded(cessna)
    craft = replace(craft, fuel=replace(craft.fuel, transfers=(pump,)))
    folder = tmp_path / "c"
    folder.mkdir()
    aerodb.exchange.export_jsbsim(database(craft), folder / "c.xml", craft)
    run = subprocess.run(
        [sys.executable, "-c", PUMPED, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    line = next(row for row in run.stdout.splitlines() if row.startswith("FLIGHT"))
    _, left, right = np.array(json.loads(line.removeprefix("FLIGHT"))).T
    right *= POUND
    np.testing.assert_allclose(left * POUND + right, 62.0, rtol=1e-12)
    assert np.all(right[:399] == right[0])
    # Euler's rule, as JSBSim has it: full flow from 2 to 3 kg, then the valve shuts over 3 kg
    steps = np.arange(right.size - 400)
    exact = np.empty(steps.size)
    held = 2.0
    for step in steps:
        held += 0.005 * 1.5 * min(1.0, (6.0 - held) / 3.0)
        exact[step] = held
    np.testing.assert_allclose(right[400:], exact, rtol=1e-6)
    assert right[-1] > 5.4


FLIGHT = """
import json, jsbsim, sys
f = jsbsim.FGFDMExec(None)
f.set_debug_level(0)
f.set_aircraft_path(sys.argv[1])
f.load_model("c")
f["ic/h-sl-ft"], f["ic/vc-kts"] = 3000, 95
f.run_ic()
names = {"left": "propulsion/tank[0]/contents-lbs", "right": "propulsion/tank[1]/contents-lbs",
         "mass": "inertia/mass-slugs", "y": "inertia/cg-y-in", "Ixx": "inertia/ixx-slugs_ft2"}
start = {name: f[key] for name, key in names.items()}
f["propulsion/set-running"] = -1
f["fcs/throttle-cmd-norm"], f["fcs/mixture-cmd-norm"] = 1.0, 1.0
while f["simulation/sim-time-sec"] < 900.0 and f[names["right"]] > 0.0:
    f.run()
first = {name: f[key] for name, key in names.items()}
for k in range(600):
    f.run()
last = {name: f[key] for name, key in names.items()}
print("FLIGHT" + json.dumps([start, first, last]))
"""


@pytest.mark.slow
def test_jsbsim_empties_the_written_tanks_in_their_order(cessna, tmp_path):
    """Mass and c.g. of JSBSim are ours; its right tank is emptied before the left one."""
    craft = loaded(cessna)
    folder = tmp_path / "c"
    folder.mkdir()
    aerodb.exchange.export_jsbsim(database(craft), folder / "c.xml", craft)
    run = subprocess.run(
        [sys.executable, "-c", FLIGHT, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    line = next(row for row in run.stdout.splitlines() if row.startswith("FLIGHT"))
    start, first, last = json.loads(line.removeprefix("FLIGHT"))
    assert start["mass"] * SLUG == pytest.approx(craft.mass, rel=1e-6)
    assert start["Ixx"] * SLUG * FOOT**2 == pytest.approx(craft.Ixx, rel=1e-6)
    wanted = craft.cg[1] + craft.reference[1]
    assert start["y"] * 0.0254 == pytest.approx(wanted, abs=1e-5)
    assert (start["left"] * POUND, start["right"] * POUND) == pytest.approx((60.0, 2.0), rel=1e-6)
    assert first["right"] == 0.0
    assert first["left"] == pytest.approx(start["left"], abs=0.01)
    assert last["left"] < first["left"]
