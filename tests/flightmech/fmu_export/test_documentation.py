"""The page that travels inside an FMU."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

from flightmech.fmu_export.description import Description, FmuVariable, describe_model
from flightmech.fmu_export.documentation import PageAxis, render_documentation
from flightmech.fmu_export.fmu_file import document_model
from flightmech.simulation.kernel import STATE

DESCRIPTION = Description(
    "T-37 <final>",
    "T_37_final",
    "ab12",
    "aeromatch",
    0.01,
    (
        FmuVariable("delta_e", "input", 1000, "rad", "deg", "elevator deflection", 0.0, -0.5),
        FmuVariable("V", "output", 10000, "m s-1", "kt", "true airspeed"),
        FmuVariable(
            "init.V",
            "parameter",
            100000,
            "m s-1",
            "kt",
            "true airspeed at the start",
            92.6,
            fixed=True,
        ),
        FmuVariable(
            "mode.trim", "parameter", 100001, "1", "1", "trim at the start", 1.0, fixed=True
        ),
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
    page = render_documentation(
        DESCRIPTION, ["CL/basic", "Cm/qhat"], [PageAxis("alpha", "rad", -0.1, 0.25, "held")], META
    )
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
    assert found["Provenance"] == [
        ["attribute", "value"],
        ["force_axes", "stability"],
        ["title", "a <b> & c"],
        ["history", "made"],
    ]
    assert found["Terms"] == [
        ["name", "axes", "regressors", "source", "comment"],
        ["CL/basic", "alpha", "", "datcom 12, flight 3", ""],
        ["Cm/qhat", "", "qhat", "", "per q cbar/2V"],
    ]
    assert found["Table axes"][1:] == [["alpha", "rad", "-0.1", "0.25", "held"]]


def test_variables_show_si_and_display_units():
    found = tables()
    assert found["Inputs"][1:] == [
        [
            "delta_e",
            "rad",
            "0 (0 deg)",
            "-0.5 (-28.6479 deg)",
            "",
            "continuous",
            "elevator deflection",
        ]
    ]
    assert found["Outputs"][1:] == [["V", "m s-1", "continuous", "true airspeed"]]
    assert found["Parameters"][1:] == [
        ["init.V", "m s-1", "92.6 (180 kt)", "fixed", "true airspeed at the start"],
        ["mode.trim", "1", "trim_thrust", "fixed", "trim at the start"],
    ]
    assert found["Enumerations"][1:] == [
        ["mode.trim", "0 none, 1 trim_thrust, 2 trim_throttle, 3 stand_on_ground"]
    ]


def test_submodels_are_reported_with_their_items(trainer):
    page = document_model(trainer, describe_model(trainer, "ab12", "aeromatch"))
    row = next(line for line in page.split("\n") if line.startswith("<tr><td>engine</td>"))
    assert row.startswith(
        "<tr><td>engine</td><td>1</td><td>thrust and its lever arm, first-order lag</td>"
    )
    counts = [int(cell) for cell in re.findall(r"<td class=n>(\d+)</td>", row)]
    assert counts == [
        sum(name.startswith(f"{prefix}engine1.") for name in names)
        for prefix, names in kinds(trainer)
    ]
    assert "<td>weather</td>" in page
    assert "<td>circuit</td>" not in page


def kinds(sim):
    """Return inputs, outputs, parameters and states with the prefix of their names."""
    states = [row.name for row in sim.entries(STATE)]
    return ("", sim.inputs), ("", sim.outputs), ("", sim.parameters), ("state.", states)


def test_the_page_holds_no_link_to_the_outside(trainer):
    page = document_model(trainer, describe_model(trainer, "ab12", "aeromatch"))
    assert not re.search(r"(src|href)=[\"'](?!#)", page)
    anchors = set(re.findall(r'href="#([^"]+)"', page))
    assert anchors == set(re.findall(r'<h2 id="([^"]+)"', page))


def test_long_texts_are_folded():
    page = render_documentation(
        DESCRIPTION, ["CL/basic"], [], {"terms": {"CL/basic": {"comment": "<" + "x" * 300}}}
    )
    assert f"<details><summary>&lt;{'x' * 99} ...</summary>&lt;{'x' * 300}</details>" in page
