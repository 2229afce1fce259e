"""The page that travels inside an FMU."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from flightmech.fmu_description import Description, Variable
from flightmech.fmu_documentation import Axis, html

DESCRIPTION = Description(
    "T-37 <final>",
    "T_37_final",
    "ab12",
    "aeromatch",
    0.01,
    (
        Variable("delta_e", "input", 1000, "rad", "deg", "elevator deflection", 0.0),
        Variable("V", "output", 10000, "m s-1", "kt", "true airspeed"),
        Variable("init.V", "parameter", 100000, "m s-1", "kt", "true airspeed at the start", 92.6, fixed=True),
        Variable("mode.trim", "parameter", 100001, "1", "1", "trim at the start", 1.0, fixed=True),
    ),
)
META = {
    "database": {"title": "a <b> & c", "history": "made"},
    "force_axes": "stability",
    "terms": {
        "CL/basic": {"source": "datcom 12, flight 3", "axes": "alpha"},
        "Cm/qhat": {"regressors": "qhat", "comment": "per q cbar/2V"},
    },
}


def tables() -> dict[str, list[list[str]]]:
    """Return the rows of every table under its heading."""
    page = html(DESCRIPTION, ["CL/basic", "Cm/qhat"], [Axis("alpha", "rad", -0.1, 0.25, "held")], META)
    body = page[page.index("<body>") : page.index("</html>")].replace(" class=n", "")
    found, heading = {}, ""
    for element in ET.fromstring(body):
        if element.tag == "h2":
            heading = element.text or ""
        if element.tag == "table":
            found[heading] = [[cell.text or "" for cell in row] for row in element]
    return found


def test_terms_axes_and_provenance():
    found = tables()
    assert found["Provenance"] == [["attribute", "value"], ["force_axes", "stability"], ["title", "a <b> & c"], ["history", "made"]]
    assert found["Terms"] == [
        ["name", "axes", "regressors", "source", "comment"],
        ["CL/basic", "alpha", "", "datcom 12, flight 3", ""],
        ["Cm/qhat", "", "qhat", "", "per q cbar/2V"],
    ]
    assert found["Table axes"][1:] == [["alpha", "rad", "-0.1", "0.25", "held"]]


def test_variables_show_si_and_display_units():
    found = tables()
    assert found["Inputs"][1:] == [["delta_e", "rad", "0 (0 deg)", "continuous", "elevator deflection"]]
    assert found["Outputs"][1:] == [["V", "m s-1", "", "continuous", "true airspeed"]]
    assert found["Parameters"][1:] == [
        ["init.V", "m s-1", "92.6 (180 kt)", "fixed", "true airspeed at the start"],
        ["mode.trim", "1", "seek_thrust", "fixed", "trim at the start"],
    ]
