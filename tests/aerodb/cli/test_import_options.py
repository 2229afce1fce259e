"""Options of ``aeromatch db import`` and ``import-aircraft``: names, fixed inputs, reference
quantities, and messages that name options and not the keywords of Python.
"""

import re

import pytest
from click.testing import CliRunner

import aerodb
from aerodb.cli.group import db as command
from flightmech.errors import SchemaError

JSBSIM = """<fdm_config name="some"><metrics><wingarea unit="FT2">200</wingarea>
<wingspan unit="FT">30</wingspan><chord unit="FT">5</chord>
<location name="AERORP" unit="IN"><x>0</x><y>0</y><z>0</z></location></metrics>
<mass_balance><ixx>900</ixx><iyy>1200</iyy><izz>1900</izz><emptywt>2000</emptywt>
<location name="CG" unit="IN"><x>0</x><y>0</y><z>0</z></location></mass_balance>
<aerodynamics><axis name="LIFT"><function name="f/lift"><product><p>aero/qbar-psf</p>
<p>metrics/Sw-sqft</p>{}</product></function></axis></aerodynamics></fdm_config>"""
# A lift over the angle of attack and the height over the runway, which has no quantity.
_MODEL = """<?xml version="1.0"?>
<DAVEfunc xmlns="http://daveml.org/2010/DAVEML"><fileHeader><author name="a" org="b"/>
<creationDate date="2026-01-01"/></fileHeader>
<variableDef name="angleOfAttack" varID="ALP" units="deg"><isInput/></variableDef>
<variableDef name="runwayHeight" varID="H_rwy" units="ft"><isInput/></variableDef>
<variableDef name="totalCoefficientOfLift" varID="CL" units="nd"><isOutput/></variableDef>
<breakpointDef bpID="h"><bpVals>0, 100</bpVals></breakpointDef>
<breakpointDef bpID="a"><bpVals>0, 10</bpVals></breakpointDef>
<function name="lift"><independentVarRef varID="ALP" min="0" max="10" extrapolate="neither"/>
<independentVarRef varID="H_rwy" min="0" max="100" extrapolate="neither"/>
<dependentVarRef varID="CL"/><functionDefn><griddedTable><breakpointRefs><bpRef bpID="a"/>
<bpRef bpID="h"/></breakpointRefs><dataTable>0.2, 0.0, 1.4, 1.0</dataTable></griddedTable>
</functionDefn></function><checkData>{}</checkData></DAVEfunc>"""
SHOT = """<staticShot name="at {0}"><checkInputs><signal><varID>ALP</varID>
<signalValue>5</signalValue>
</signal><signal><varID>H_rwy</varID><signalValue>{0}</signalValue></signal></checkInputs>
<checkOutputs><signal><varID>CL</varID><signalValue>{1}</signalValue><tol>1e-9</tol></signal>
</checkOutputs></staticShot>"""
DAVEML = _MODEL.format(SHOT.format(50, 0.65) + SHOT.format(100, 0.5))
REFERENCE = ("--S", "20 m2", "--cbar", "5 ft", "--b", "6 m")


@pytest.fixture
def run(tmp_path):
    """Return a function that runs ``aeromatch db`` on a file of a content."""

    def call(verb, content, *options):
        file = tmp_path / "some.xml"
        file.write_text(content)
        output = str(tmp_path / "out.nc")
        return CliRunner().invoke(command, [verb, str(file), "-o", output, *options])

    return call


def message_of(done):
    """Return the messages of a command: on stderr, and in the error that the program prints."""
    return re.sub(r"\s+", " ", f"{done.stderr} {done.exception or ''}")


def lift_of(folder, **conditions):
    db = aerodb.open(folder / "out.nc")
    return float(aerodb.evaluate(db, "CL", outside="clamp", **conditions))


@pytest.mark.parametrize("verb", ["import", "import-aircraft"])
def test_names_of_a_jsbsim_file(verb, run, tmp_path):
    content = JSBSIM.format("<sum><p>fcs/left</p><p>fcs/right</p><p>fcs/e</p></sum>")
    names = ("fcs/left=delta_a [deg]", "fcs/right=-delta_a [deg]", "fcs/e=delta_e [rad]")
    options = [word for name in names for word in ("--names", name)]
    done = run(verb, content, *options)
    assert done.exit_code == 0, done.output
    assert "warning" not in done.output
    assert lift_of(tmp_path, delta_a=0.1, delta_e=0.2) == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize(
    ("lift", "options", "expected"),
    [
        ("<p>aero/Re</p>", (), "--names 'aero/Re=VARIABLE' states which variable it is"),
        ("<p>aero/Re</p>", (), "--without NAME does without one, --sample BOUND tabulates"),
        ("<sin><p>aero/alpha-rad</p></sin>", (), "give --sample with the largest difference"),
        (
            "<sin><p>aero/alpha-rad</p></sin>",
            ("--sample", "0.1"),
            "give --grid alpha='LOW HIGH UNIT'",
        ),
        ("<p>fcs/flap-pos-norm</p>", (), "--travel 'delta_f=ANGLE deg' makes the fraction delta_f"),
        ("<p>fcs/any</p>", (), "name one that is meant with --names"),
        ("<p>fcs/e</p>", ("--names", "fcs/e=delta_e"), "write delta_e [rad] or [deg]"),
    ],
)
def test_messages_of_a_jsbsim_file_name_options(lift, options, expected, run):
    done = run("import", JSBSIM.format(lift), *options)
    assert expected in message_of(done)
    for keyword in ("leave_out", "sample =", "box =", "travel =", "names ="):
        assert keyword not in message_of(done)


def test_messages_from_python_name_keywords(tmp_path):
    file = tmp_path / "some.xml"
    file.write_text(JSBSIM.format("<sin><p>aero/alpha-rad</p></sin>"))
    with pytest.raises(SchemaError, match=r"(?s)leave_out = \[names\] .* give sample = largest"):
        aerodb.exchange.import_jsbsim(file)


def test_reference_quantities_of_a_daveml_file(run, tmp_path):
    done = run("import", DAVEML)
    assert done.exit_code == 1
    for name in ("S", "cbar", "b"):
        assert f"the file does not state {name}; give --{name}" in message_of(done)
    done = run("import", DAVEML, *REFERENCE, "--at", "H_rwy=50")
    assert done.exit_code == 0, done.output
    attributes = aerodb.open(tmp_path / "out.nc").attrs
    assert [attributes[name] for name in ("S", "cbar", "b")] == pytest.approx([20.0, 1.524, 6.0])


@pytest.mark.slow
def test_an_input_of_a_daveml_file_is_named_or_fixed(run, tmp_path):
    """The height over the runway: refused, a quantity, or a constant."""
    done = run("import", DAVEML, *REFERENCE)
    assert done.exit_code == 1
    message = message_of(done)
    assert "state one with --names, or fix it with --at" in message
    assert run("import", DAVEML, *REFERENCE, "--names", "H_rwy=h_agl [ft]").exit_code == 0
    alpha = 0.08726646259971647  # 5 deg
    assert lift_of(tmp_path, alpha=alpha, h_agl=15.24) == pytest.approx(0.65, rel=1e-12)
    done = run("import", DAVEML, *REFERENCE, "--at", "H_rwy=50")
    assert done.exit_code == 0, done.output
    assert lift_of(tmp_path, alpha=alpha) == pytest.approx(0.65, rel=1e-12)
    history = aerodb.open(tmp_path / "out.nc").attrs["history"]
    assert "inputs that are fixed: H_rwy = 50 ft" in history
    # The check case at another height is left out, the other one is kept and run.
    checks = aerodb.open(tmp_path / "out.nc")["checks"]
    assert checks.attrs["names"] == "at 50"
    done = run("import", DAVEML, *REFERENCE, "--at", "H_runway=50")
    assert done.exit_code == 1
    assert "H_runway" in message_of(done)


def test_options_of_another_format(run):
    done = run("import", JSBSIM.format("<v>1</v>"), "--S", "20")
    assert done.exit_code == 2
    assert "--S belongs to daveml; leave it out for jsbsim" in message_of(done)
    done = run("import", JSBSIM.format("<v>1</v>"), "--at", "x=1")
    assert "--at belongs to daveml; leave it out for jsbsim" in message_of(done)
