"""The generated model description: units, names, both standards' schemas."""

from __future__ import annotations

import io
import math
import zipfile

import pytest
from fmpy import read_model_description

from flightmech.errors import SchemaError
from flightmech.fmu_export.description import Description, FmuVariable, to_c_identifier
from flightmech.fmu_export.model_description import base_units, render_model_description

VARIABLES = (
    FmuVariable("delta_e", "input", 1000, "rad", "deg", "elevator deflection", 0.0, -0.3, 0.2),
    FmuVariable("V", "output", 10000, "m s-1", "kt", "true airspeed"),
    FmuVariable("temperature", "output", 10001, "K", "degC", "ambient temperature"),
    FmuVariable(
        "init.V", "parameter", 100000, "m s-1", "kt", "true airspeed at the start", 80.0, fixed=True
    ),
    FmuVariable("mode.trim", "parameter", 100001, "1", "1", "trim at the start", 1.0, fixed=True),
    FmuVariable(
        "term.CL.gear", "parameter", 100002, "1", "1", "scale <of> the \"term\" & 'more'", 1.0
    ),
)
DESCRIPTION = Description("T-37 & co", "T_37_co", "0" * 64, "aeromatch", 0.01, VARIABLES)


def described(version: str):
    """Read the XML back through FMPy, which checks it against the schema of the standard."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as zf:
        zf.writestr("modelDescription.xml", render_model_description(DESCRIPTION, version))
    return read_model_description(
        archive, validate=True, validate_variable_names=True, validate_model_structure=True
    )


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2.0", "3.0"])
def test_the_standard_reads_back_what_was_written(version):
    model = described(version)
    found = {v.name: v for v in model.modelVariables}
    assert model.modelName == "T-37 & co"
    assert model.guid == "0" * 64
    assert [found[v.name].valueReference for v in VARIABLES] == [v.reference for v in VARIABLES]
    assert [found[v.name].description.split("; 0 ")[0] for v in VARIABLES] == [
        v.description for v in VARIABLES
    ]
    elevator = found["delta_e"]
    assert (elevator.causality, elevator.variability, elevator.unit, elevator.displayUnit) == (
        "input",
        "continuous",
        "rad",
        "deg",
    )
    assert (float(elevator.min), float(elevator.max), float(elevator.start)) == (-0.3, 0.2, 0.0)
    assert (found["init.V"].variability, found["term.CL.gear"].variability) == ("fixed", "tunable")
    assert (found["mode.trim"].type, int(found["mode.trim"].start)) == (
        "Integer" if version == "2.0" else "Enumeration",
        1,
    )
    if version == "2.0":
        assert found["mode.trim"].description.endswith(
            "0 none, 1 trim_thrust, 2 trim_throttle, 3 stand_on_ground"
        )
    assert model.coSimulation.canGetAndSetFMUstate
    assert model.coSimulation.canInterpolateInputs == (version == "2.0")


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2.0", "3.0"])
@pytest.mark.parametrize(
    ("unit", "display", "si", "shown"),
    [("rad", "deg", math.pi, 180.0), ("m s-1", "kt", 92.6, 180.0), ("K", "degC", 288.15, 15.0)],
)
def test_display_units_follow_the_rule_of_the_standard(version, unit, display, si, shown):
    units = {u.name: u for u in described(version).unitDefinitions}
    found = next(d for d in units[unit].displayUnits if d.name == display)
    # display = factor * SI + offset, FMI 2.0 section 2.2.2; factors are rounded once, so 4 ulp
    assert float(found.factor) * si + float(found.offset) == pytest.approx(
        shown, rel=1e-15, abs=1e-13
    )


@pytest.mark.parametrize(
    ("units", "expected"),
    [
        ("1", {}),
        ("rad s-2", {"rad": "1", "s": "-2"}),
        ("Pa", {"kg": "1", "m": "-1", "s": "-2"}),
        ("kg m2", {"kg": "1", "m": "2"}),
        ("N", {"kg": "1", "m": "1", "s": "-2"}),
    ],
)
def test_base_units(units, expected):
    assert base_units(units) == expected


def test_base_units_refuse_what_is_not_si():
    with pytest.raises(SchemaError, match="'kt' is not an SI unit"):
        base_units("kt")


@pytest.mark.parametrize(
    ("title", "expected"),
    [("T-37B (final)", "T_37B_final"), ("747", "model_747"), ("", "model"), ("été", "t")],
)
def test_identifier(title, expected):
    assert to_c_identifier(title) == expected


def test_a_name_that_no_importer_takes_is_refused():
    bad = FmuVariable("term.CL.flap 40", "parameter", 100003, "1", "1", "", 1.0)
    with pytest.raises(SchemaError, match=r"'term.CL.flap 40' is not an FMI variable name"):
        Description("x", "x", "0", "aeromatch", 0.01, (*VARIABLES, bad))
