"""Pages in one set of units: the number and its unit change together."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import report_fixture as fixture
import xarray as xr

import pom
from flightmech.errors import UnknownName
from flightmech.names import VOCABULARY
from flightmech.units import parse_unit
from pom.cases.job import STATED, stated_only
from pom.report.case.page import outcome_rows
from pom.report.case.remarks import reader_notes
from pom.report.case.start import condition_rows, stated_conditions, wind_text
from pom.report.overview import departure_table
from pom.report.presentation.quantities import measured_text, quantity_label
from pom.report.presentation.unit_sets import SETS, shown_in
from pom.report.presentation.verdict_text import remark_text
from pom.result import make_verdict_table
from pom.tolerances.bands import RowRemark


@pytest.mark.parametrize(
    ("units", "texts"),
    [
        ("", {"mass": "2100 kg", "h": "3281 ft", "fuel": "441 lb", "engine1.thrust": "1000.0 lbf"}),
        ("SI", {"mass": "2100 kg", "h": "1000.0 m", "fuel": "200 kg", "engine1.thrust": "4448 N"}),
        (
            "kt-ft-lb",
            {"mass": "4630 lb", "h": "3281 ft", "fuel": "441 lb", "engine1.thrust": "1000.0 lbf"},
        ),
    ],
)
def test_masses_and_forces_are_in_one_system(units, texts):
    values = {"mass": 2100.0, "h": 1000.0, "fuel": 200.0, "engine1.thrust": 4448.2216}
    with shown_in(units):
        found = {name: measured_text(value, name) for name, value in values.items()}
    assert {name: text.replace("\N{NO-BREAK SPACE}", " ") for name, text in found.items()} == texts


def test_wind_has_the_unit_of_its_number():
    assert wind_text(-10.0, 0.0) == "from 360° true at 19.4 kt"
    with shown_in("SI"):
        assert wind_text(-10.0, 0.0) == "from 360° true at 10.0 m/s"


@pytest.mark.parametrize("units", [name for name in SETS if name])
def test_every_quantity_keeps_its_dimension(units):
    for name, row in VOCABULARY.items():
        with shown_in(units):
            label = quantity_label(name)
        # the number goes back to SI by the unit that is printed
        if label.unit and label.unit not in ("g", "°C"):
            unit = label.unit.replace("²", "2").replace("³", "3")
            dimension, factor, _ = parse_unit(unit)
            assert dimension == parse_unit(row.units)[0], name
            assert label.factor * factor == pytest.approx(1.0), name


def test_a_report_keeps_its_units_and_refuses_an_unknown_set(tmp_path):
    results = [fixture.roll_result()]
    given = {"title": "T", "paper": None, "provenance": {"units": "kt-ft-lb"}}
    pom.write_report(results, tmp_path / "report", **given)
    assert pom.read_archive(tmp_path / "report").provenance["units"] == "kt-ft-lb"
    with pytest.raises(UnknownName, match="set of units"):
        pom.write_report(results, tmp_path / "other", **given | {"provenance": {"units": "cgs"}})


def test_the_centre_of_gravity_is_in_percent_of_the_chord():
    conditions = {"mass": 2000.0, "x_cg_b": 0.05, "x_cg": 0.24}
    ((_, rows),) = condition_rows(conditions, ())
    assert [(label.name, text.replace("\N{NO-BREAK SPACE}", " ")) for label, text in rows][:2] == [
        ("mass", "2000 kg"),
        ("x_cg", "24.0 %"),
    ]


def test_a_configuration_that_the_record_does_not_show_is_stated():
    case = SimpleNamespace(conditions={"delta_f": 0.35, "gear": 1.0, "lat": 0.8})
    states = xr.Dataset({"gear": ("time", np.ones(3))})
    assert stated_only(case, states) == ["delta_f"]
    result = fixture.roll_result()
    signals = result.signals.assign_attrs({STATED: "delta_f"})
    conditions = {"delta_f": 0.35, "gear": 1.0}
    stated = stated_conditions(replace(result, signals=signals))
    ((_, rows),) = condition_rows(conditions, (), stated)
    texts = {label.name: text for label, text in rows}
    assert texts["delta_f"].endswith("(stated, not recorded)")
    assert "stated" not in texts["gear"]
    assert stated_conditions(result) == []


TEXT = "lateral position off by 158 m at 20.4 s, watched within 5 m; 9.2 kt of wind"


@pytest.mark.parametrize(
    ("units", "shown"),
    [
        ("", TEXT),
        ("kt-ft-lb", TEXT.replace("158 m", "518 ft").replace("5 m;", "16.4 ft;")),
        ("SI", TEXT.replace("9.2 kt", "4.73 m/s")),
    ],
)
def test_remarks_have_the_units_of_the_report(units, shown):
    remark = RowRemark("departure", f"departure: {TEXT}", "y", {"off": 158.0, "band": 5.0}, "m")
    result = fixture.roll_result()
    rows = [{**row, "remarks": (*row["remarks"], remark)} for row in result.rows]
    result = replace(result, verdict=make_verdict_table(rows))
    with shown_in(units):
        notes = reader_notes(result)
        (cell, *_) = outcome_rows(result, dict.fromkeys(result.runs, "run-1"))
        (part,) = departure_table(["roll"], [result])
    assert any(shown in note.line for note in notes)
    assert f"departure: {shown}" in cell["notices"]
    assert shown in [text for _, text in part["rows"]]


def test_the_rule_keeps_its_units():
    note = RowRemark("row", "two speeds at least 5 kt apart")
    with shown_in("SI"):
        assert remark_text(note) == note.text
