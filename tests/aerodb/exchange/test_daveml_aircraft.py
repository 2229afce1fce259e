"""Mass properties and thrust of DAVE-ML files as an aircraft; the F-16 of the check cases flies
with it in tests/published.
"""

import numpy as np
import pytest
import xarray as xr

import aerodb
from flightmech.errors import SchemaError, UnknownName
from flightmech.terms import evaluate_term
from flightmech.units import FOOT, POUND_FORCE, SLUG

INERTIA = """
<variableDef name="vrsPositionOfCM" varID="CG" units="pct" initialValue="35.0"><isInput/>
</variableDef>
<variableDef name="totalMass" varID="M" units="slug" initialValue="100.0"><isOutput/></variableDef>
<variableDef name="bodyMomentOfInertia_Roll" varID="IX" units="slugft2" initialValue="1000.0">
<isOutput/></variableDef>
<variableDef name="bodyMomentOfInertia_Pitch" varID="IY" units="slugft2" initialValue="2000.0">
<isOutput/></variableDef>
<variableDef name="bodyMomentOfInertia_Yaw" varID="IZ" units="slugft2" initialValue="2500.0">
<isOutput/></variableDef>
<variableDef name="bodyProductOfInertia_ZX" varID="IXZ" units="slugft2" initialValue="50.0">
<isOutput/></variableDef>
<variableDef name="bodyPositionOfCmWrtMrc_X" varID="DX" units="ft" sign="FWD"><calculation><math>
<apply><times/><cn>0.1</cn>
<apply><minus/><cn>35</cn><ci>CG</ci></apply></apply></math></calculation><isOutput/></variableDef>
<variableDef name="bodyPositionOfCmWrtMrc_Z" varID="DZ" units="ft" sign="UP" initialValue="0.5">
<isOutput/></variableDef>
"""
# idle and full thrust over height, joined by the lever in per cent
THRUST = """
<variableDef name="powerLeverAngle" varID="PWR" units="pct"><isInput/></variableDef>
<variableDef name="altitudeMSL" varID="ALT" units="ft"><isInput/></variableDef>
<variableDef name="idle" varID="IDLE" units="lbf"/>
<variableDef name="full" varID="FULL" units="lbf"/>
<variableDef name="thrustBodyForce_X" varID="FX" units="lbf" sign="FWD">
<calculation><math>FORCE</math></calculation><isOutput/></variableDef>
<variableDef name="thrustBodyForce_Z" varID="FZ" units="lbf" sign="DWN" initialValue="SIDE">
<isOutput/></variableDef>
<function name="IDLE"><independentVarPts varID="ALT">0 20000</independentVarPts>
<dependentVarPts varID="IDLE">100 50</dependentVarPts></function>
<function name="FULL"><independentVarPts varID="ALT">0 10000 40000</independentVarPts>
<dependentVarPts varID="FULL">1000 800 200</dependentVarPts></function>
"""
LINEAR = """<apply><plus/><ci>IDLE</ci><apply><times/><apply><divide/><ci>PWR</ci><cn>100</cn>
</apply>
<apply><minus/><ci>FULL</ci><ci>IDLE</ci></apply></apply></apply>"""
SQUARE = "<apply><times/><ci>FULL</ci><ci>PWR</ci><ci>PWR</ci></apply>"


@pytest.fixture
def file(tmp_path):
    def write(name, content):
        head = (
            '<?xml version="1.0"?><DAVEfunc><fileHeader><author name="us" '
            'org="us"/><fileCreationDate date="2020-01-01"/></fileHeader>'
        )
        path = tmp_path / name
        path.write_text(f"{head}{content}</DAVEfunc>")
        return path

    return write


@pytest.fixture
def db():
    tree = xr.DataTree()
    tree.attrs.update(title="ours", S=20.0, cbar=2.0, b=8.0, x_ref=-1.0, y_ref=0.0, z_ref=0.0)
    return tree


def test_mass_properties(db, file):
    craft = aerodb.exchange.import_daveml_aircraft(
        db, file("inertia.dml", INERTIA), inputs={"vrsPositionOfCM": 25.0}
    )
    assert (craft.name, craft.S, craft.cbar, craft.b, craft.reference, craft.engines) == (
        "ours",
        20.0,
        2.0,
        8.0,
        (-1.0, 0.0, 0.0),
        (),
    )
    assert craft.mass == pytest.approx(100.0 * SLUG)
    moments = (craft.Ixx, craft.Iyy, craft.Izz, craft.Ixz, craft.Ixy)
    assert moments == pytest.approx(np.array([1000.0, 2000.0, 2500.0, 50.0, 0.0]) * SLUG * FOOT**2)
    assert craft.cg == pytest.approx(
        (1.0 * FOOT, 0.0, -0.5 * FOOT)
    )  # 10 per cent forward; the file counts z upwards


def test_inputs_keep_the_initial_value_of_the_file(db, file):
    assert aerodb.exchange.import_daveml_aircraft(db, file("inertia.dml", INERTIA)).cg[0] == 0.0


def test_thrust_over_lever_and_height(db, file):
    propulsion = file("thrust.dml", THRUST.replace("FORCE", LINEAR).replace("SIDE", "0"))
    (engine,) = aerodb.exchange.import_daveml_aircraft(
        db, file("inertia.dml", INERTIA), propulsion
    ).engines
    assert engine.thrust["throttle"].values.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(engine.thrust["h"], np.array([0.0, 10e3, 20e3, 40e3]) * FOOT)
    # a quarter of the lever at 15 000 ft: idle 62.5, full 700 lbf
    thrust = evaluate_term(engine.thrust, {"throttle": 0.25, "h": 15000.0 * FOOT})
    assert float(thrust) == pytest.approx((62.5 + 0.25 * (700.0 - 62.5)) * POUND_FORCE, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "FORCE",
            SQUARE,
            "FX is not linear in throttle, h between breakpoints: a table is up to .* N off",
        ),
        (
            "SIDE",
            "3",
            "FZ are not zero; give position and direction of the engines in the aircraft file",
        ),
        ("altitudeMSL", "fuelFlow", r"the input ALT \(fuelFlow\) is none of throttle, mach, h"),
        (
            'name="thrustBodyForce_X"',
            'name="push"',
            "0 outputs are thrustBodyForce_X; one is needed",
        ),
    ],
)
def test_thrust_that_is_no_table_is_refused(old, new, message, db, file):
    content = THRUST.replace(old, new).replace("FORCE", LINEAR).replace("SIDE", "0")
    with pytest.raises(SchemaError, match=message):
        aerodb.exchange.import_daveml_aircraft(
            db, file("inertia.dml", INERTIA), file("thrust.dml", content)
        )


def test_what_an_inertia_file_lacks_is_reported(db, file):
    lacking = file(
        "inertia.dml",
        INERTIA.replace("totalMass", "grossWeight").replace(' initialValue="35.0"', ""),
    )
    with pytest.raises(
        SchemaError,
        match=r"the input CG \(vrsPositionOfCM\) has no initial value(.|\n)*no output is mass",
    ):
        aerodb.exchange.import_daveml_aircraft(db, lacking)
    with pytest.raises(UnknownName, match="unknown variable 'CG_PCT'"):
        aerodb.exchange.import_daveml_aircraft(
            db, file("inertia.dml", INERTIA), inputs={"CG_PCT": 25.0}
        )
