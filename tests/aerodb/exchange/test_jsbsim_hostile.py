"""Files that are broken, that mislead or that attack: an error of ours that names the line and what
to do, at once.
"""

import re

import pytest

import aerodb
from aerodb.exchange import xml_reader
from flightmech.errors import ParseError, SchemaError

METRICS = (
    '<metrics><wingarea unit="FT2">200</wingarea><wingspan unit="FT">30</wingspan><chord '
    'unit="FT">5</chord>'
    '<location name="AERORP" unit="IN"><x>0</x><y>0</y><z>0</z></location></metrics>'
)
CL = "<property>aero/qbar-psf</property><property>metrics/Sw-sqft</property>"
VAR = "<independentVar lookup='{}'>{}</independentVar>"
ONE = "<independentVar>aero/alpha-rad</independentVar>"
SQUARE = "\n0 1\n0 1 2\n1 3 4</tableData>"  # four lines
TWO = VAR.format("row", "aero/alpha-rad") + VAR.format("column", "aero/beta-rad")
THREE = TWO + VAR.format("table", "velocities/mach")


def read(folder, text):
    path = folder / "bad.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return aerodb.exchange.import_jsbsim(path)


def model(body, metrics=METRICS):
    return (
        f"<fdm_config name='bad'>\n{metrics}\n<aerodynamics>\n{body}\n</aerodynamics></fdm_config>"
    )


def lift(content, outside=""):
    """Return a file whose function begins in line 4."""
    return model(
        f"<axis name='LIFT'><function "
        f"name='f'><product>{CL}{content}</product></function></axis>{outside}"
    )


BOMB = (
    "<!DOCTYPE x [<!ENTITY a 'ha'>"
    + "".join(f"<!ENTITY {b} '{f'&{a};' * 10}'>" for a, b in zip("abcdefgh", "bcdefghi"))
    + "]>"
)
OUTSIDE = "<!DOCTYPE x [<!ENTITY secret SYSTEM 'file:///etc/hostname'>]>"

NO_MODEL = {
    "entities": (
        f"{BOMB}<fdm_config>&i;</fdm_config>",
        "line 1: found a document type declaration",
    ),
    "entity outside": (
        f"{OUTSIDE}<fdm_config>&secret;</fdm_config>",
        "line 1: found a document type declaration",
    ),
    "document type outside": (
        "<!DOCTYPE x SYSTEM 'http://example.org/x.dtd'><fdm_config/>",
        "line 1: found a document type declaration",
    ),
    "entity unknown": (
        "<fdm_config>\n&what;</fdm_config>",
        "line 2: found broken XML (undefined entity)",
    ),
    "depth": (
        "<fdm_config>" + "\n<a>" * 5000,
        "line 201: found elements nested more than 200 deep",
    ),
    "cut off": ("<fdm_config>\n<metrics>", "line 2: found broken XML (no element found)"),
    "no XML": ("x = 1", "found broken XML (syntax error)"),
    "nothing": ("", "found broken XML (no element found)"),
    "bytes": (b"\x89HDF\r\n\x1a\n" + bytes(range(256)), "found broken XML (not well-formed"),
    "encoding": (b"<?xml version='1.0' encoding='klingon'?><fdm_config/>", "unknown encoding"),
    "root": (
        "<DAVEfunc/>",
        "line 1: found <DAVEfunc>; expected an aircraft file of JSBSim, <fdm_config>",
    ),
    "no metrics": ("<fdm_config><aerodynamics/></fdm_config>", "line 1: found no <metrics>"),
    "no aerodynamics": (f"<fdm_config>\n{METRICS}</fdm_config>", "found no <aerodynamics>"),
    "no chord": (
        model("", METRICS.replace("chord", "cord")),
        "line 2: found <metrics> without <chord>",
    ),
    "unit": (
        model("", METRICS.replace('"FT2"', '"HA"')),
        "line 2: found unit 'HA' of <wingarea>; expected one of FT2, M2",
    ),
    "unit of the reference": (
        model("", METRICS.replace('"IN"', '"FURLONG"')),
        "line 2: found unit 'FURLONG' of <location>",
    ),
    "area": (
        model("", METRICS.replace("200", "-200")),
        "line 2: found <wingarea> -200; expected a positive number",
    ),
    "area in words": (
        model("", METRICS.replace("200", "big")),
        "line 2: found 'big' in <wingarea>; expected finite numbers",
    ),
    "no reference": (
        model("", METRICS.replace("AERORP", "VRP")),
        "line 2: found no location AERORP",
    ),
    "half a reference": (
        model("", METRICS.replace("<z>0</z>", "")),
        "line 2: found AERORP without <z>",
    ),
}
AXES = {
    "axis": ("<axis name='UP'/>", "line 4: found axis 'UP'; expected DRAG SIDE LIFT"),
    "frame": ("<axis name='X' frame='EARTH'/>", "line 4: found axis 'X' EARTH"),
    "two sets": (
        "<axis name='LIFT'/>\n<axis name='X' frame='BODY'/>",
        "line 5: found force axes wind and body; expected one set",
    ),
    "twice": (
        "<axis name='LIFT'/>\n<axis name='LIFT'/>",
        "line 5: found a second axis LIFT; expected each axis once",
    ),
    "moments": (
        "<axis name='ROLL' frame='STABILITY'/>",
        "line 4: found moments in the frame STABILITY; expected moments in body axes",
    ),
    "unit": ("<axis name='LIFT' unit='N'/>", "line 4: found unit 'N'; expected forces in LBS"),
    "at the c.g.": (
        "<axis name='LIFT'><function apply_at_cg='true'/></axis>",
        "line 4: found apply_at_cg",
    ),
    "moving reference": (
        "<aero_ref_pt_shift_x/>",
        "line 4: found <aero_ref_pt_shift_x>; expected a fixed moment reference",
    ),
    "empty function": (
        "<axis name='LIFT'><function name='f'/></axis>",
        "line 4: found a function of 0 values",
    ),
    "two values": (
        "<axis name='LIFT'><function><value>1</value><value>2</value></function></axis>",
        "line 4: found a function of 2 values",
    ),
}
FUNCTIONS = {
    "operation": (
        "<frobnicate>1</frobnicate>",
        "line 4: found <frobnicate> in a function; expected an operation of JSBSim",
    ),
    "nothing in it": ("<sum/>", "line 4: found <sum> without anything in it"),
    "number": ("<value>1_000</value>", "line 4: found '1_000' in <value>; expected finite numbers"),
    "two numbers": ("<value>1 2</value>", "line 4: found <value> with 2 numbers"),
    "infinite": ("<value>1e400</value>", "line 4: found '1e400' in <value>"),
    "no data": (
        f"<table>{TWO}</table>",
        "line 4: found a table without independentVar or tableData",
    ),
    "one row": (
        f"<table>{ONE}<tableData>\n1 2\n</tableData></table>",
        "found a table of 1 breakpoints",
    ),
    "falling": (
        f"<table>{ONE}<tableData>\n0 1\n2 1\n\n1 3\n</tableData></table>",
        "line 8: found breakpoint 1 after 2; expected breakpoints in rising order",
    ),
    "three in a row": (
        f"<table>{ONE}<tableData>\n0 1\n1 2 3\n</tableData></table>",
        "line 6: found 3 numbers; expected a breakpoint and a value",
    ),
    "nan": (
        f"<table>{ONE}<tableData>\n0 1\n1 nan\n</tableData></table>",
        "line 6: found 'nan' in <tableData>; expected finite numbers",
    ),
    "columns": (
        f"<table>{TWO}<tableData>\n1 0\n0 1 2\n1 3 4\n</tableData></table>",
        "line 5: found breakpoint 0 after 1",
    ),
    "rows": (
        f"<table>{TWO}<tableData>\n0 1\n1 1 2\n1 3 4\n</tableData></table>",
        "line 7: found breakpoint 1 after 1",
    ),
    "ragged": (
        f"<table>{TWO}<tableData>\n0 1\n1 1 2\n2 3\n</tableData></table>",
        "line 7: found 2 numbers; expected a row",
    ),
    "blocks": (
        f"<table>{THREE}<tableData breakPoint='1'>{SQUARE}\n<tableData "
        f"breakPoint='1'>{SQUARE}</table>",
        "line 8: found breakPoint 1 after 1",
    ),
    "one block": (
        f"<table>{THREE}<tableData breakPoint='1'>{SQUARE}</table>",
        "line 4: found 1 tableData where breakPoint",
    ),
    "breakPoint": (
        f"<table>{THREE}<tableData breakPoint='low'/><tableData breakPoint='1'/></table>",
        "line 4: found breakPoint 'low'; expected a finite number",
    ),
    "lookup": (
        f"<table>{VAR.format('row', 'aero/alpha-rad')}{VAR.format('row', 'aero/beta-rad')}<tableData/></table>",
        "line 4: found lookup 'row row' for 2 axes; expected lookup 'row column', each once",
    ),
    "interpolate1d": (
        "<interpolate1d><value>1</value></interpolate1d>",
        "line 4: found <interpolate1d> of 1 values",
    ),
    "interpolate1d falling": (
        f"<interpolate1d><p>aero/alpha-rad</p>{'<v>1</v>' * 4}</interpolate1d>",
        "line 4: found points of <interpolate1d> that do not rise",
    ),
}
UNFIT = {
    "division by nothing": (
        "<quotient><value>1</value><value>0</value></quotient>",
        "infinite nodes",
    ),
    "power": (
        "<pow><pow><p>aero/alpha-rad</p><v>4</v></pow><v>4</v></pow>",
        "a variable to a power above 4",
    ),
    "explosion": (
        "<sum><v>1</v><p>aero/beta-rad</p></sum>" * 30,
        "multiplies out to more than 1024 products",
    ),
    "twice the same": (
        (
            f"<table>{TWO.replace('beta', 'alpha')}<tableData>\n0 1\n0 1 2\n1 3 "
            "4\n</tableData></table>"
        ),
        "a table with alpha on two axes",
    ),
    "not of the air": (
        "<quotient><v>1</v><product><p>velocities/vt-fps</p><p>aero/qbar-psf</p></product>"
        "</quotient>",
        "it is not proportional to the dynamic pressure",
    ),
    "unknown": (
        "<p>aero/Re</p>",
        "aero/Re is a quantity of the flight that the model does not have",
    ),
    "with a unit": (
        "<p>systems/pump/pressure-psi</p>",
        "systems/pump/pressure-psi has a unit, and a further input is an angle or a pure number",
    ),
    "chance": ("<urandom/>", "<urandom> is not a function of model variables"),
    "over a rate": ("<quotient><v>1</v><p>velocities/q-rad_sec</p></quotient>", "it divides by q"),
    "over the height": ("<quotient><v>1</v><p>position/h-sl-ft</p></quotient>", "it divides by h"),
}


@pytest.mark.parametrize("case", NO_MODEL)
def test_no_aircraft_file(case, tmp_path):
    text, message = NO_MODEL[case]
    with pytest.raises(ParseError, match=re.escape(message)):
        read(tmp_path, text)


@pytest.mark.parametrize("case", AXES)
def test_axes(case, tmp_path):
    body, message = AXES[case]
    with pytest.raises(ParseError, match=re.escape(message)):
        read(tmp_path, model(body))


@pytest.mark.parametrize("case", FUNCTIONS)
def test_functions(case, tmp_path):
    content, message = FUNCTIONS[case]
    with pytest.raises(ParseError, match=re.escape(message)):
        read(tmp_path, lift(content))


@pytest.mark.parametrize("case", UNFIT)
def test_what_is_no_term(case, tmp_path):
    content, message = UNFIT[case]
    with pytest.raises(SchemaError, match=re.escape("line 4: f: ") + ".*" + re.escape(message)):
        read(tmp_path, lift(content))


def test_a_long_chain_of_functions(tmp_path):
    chain = "".join(
        f"<function name='f/{i}'><property>f/{i + 1}</property></function>" for i in range(5000)
    )
    with pytest.raises(ParseError, match="functions that use each other; expected at most 20"):
        read(tmp_path, lift("<property>f/0</property>", chain))


def test_functions_nested_deep_by_their_names(tmp_path):
    """Each within the limit of depth, together beyond what Python's stack bears."""
    sums = "<sum>" * 90
    chain = "".join(
        f"<function name='f/{i}'>{sums}<property>f/{i + 1}</property>{'</sum>' * 90}</function>"
        for i in range(18)
    )
    with pytest.raises(ParseError, match="operations nested more than 200 deep"):
        read(tmp_path, lift("<property>f/0</property>", chain))


def test_too_large(tmp_path, monkeypatch):
    monkeypatch.setattr(xml_reader, "MAX_BYTES", 1000)
    with pytest.raises(ParseError, match="at most 1000; split the tables off"):
        read(tmp_path, lift("<value>1</value>" * 100))


def test_no_file(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        aerodb.exchange.import_jsbsim(tmp_path / "absent.xml")
    with pytest.raises(ParseError, match="not a regular file"):
        aerodb.exchange.import_jsbsim(tmp_path)


def test_sections_in_other_files(tmp_path):
    """Next to the aircraft file they are read; a folder above it is out of bounds, whatever lies
    there.
    """
    folder = tmp_path / "plane"
    (folder / "Systems").mkdir(parents=True)
    section = (
        f"<aerodynamics><axis name='LIFT'><function "
        f"name='f'><product>{CL}<value>2</value></product></function></axis></aerodynamics>"
    )
    for place in (folder / "Systems" / "aero.xml", tmp_path / "aero.xml"):
        place.write_text(section)
    text = f"<fdm_config name='x'>{METRICS}\n<aerodynamics file='{{}}'/></fdm_config>"
    db = read(folder, text.format("Systems/aero"))
    assert float(aerodb.evaluate(db, "CL")) == 2.0
    assert aerodb.terms(db)["CL/f"].attrs["references"].startswith("aero.xml, line 1")
    for name in ("../aero.xml", str(tmp_path / "aero.xml"), "nosuch"):
        with pytest.raises(
            ParseError, match=r"line 2: found file .* expected a file in the folder of bad\.xml"
        ):
            read(folder, text.format(name))
    (folder / "aero.xml").write_text("<metrics/>")
    with pytest.raises(
        ParseError,
        match=r"found <metrics>; expected <aerodynamics>, which bad\.xml refers to in line 2",
    ):
        read(folder, text.format("aero"))
