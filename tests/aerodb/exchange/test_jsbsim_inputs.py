"""Properties of a JSBSim file outside the vocabulary: names of the caller, further inputs,
constants, and properties that are functions of others.
"""

import warnings

import numpy as np
import pytest

import aerodb
import flightmech
from flightmech.errors import AeromatchWarning, SchemaError, UnknownName
from flightmech.units import DEGREE, FOOT, POUND, POUND_FORCE, SLUG

METRICS = """<metrics><wingarea unit="FT2">200</wingarea><wingspan unit="FT">30</wingspan>
<wing_incidence unit="DEG">2</wing_incidence><chord unit="FT">5</chord>
<location name="AERORP" unit="IN"><x>100</x><y>0</y><z>0</z></location>
<location name="EYEPOINT" unit="IN"><x>0</x><y>0</y><z>0</z></location>
<location name="VRP" unit="IN"><x>0</x><y>0</y><z>0</z></location></metrics>"""
BALANCE = """<mass_balance>{empty}<pointmass name="a"><form shape="{shape}">
<radius unit="FT">2</radius>
<length unit="FT">9</length></form><weight unit="LBS">400</weight>
<location unit="IN"><x>90</x><y>10</y><z>20</z></location></pointmass>
<location name="CG" unit="IN"><x>100</x><y>0</y><z>0</z></location></mass_balance>"""
EMPTY = """<ixx unit="SLUG*FT2">900</ixx><iyy unit="SLUG*FT2">1200</iyy>
<izz unit="SLUG*FT2">1900</izz>
<emptywt unit="LBS">2000</emptywt>"""
FORCE = "<p>aero/qbar-psf</p><p>metrics/Sw-sqft</p>"
LINE = (
    "<table><independentVar>{}</independentVar><tableData>\n-1 -2\n0 1\n1 3\n</tableData></table>"
)
GRAIN = """<propulsion><tank type="FUEL"><location unit="IN"><x>80</x><y>0</y><z>5</z></location>
<radius unit="FT">1.5</radius><grain_config type="{}"><length unit="FT">7</length>
<bore_diameter unit="FT">1</bore_diameter></grain_config><capacity unit="LBS">500</capacity>
<contents unit="LBS">300</contents></tank></propulsion>"""


BALL = BALANCE.format(empty=EMPTY, shape="ball")


def write_file(folder, lift, *, more="", balance=BALL, rest=""):
    """Return a JSBSim file with one lift function, a product of qbar, S and `lift`."""
    path = folder / "aircraft" / "some" / "some.xml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f"<fdm_config name='some' version='2.0'>{METRICS}{balance}<ground_reactions/>{rest}"
        f"<flight_control name='f'/><aerodynamics>{more}<axis name='LIFT'><function name='f/lift'>"
        f"<product>{FORCE}{lift}</product></function></axis></aerodynamics></fdm_config>"
    )
    return path


def lift_of(db, **conditions):
    return float(aerodb.evaluate(db, "CL", outside="clamp", **conditions))


def start_jsbsim(folder, **initial):
    jsbsim = pytest.importorskip("jsbsim", reason="jsbsim is not installed: pip install jsbsim")
    program = jsbsim.FGFDMExec(str(folder))
    program.set_debug_level(0)
    assert program.load_model("some")
    for name, value in initial.items():
        program[f"ic/{name}"] = value
    program.run_ic()
    return program


def test_names_of_the_caller(tmp_path):
    """A control with a name of its own, in degrees and with the other sign."""
    path = write_file(tmp_path, "<v>2</v><p>fcs/posElev</p>")
    for text, expected in (("delta_e [rad]", 0.2), ("-delta_e [deg]", -0.2 / DEGREE)):
        db = aerodb.exchange.import_jsbsim(path, names={"fcs/posElev": text})
        assert aerodb.terms(db)["CL/lift"].attrs["regressors"] == "delta_e"
        assert lift_of(db, delta_e=0.1) == pytest.approx(expected, rel=1e-14)
    axis = write_file(tmp_path, LINE.format("fcs/posElev_deg"))
    db = aerodb.exchange.import_jsbsim(axis, names={"fcs/posElev_deg": "-delta_e"})
    assert lift_of(db, delta_e=0.5 * DEGREE) == pytest.approx(-0.5, rel=1e-12)


def test_names_that_are_refused(tmp_path):
    path = write_file(tmp_path, "<p>fcs/posElev</p>")
    read = aerodb.exchange.import_jsbsim
    with pytest.raises(SchemaError, match=r"in which unit\? write delta_e \[rad\] or \[deg\]"):
        read(path, names={"fcs/posElev": "delta_e"})
    with pytest.raises(SchemaError, match="unit 'ft', where delta_e needs one such as rad"):
        read(path, names={"fcs/posElev": "delta_e [ft]"})
    with pytest.raises(UnknownName, match="unknown property 'fcs/posElevator'"):
        read(path, names={"fcs/posElevator": "delta_e [rad]"})
    with pytest.raises(UnknownName, match="unknown quantity 'delta_x'"):
        read(path, names={"fcs/posElev": "delta_x [rad]"})


def test_controls_and_systems_are_inputs(tmp_path):
    """A fraction, an angle in degrees and the stall; the database flies with them."""
    lift = (
        f"<sum>{LINE.format('fcs/spoiler-pos-norm')}<p>systems/canard-deg</p>"
        "<p>aero/stall-hyst-norm</p></sum>"
    )
    path = write_file(tmp_path, lift)
    with pytest.warns(
        AeromatchWarning, match="became inputs, which are 0 unless they are set"
    ) as seen:
        db = aerodb.exchange.import_jsbsim(path)
    spoiler, canard, stall = (
        "device.fcs_spoiler_pos_norm.setting",
        "device.systems_canard_deg.deflection",
        "device.aero_stall_hyst_norm.setting",
    )
    for name in (spoiler, canard, stall):
        assert name in str(seen[0].message)
        assert name in db.attrs["comment"]
    at = {spoiler: 0.5, canard: 3 * DEGREE, stall: 0.25}
    assert lift_of(db, **at) == pytest.approx(2.0 + 3.0 + 0.25, rel=1e-14)
    sim = flightmech.compile(aerodb.exchange.import_jsbsim_aircraft(path), db)
    assert len(sim.terms) == 3


def test_a_control_as_angle_and_as_fraction(tmp_path):
    """Two properties that JSBSim does not tie to each other; the travel makes them one control."""
    path = write_file(
        tmp_path, "<sum><p>fcs/elevator-pos-rad</p><p>fcs/elevator-pos-norm</p></sum>"
    )
    with pytest.warns(AeromatchWarning, match="without it each moves on its own, as in JSBSim"):
        db = aerodb.exchange.import_jsbsim(path)
    fraction = "device.fcs_elevator_pos_norm.setting"
    assert lift_of(db, delta_e=0.1, **{fraction: 0.5}) == pytest.approx(0.6, rel=1e-14)
    db = aerodb.exchange.import_jsbsim(path, travel={"delta_e": 0.4})
    assert lift_of(db, delta_e=0.1) == pytest.approx(0.1 + 0.25, rel=1e-14)
    path = write_file(tmp_path, "<abs><p>fcs/elevator-pos-norm</p></abs>")
    with pytest.warns(AeromatchWarning, match="fcs/elevator-pos-norm is device"):
        db = aerodb.exchange.import_jsbsim(path)
    assert lift_of(db, **{fraction: -0.5}) == pytest.approx(0.5, rel=1e-14)


def test_inputs_whose_names_are_equal(tmp_path):
    path = write_file(tmp_path, "<sum><p>fcs/a-norm</p><p>fcs/a_norm</p></sum>")
    with pytest.raises(SchemaError, match=r"would both be device\.fcs_a_norm\.setting; name one"):
        aerodb.exchange.import_jsbsim(path)


def test_functions_defined_twice(tmp_path):
    more = "<function name='f/k'><v>2</v></function><function name='f/k'><v>3</v></function>"
    path = write_file(tmp_path, "<p>f/k</p>", more=more)
    with pytest.warns(AeromatchWarning, match="f/k is defined twice, in lines .*; JSBSim refuses"):
        db = aerodb.exchange.import_jsbsim(path)
    assert lift_of(db) == 3.0


def test_constants_that_a_file_declares(tmp_path):
    """A declared property of the flight is a number; one that a function sets is that function."""
    more = "<property value='7.5'>aero/setup/k</property>"
    assert lift_of(
        aerodb.exchange.import_jsbsim(write_file(tmp_path, "<p>aero/setup/k</p>", more=more))
    ) == pytest.approx(7.5)
    function = "<function name='aero/setup/k'><p>aero/alpha-rad</p></function>"
    path = write_file(tmp_path, "<p>aero/setup/k</p>", more=more + function)
    assert lift_of(aerodb.exchange.import_jsbsim(path), alpha=0.2) == pytest.approx(0.2)


EXACT = (
    "<p>aero/alpha-wing-rad</p>",
    LINE.format("aero/alpha-wing-rad"),
    LINE.format("f/angle"),
    LINE.format("metrics/iw-rad"),
    "<p>atmosphere/rho-slugs_ft3</p><p>velocities/vt-fps</p><p>velocities/vt-fps</p>"
    "<quotient><v>0.5</v><p>aero/qbar-psf</p></quotient>",
    "<quotient><v>9</v><p>velocities/vt-fps</p></quotient>",
)
SAMPLED = (
    "<quotient><p>aero/qbarUW-psf</p><p>aero/qbar-psf</p></quotient>",
    "<quotient><p>velocities/u-aero-fps</p><p>velocities/vt-fps</p></quotient>",
    "<quotient><p>velocities/v-aero-fps</p><p>velocities/vt-fps</p></quotient>",
    "<quotient><p>velocities/w-aero-fps</p><p>velocities/vt-fps</p></quotient>",
    LINE.format("f/product").replace("-1 -2\n0 1\n1 3", "-9 -18\n9 18"),
)


@pytest.mark.parametrize("lift", [*EXACT, *SAMPLED])
def test_properties_that_are_functions_of_others(lift, tmp_path):
    """The lift is that of JSBSim: exactly, or with functions on tables within the bound."""
    more = (
        "<function name='f/angle'><sum><p>aero/alpha-rad</p><p>metrics/iw-rad</p></sum></function>"
        "<function name='f/product'><product><p>aero/alpha-rad</p><p>aero/beta-rad</p><v>9</v>"
        "</product></function>"
    )
    path = write_file(tmp_path, lift, more=more)
    box = {"alpha": (-0.5, 0.5), "beta": (-0.5, 0.5)}
    sampling = {"sample": 1e-4, "box": box} if lift in SAMPLED else {}
    db = aerodb.exchange.import_jsbsim(path, **sampling)
    program = start_jsbsim(
        tmp_path, **{"vt-fps": 300.0, "alpha-rad": 0.11, "beta-rad": 0.07, "h-sl-ft": 3000.0}
    )
    at = {
        "alpha": program["aero/alpha-rad"],
        "beta": program["aero/beta-rad"],
        "V": program["velocities/vt-fps"] * FOOT,
        "qbar": program["aero/qbar-psf"] * POUND_FORCE / FOOT**2,
    }
    expected = program["f/lift"] / (program["aero/qbar-psf"] * 200.0)
    assert lift_of(db, **at) == pytest.approx(expected, rel=1e-12, abs=1e-4 if sampling else 0.0)


@pytest.mark.parametrize("shape", ["ball", "sphere", "cylinder", "tube"])
@pytest.mark.parametrize("empty", [EMPTY, ""])
def test_mass_of_bodies_is_that_of_jsbsim(shape, empty, tmp_path):
    """Point masses with an extent, solid propellant, and an aircraft that is these only."""
    balance = BALANCE.format(empty=empty, shape=shape)
    path = write_file(tmp_path, "<v>1</v>", balance=balance, rest=GRAIN.format("CYLINDRICAL"))
    craft, program = aerodb.exchange.import_jsbsim_aircraft(path), start_jsbsim(tmp_path)
    assert craft.mass == pytest.approx(program["inertia/weight-lbs"] * POUND, rel=1e-12)
    for name in ("Ixx", "Iyy", "Izz"):
        inertia = program[f"inertia/{name.lower()}-slugs_ft2"] * SLUG * FOOT**2
        assert getattr(craft, name) == pytest.approx(inertia, rel=1e-7)  # its pounds per slug


def test_a_propellant_of_another_shape_is_refused(tmp_path):
    path = write_file(tmp_path, "<v>1</v>", rest=GRAIN.format("ENDBURNING"))
    with pytest.raises(flightmech.errors.ParseError, match="the type CYLINDRICAL"):
        aerodb.exchange.import_jsbsim_aircraft(path)


def test_a_moment_in_another_spelling_of_its_unit(tmp_path):
    """JSBSim does not look at the unit of an axis: pound-feet in any case."""
    roll = "<axis name='ROLL' unit='LBS*FT'><function name='f/r'><v>7</v></function></axis>"
    path = write_file(tmp_path, "<v>1</v>", more=roll)
    program = start_jsbsim(tmp_path, **{"vt-fps": 300.0})
    db = aerodb.exchange.import_jsbsim(path)
    qbar = program["aero/qbar-psf"] * POUND_FORCE / FOOT**2
    moment = float(aerodb.evaluate(db, "Cl", qbar=qbar)) * qbar * db.attrs["S"] * db.attrs["b"]
    assert program["f/r"] == 7.0
    assert moment == pytest.approx(7.0 * POUND_FORCE * FOOT, rel=1e-12)


def test_many_products(tmp_path):
    """More than 64 products, all of them terms whose sum is the function."""
    lift = "<sum><v>1</v><p>aero/beta-rad</p></sum><sum><v>2</v><p>aero/alpha-rad</p></sum>"
    many = "".join(f"<v>{i}.5</v>" for i in range(40))
    path = write_file(tmp_path, f"{lift}<sum>{many}</sum>")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        db = aerodb.exchange.import_jsbsim(path)
    assert len(aerodb.terms(db)) == 160
    expected = 1.3 * 2.1 * np.sum(np.arange(40) + 0.5)
    assert lift_of(db, alpha=0.1, beta=0.3) == pytest.approx(expected, rel=1e-12)
