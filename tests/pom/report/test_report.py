"""The report without a browser: files, numbers, quantised traces, figures, escapes."""

import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import pom
from flightmech.errors import SchemaError, UnknownName
from pom.judging.modal import mode_table
from pom.report import overview
from pom.report.case import case, case_data, cross_plots, initial_conditions, panels, remarks
from pom.report.case import modes as modal
from pom.report.models import database_comparison, identification
from pom.report.page import html_page
from pom.report.presentation import quantities, term_names, traces, verdict_text
from pom.tolerances.remarks import RowRemark, reasons

sys.path.insert(0, str(Path(__file__).parents[1]))
import report_fixture as fixture


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    path = write(folder)
    return texts(path.read_text(encoding="utf-8")), json.loads((folder / "results.json").read_text(encoding="utf-8"))


def write(folder, **change):
    arguments = {
        "title": "T-37 flight model",
        "provenance": fixture.PROVENANCE,
        "databases": fixture.databases(),
        "diagnoses": {"short_period_full_flaps": fixture.diagnosis()},
        "revision": "A",
        "paper": None,
        **change,
    }
    return pom.write_report(arguments.pop("results", None) or fixture.results(), folder, **arguments)


def parcels(html):
    """Return head and body of every packed page, by the id of its article."""
    without_script = r"<noscript>(?:(?!</noscript>).)*</noscript>"
    packed = rf'id="([^"]+)"[^>]*>\s*{without_script}\s*<div class="body"></div>\s*<script type="text/plain" class="parcel">([^<]+)'
    return {name: traces.opened(text) for name, text in re.findall(packed, html, re.S)}


def texts(html):
    """Return the page with every packed part unpacked in its place."""
    return html + "".join(f'<article id="{name}">{head["page"]}</article>' for name, (head, _) in parcels(html).items())


def page(results, fits=(), databases=None, support=None):
    """The page alone, as text with its packed parts unpacked."""
    modes = [mode_table(result) for result in results]
    html = html_page(results, "T-37", "A", {}, databases or {}, {}, support or {}, modes, fits)
    return texts(html)


class Table(HTMLParser):
    """Text of the page by row of the verdict tables."""

    def __init__(self):
        super().__init__()
        self.rows, self.key, self.case, self.row = {}, None, "", None

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        if tag == "article":
            self.case = found["id"].removeprefix("case-")
        if tag == "tr":
            self.row = (self.case, found["data-criterion"], found["data-run"]) if "data-criterion" in found else None
            if self.row:
                self.rows[self.row] = ""

    def handle_data(self, data):
        if self.row:
            self.rows[self.row] += data + " "

    def handle_endtag(self, tag):
        if tag == "tr":
            self.row = None


def test_equal_input_gives_equal_bytes(tmp_path):
    first, second = write(tmp_path / "a"), write(tmp_path / "b")
    assert first.read_bytes() == second.read_bytes()
    assert (tmp_path / "a/results.json").read_bytes() == (tmp_path / "b/results.json").read_bytes()


def test_every_verdict_of_the_page_is_the_one_in_json(report):
    html, document = report
    table = Table()
    table.feed(html)
    count = 0
    for item in document["results"]:
        for row in item["verdict"]:
            text = table.rows[(item["case"]["name"], row["criterion"].replace("_", " "), row["run"])]
            assert verdict_text.WORDS[row["verdict"]] in text
            if row["worst_ratio"] is not None:
                assert re.search(rf"\b{row['worst_ratio']:.2f}\b", text), (row["criterion"], text)
            count += 1
    assert count == 21  # 3 criteria x 3 models, twice, and one criterion x 3 models


@pytest.mark.parametrize("index", [0, 1, 2])
def test_quantised_traces_stay_below_a_500th_of_the_tolerance(index):
    result = fixture.results()[index]
    shown = panels.panels(result)
    data, body = case_data.data(result, shown, [], case.line_styles(result.runs))
    np.testing.assert_allclose(traces.restore(data["time"], body), result.signals["time"].values, atol=1e-6)
    judged = 0
    for panel, head in zip(shown, data["panels"], strict=True):
        for run, values in panel.traces.items():
            error = np.abs(traces.restore(head["traces"][run], body) - values)
            if panel.half is not None:
                assert np.nanmax(error) < np.nanmin(panel.half) / 500
                assert np.nanmax(np.abs(traces.restore(head["half"], body) - panel.half)) < np.nanmin(panel.half) / 500
                judged += 1
            else:
                assert np.nanmax(error) <= (panel.limits[1] - panel.limits[0]) / 1000 * (1 + 1e-9)
    assert judged >= 3


def test_gaps_and_large_jumps_survive_the_quantisation():
    values = np.array([np.nan, 1.0, 1e6, np.nan, np.nan, -1e6, 0.25])
    pack = traces.Pack.empty()
    entry = pack.add(values, 0.01)
    assert entry["type"] == "int32"  # 1e8 steps do not fit 16 bits
    np.testing.assert_allclose(traces.restore(entry, bytes(pack.body)), values, atol=0.005)
    empty = pack.add(np.full(3, np.nan), 1.0)
    assert np.isnan(traces.restore(empty, bytes(pack.body))).all()


def test_smooth_traces_are_differenced_twice_and_gaps_once():
    pack = traces.Pack.empty()
    smooth = 1e3 * np.sin(np.linspace(0.0, 6.0, 500))
    entries = [pack.add(smooth, 0.01), pack.add(np.where(np.arange(500) == 250, np.nan, smooth), 0.01)]
    assert [(entry["order"], entry["type"]) for entry in entries] == [(2, "int16"), (1, "int16")]
    for entry, holes in zip(entries, (0, 1), strict=True):
        back = traces.restore(entry, bytes(pack.body))
        assert np.isnan(back).sum() == holes
        assert np.nanmax(np.abs(back - smooth)) <= 0.005 + 1e-9


def test_hostile_texts_stay_text(tmp_path):
    from dataclasses import replace

    evil = '</script><script>alert(1)</script><img src=x onerror="alert(2)">&\u2028'
    result = fixture.short_period_result()
    result = replace(result, case=replace(result.case, title=evil, description=evil, name=evil), failure=evil)
    result.verdict["remarks"] = [(RowRemark("row", evil),)] * len(result.verdict)
    html = write(tmp_path, results=[result], title=evil, revision=evil, diagnoses={evil: fixture.diagnosis()}).read_text(encoding="utf-8")
    assert "<script>alert" not in texts(html)
    assert "<img" not in texts(html)
    assert html.count("<script") == html.count("</script>") == 5  # class switch, uPlot, our own; parcels of the case and of the models
    assert json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["title"] == evil


def test_nothing_points_outside_the_file(report):
    html, _ = report
    assert not re.search(r"""(?:src|href|action)\s*=\s*["'](?!#|data:,)""", html)
    assert not re.search(r"@import|url\((?!#)", html)
    assert "default-src 'none'" in html


def test_a_failed_writing_leaves_the_old_report(tmp_path, monkeypatch):
    path = write(tmp_path)
    before = path.read_bytes(), (tmp_path / "results.json").read_bytes()
    monkeypatch.setattr("os.replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        write(tmp_path, title="another")
    assert before == (path.read_bytes(), (tmp_path / "results.json").read_bytes())
    assert not list(tmp_path.rglob(".*"))  # nothing half written is left behind


def test_bad_arguments_are_reported(tmp_path):
    with pytest.raises(SchemaError, match="no results came"):
        pom.write_report([], tmp_path, title="x")
    with pytest.raises(UnknownName, match=r"unknown key of provenance 'comand'; near it: command"):
        write(tmp_path, provenance={"comand": "x"})
    with pytest.raises(UnknownName, match=r"unknown case 'short_period'.*named after cases"):
        write(tmp_path, diagnoses={"short_period": fixture.diagnosis()})


def test_cases_of_one_name_get_addresses_of_their_own():
    result = fixture.roll_result()
    assert case.keys([result, result]) == ["roll_response_clean", "roll_response_clean-2"]


def test_line_code_of_the_figures_and_of_other_models():
    assert case.line_styles(["flight", "datcom", "corrected", "final"]) == dict(
        flight="run-0", datcom="run-1", corrected="run-2", final="run-3"
    )
    styles = case.line_styles(["final", "rival", "other"])
    assert styles["final"] == "run-3"
    assert len(set(styles.values())) == 4


def test_an_outlier_is_clipped_before_it_squeezes_the_band():
    time = np.linspace(0, 10, 201)
    flight, half = 3.0 * np.sin(time), np.full(201, 1.5)
    low, high = panels.limits({"flight": flight, "poor": flight + np.where(time > 5, 300.0, 0.0)}, half, 0.0)
    assert low < -4.49
    assert 4.5 < high < 12.0
    assert 1.5 / (high - low) > panels.LEAST_BAND


def test_a_missing_response_counts_as_outside():
    time = np.arange(5.0)
    half = np.array([np.nan, 1.0, 1.0, 1.0, np.nan])
    mask = panels.outside(np.array([9.0, 0.5, np.nan, 2.0, 9.0]), np.zeros(5), half)
    assert panels.spans(time, mask) == [(2.0, 3.0)]


@pytest.mark.parametrize(
    ("name", "si", "text"),
    [
        ("theta", np.pi / 6, "30.00\N{NO-BREAK SPACE}deg"),
        ("V_cas", 1852 / 36, "100.0\N{NO-BREAK SPACE}kt"),
        ("temperature", 288.15, "15.0\N{NO-BREAK SPACE}°C"),
        ("nz", 1.5, "1.500\N{NO-BREAK SPACE}g"),
        ("gear", 1.0, "down"),
        ("gear", 0.4, "0.400"),
        ("speedbrake", 0.0007, "in"),
    ],
)
def test_values_in_display_units(name, si, text):
    assert quantities.measured(si, name) == text


def test_a_difference_of_temperatures_has_no_offset():
    assert quantities.label("temperature").width(2.0) == pytest.approx(2.0)


def test_symbols():
    assert str(quantities.label("delta_e").html) == "<i>δ</i><sub>e</sub>"
    assert quantities.label("engine2.thrust").words == "net thrust, engine 2"
    assert quantities.label("trim.u_dot").words == "body acceleration along x, left after the trim"
    assert quantities.label("trim.delta_e").words == "elevator deflection, bias found by the trim"
    assert quantities.label("alien").words == ""


def test_models_page_shows_what_differs_and_names_the_rest(report):
    html, _ = report
    drawn = dict(
        re.findall(r'data-term="([^"]+)" id="[^"]*">\s*<h2>[^<]*<span class="quiet">(?:[^<;]+; )?((?:not in|replaced|unch)[^<;]*)', html)
    )
    assert drawn == {
        "CL/basic": "replaced",
        "CL/gear": "not in datcom",
        "CL/qhat": "replaced",
        "CL/tab": "not in final",
        "CD/basic": "unchanged",
        "Cm/basic": "unchanged",
        "Cm/elevator": "replaced",
    }
    assert re.search(r'scope="row">CL/flap</th><td>lift increment due to flap extension</td><td>alpha 11, delta_f 3', html)


def test_supporting_samples_are_drawn_in_their_slice():
    import pandas as pd

    support = {"CL/basic": pd.DataFrame({"alpha": np.radians([1.0, 2.0, 3.0]), "mach": [0.12, 0.28, 0.31]})}
    results, databases = [fixture.roll_result()], fixture.databases()
    html = page(results, databases=databases, support=support)
    section = html[html.index('data-term="CL/basic"') : html.index('data-term="CL/gear"')]
    assert section.count('class="rug"') == 1 + 3  # the key and three samples
    assert page(results, databases=databases).count('class="rug"') == 0


def test_identification_shows_every_local_model():
    fits = fixture.fits()
    head, body = parcels(page([fixture.roll_result()], fits))["identification"]
    html = head["page"]
    assert html.count('<details class="fit"') == len(head["fits"]) == 2
    for fit, drawn in zip(fits, head["fits"], strict=True):
        measured, fitted = (traces.restore(drawn[name], body) for name in ("measured", "fitted"))
        lift = fit.data["CL"].values
        assert np.abs(measured - lift).max() <= np.ptp(lift) / 1000 * (1 + 1e-9)
        assert np.std(measured - fitted) == pytest.approx(np.std(fit.residual), rel=0.02)
        assert drawn["starts"] == [300]
        for name, estimate in zip(fit.estimates["term"].values, fit.estimates["estimate"].values, strict=True):
            assert re.search(rf'scope="row">{name}</th><td class="num">{re.escape(quantities.number(float(estimate), 4))}</td>', html)
    assert 'class="test-point"' in html
    assert "Correlated estimates: 1 with alpha" in html
    assert "identification" not in parcels(page([fixture.roll_result()]))


def test_the_bar_of_an_estimate_spans_two_standard_errors():
    bar = identification._error_bar(3.0, 0.5)
    assert (bar["at"] - bar["zero"]) / (bar["high"] - bar["at"]) == pytest.approx(3.0, rel=0.01)
    assert bar["high"] - bar["at"] == pytest.approx(bar["at"] - bar["low"], abs=0.11)
    assert identification._error_bar(0.0, 0.0) is None


def test_a_sweep_is_drawn_force_over_position():
    result = fixture.column_sweep_result()
    (cross,) = cross_plots.crosses(result)
    data, body = case_data.data(result, panels.panels(result), [cross], case.line_styles(result.runs))
    (drawn,) = data["crosses"]
    assert (drawn["abscissa"]["channel"], drawn["ordinate"]["unit"]) == ("column", "lbf")
    assert [row["run"] for row in drawn["verdicts"]] == list(fixture.RUNS)
    inside = slice(50, 951)  # the window of the row, 1 to 19 s
    force = result.signals["F_column"].sel(run="flight").values[inside] / 4.4482216152605
    np.testing.assert_allclose(traces.restore(drawn["y"]["flight"], body), force, atol=5.0 / 1000)
    np.testing.assert_allclose(traces.restore(drawn["half"], body), np.maximum(5.0, 0.1 * np.abs(force)), atol=5.0 / 1000)
    reach = np.ptp(traces.restore(drawn["x"]["flight"], body))
    assert reach == pytest.approx(quantities.label("column").width(0.3), rel=2e-3)
    assert cross_plots.crosses(fixture.roll_result()) == []


def set_rows(table, column, value, **cells):
    """Set cells of the rows of a verdict table that have a value in a column."""
    for index in table.index[table[column] == value]:
        for name, cell in cells.items():
            table.at[index, name] = cell


def test_coverage_states_what_of_an_entry_was_not_judged_and_why():
    results = fixture.results()
    set_rows(results[0].verdict, "criterion", "normal_acceleration", verdict="not_tested", remarks=reasons("no accelerometer"))
    rows = [
        {"standard": r.case.standard, "edition": r.case.edition, "test_id": i, "title": i} for r in results[:1] for i in ("2.c.10", "9.z.9")
    ]
    (part,) = overview.coverage(results[:1], rows)
    assert [(entry["id"], entry["judged"], entry["criteria"], entry["left"]) for entry in part["run"]] == [
        ("2.c.10", 2, 3, [("normal acceleration", "no accelerometer")])
    ]
    assert [entry["id"] for entry in part["missing"]] == ["9.z.9"]


def test_what_fails_without_a_number_is_named():
    from dataclasses import replace

    result = fixture.roll_result()
    verdict = result.verdict.copy()
    remark = RowRemark("no_mode", "the model does not oscillate")
    set_rows(verdict, "run", "datcom", worst_ratio=np.nan, at=np.nan, remarks=(RowRemark("values", "flight 2.84 s"), remark))
    (row, *_) = case.outcomes(replace(result, verdict=verdict), case.line_styles(result.runs))
    assert (row["status"], row["criterion"], row["ratio_text"], row["why"]) == ("fail", "roll rate", "–", "the model does not oscillate")


def test_an_invalid_run_states_why():
    from dataclasses import replace

    result = fixture.roll_result()
    verdict = result.verdict.copy()
    beyond = (
        RowRemark("trim", "trim.delta_e -3.44 deg is beyond 2 deg", "delta_e", {"found": -3.44, "limit": 2.0}, "deg"),
        RowRemark("trim", "trim.thrust -852 N is beyond 107 N", "thrust", {"found": -852.0, "limit": 107.0}, "N"),
    )
    set_rows(verdict, "run", "datcom", worst_ratio=np.nan, at=np.nan, verdict="invalid", remarks=beyond)
    result = replace(result, verdict=verdict)
    (row, *_) = case.outcomes(result, case.line_styles(result.runs))
    assert (row["status"], row["why"]) == ("invalid", "elevator deflection biased by the trim: −3.44 deg, beyond 2 deg")
    both = "elevator deflection biased by the trim: −3.44 deg, beyond 2 deg; net thrust biased by the trim: −852 N, beyond 107 N"
    assert f"datcom: {both}" in remarks.notes(result)


def test_outcomes_are_those_of_the_result():
    for result in fixture.results():
        for row in case.outcomes(result, case.line_styles(result.runs)):
            assert row["status"] == result.status(row["run"])


def test_what_an_engineer_writes_is_printed():
    from dataclasses import replace

    before = fixture.roll_result()
    changed = replace(
        before.case,
        objective="Show the roll mode.",
        manual="Wheel left for five seconds.",
        source={"document": "FT-12, page 7", "filters": "none"},
        rationale={"roll_rate": "The gyro lags by 8 ms."},
        ticks={"sideslip trend": "A. Smith, 2026-11-20, trend agrees"},
        notes="Flown in smooth air.",
    )
    html = page([replace(before, case=changed)])
    for words in ("Show the roll mode.", "Wheel left for five seconds.", "FT-12, page 7", "The gyro lags by 8 ms.", "Flown in smooth air."):
        assert words in html
    assert "☒</span> sideslip trend: correct trend and magnitude, ticked by A. Smith, 2026-11-20, trend agrees" in html


def test_an_engineering_reference_and_its_share_are_reported():
    from dataclasses import replace

    before = fixture.roll_result()
    html = page([replace(before, case=replace(before.case, reference="engineering", fraction=0.2))])
    assert "20 % of the tolerance applied" in html
    assert "The reference is an engineering simulator, not a flight; 20 % of the flight tolerance is applied." in html


def test_reports_of_many_cases_leave_out_the_figures_for_readers_without_script(monkeypatch):
    monkeypatch.setattr("pom.report.page.MOST_WITH_FIGURES", 1)
    result = fixture.roll_result()
    many, few = page([result, result]), page([result])
    assert many.count("<noscript>") == 2
    assert many.count("<figure><svg") == 0
    assert few.count("<figure><svg") == 1


def test_tables_of_unlike_axes_share_a_figure():
    from flightmech import terms

    alpha, mach = np.radians([0.0, 10.0]), [0.2, 0.6]
    holders = {
        "wide": terms.make([[1.0, 2.0], [3.0, 4.0]], {"alpha": alpha, "mach": mach}),
        "narrow": terms.make([[5.0], [7.0]], {"alpha": alpha, "mach": [0.3]}),
        "flat": terms.make([8.0, 10.0], {"mach": [0.2, 0.4]}, stderr=0.1),
        "scalar": terms.make(6.0),
    }
    tables = {name: leaf["value"] for name, leaf in holders.items()}
    curves = {c["name"]: c for c in database_comparison._curves(tables, holders, "value", "alpha", {"mach": 0.6})}
    np.testing.assert_allclose(curves["wide"]["y"], [2.0, 4.0])
    np.testing.assert_allclose(curves["narrow"]["y"], [5.0, 7.0])  # one node only: held
    np.testing.assert_allclose(curves["flat"]["y"], [10.0, 10.0])  # beyond its last node: held
    np.testing.assert_allclose(curves["scalar"]["y"], [6.0, 6.0])
    for curve in curves.values():
        np.testing.assert_allclose(curve["x"], [0.0, 10.0])
    middle = {c["name"]: c for c in database_comparison._curves(tables, holders, "value", "alpha", {"mach": 0.3})}
    np.testing.assert_allclose(middle["wide"]["y"], [1.25, 3.25])
    assert database_comparison._figure(
        "CL/basic", "value", holders, database_comparison._shared(holders), None, case.line_styles(holders)
    ).startswith("<svg")


def test_coverage_counts_entries_of_the_table(report):
    html, _ = report
    assert "2 of 75 entries have a case here" in html
    assert re.search(r'<span class="id">2\.c\.9</span> Phugoid', html)


def test_what_the_case_sets_against_record_and_table_is_reported():
    from dataclasses import replace

    before = fixture.roll_result()
    result = replace(before, case=replace(before.case, shortened="the record ends", conditions={"delta_f": np.radians(40.0)}))
    html = page([result])
    assert "The window is shorter than the table requires: the record ends." in html
    assert "From the case file, not from the record: flap deflection 40\N{NO-BREAK SPACE}deg." in html


def test_a_crashed_model_is_reported(report):
    html, _ = report
    assert "Not all models ran.</strong> corrected: the FMU stopped at 6.42 s" in html


def dutch_roll():
    """A case judged by its mode: the flight rings with 3 s and damping 0.08, one model lies close, one does not ring."""
    from dataclasses import replace

    import xarray as xr

    base = fixture.roll_result()
    time = np.arange(0.0, 20.0, 0.02)
    window, wd = (1.0, 19.5), 2 * np.pi / 3.0

    def ring(zeta, amplitude=0.1):
        return amplitude * np.exp(-zeta * wd / np.sqrt(1 - zeta**2) * time) * np.cos(wd * time)

    runs = {"flight": ring(0.08), "datcom": ring(0.08, 0.0), "corrected": ring(0.06), "final": ring(0.081)}
    signals = xr.Dataset({"r": (("run", "time"), np.stack(list(runs.values())))}, {"run": list(runs), "time": time})
    period = fixture.criterion("period", "r", "g1", window, fixture.Limit("percent", 10.0, "%"), provenance="memory")
    criteria = (replace(period, measure="period"), replace(period, name="damping_ratio", measure="damping_ratio", group="g2"))
    case_ = replace(base.case, id="2.d.7", window=(0.0, 19.98), events={"input_end": 1.0}, criteria=criteria)
    from pom.judging.verdict import judge, row
    from pom.result import verdict_table

    flights = {run: {"r": values} for run, values in runs.items()}
    rows = [
        row(run, c, judge(case_, c, time, flights["flight"], flights[run])) for run in ("datcom", "corrected", "final") for c in criteria
    ]
    inputs = xr.Dataset({"delta_r": ("time", 0.1 * (time < 1.0))}, {"time": time})
    tolerance = xr.Dataset(coords={"time": time})
    return replace(base, case=case_, signals=signals, tolerance=tolerance, inputs=inputs, verdict=verdict_table(rows))


def test_table_of_modes(tmp_path):
    result = dutch_roll()
    table = mode_table(result)
    found = table.set_index("run")
    assert list(found.index) == ["flight", "datcom", "corrected", "final"]
    np.testing.assert_allclose(found.loc["flight", ["period", "damping_ratio", "cycles"]].astype(float), [3.0, 0.08, 18.5 / 3.0], rtol=1e-3)
    assert found.loc["corrected", "damping_ratio"] == pytest.approx(0.06, rel=1e-4)
    assert "hardly oscillates" in found.loc["datcom", "note"]
    (block,) = modal.table(result, table, case.line_styles(result.runs))
    assert [row["period"] for row in block["rows"]] == ["3.00", "–", "3.00", "3.00"]
    html = texts(write(tmp_path, results=[result], diagnoses={}).read_text(encoding="utf-8"))
    document = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert document["modes"]["roll_response_clean"][2]["damping_ratio"] == pytest.approx(0.06, rel=1e-4)
    assert "<h2>Modes</h2>" in html
    assert (
        "zeta 0.0" not in html[html.index("Notes and rationale") : html.index("Signatures")]
    )  # printed in the table, not again in the notes
    assert html.count("from memory") >= 2


@pytest.mark.parametrize(
    ("term", "stated"),
    [
        ("CL/basic", "basic lift"),
        ("CL/gear", "lift increment due to gear extension"),
        ("Cl/phat", "rolling-moment increment due to roll rate"),
        ("Cn/beta_gear", "yawing-moment increment due to sideslip, with gear down"),
        ("CD/load_factor", "drag increment due to load factor"),
        ("CL/canard", ""),
    ],
)
def test_terms_in_words(term, stated):
    assert term_names.term_words(term) == stated


def test_winds_are_named_from_where_they_blow():
    assert initial_conditions.wind(0.0, -5.0) == "from 090° true at 9.7 kt"
    assert initial_conditions.wind(-5.0, 0.0) == "from 360° true at 9.7 kt"
    assert initial_conditions.wind(0.0, 0.0) == "calm"
    assert initial_conditions.wind(5.0, 0.0, -1.0).endswith("from 180° true at 9.7 kt, up 1.0\N{NO-BREAK SPACE}m/s")


def test_biases_of_the_trim_are_marked_beyond_their_limit():
    from dataclasses import replace

    table = fixture.trim(("datcom",))
    table.loc["trim.delta_e", "datcom"] = np.radians(-1.2)
    table.loc["trim.throttle"] = [np.nan, 0.0]
    parts = dict(initial_conditions.trim(replace(fixture.short_period_result(), trim=table))["parts"])
    found = [(row["label"].name, row["cells"], row["limit"]) for row in parts["Biases found by the trim"]]
    assert found == [
        ("trim.delta_e", [("–", False), ("−1.20", True)], "± 1"),
        ("trim.thrust", [("–", False), ("27.0", False)], ""),
    ]
    assert [row["label"].name for row in parts["State"]] == ["V", "alpha", "theta"]
    alpha = parts["State"][1]
    assert alpha["differences"] == ["+0.46"]  # 0.008 rad
    assert parts["Biases found by the trim"][0]["differences"] == []


def test_thrust_that_drives_is_shown_once():
    result = fixture.short_period_result()
    thrust = result.inputs["engine1.thrust_drive"].values
    result.signals["engine1.thrust"] = ("run", "time"), np.stack([thrust] * 4)
    shown = [(panel.channel, panel.kind) for panel in panels.panels(result)]
    assert ("engine1.thrust", "input") in shown
    assert "engine1.thrust_drive" not in dict(shown)


def test_a_control_that_a_pilot_moves_is_shown_with_the_models():
    result = fixture.roll_result()
    aileron = result.inputs["delta_a"].values
    result.signals["delta_a"] = ("run", "time"), np.stack([aileron, 1.1 * aileron, aileron, aileron])
    panel = next(panel for panel in panels.panels(result) if panel.channel == "delta_a")
    assert panel.kind == "input"
    assert list(panel.traces) == ["flight", *fixture.RUNS]


def test_the_rest_of_a_record_does_not_squeeze_the_window():
    result = fixture.short_period_result()
    result.signals["theta"].loc[{"run": "flight", "time": result.signals["time"][:5]}] = 3.0  # before the window, as vanes at a standstill
    panel = panels.panels(result)[0]
    assert panel.limits[1] > np.degrees(3.0)
    assert panel.scale == panels.panels(fixture.short_period_result())[0].scale  # as if it were not there
    assert panels.panels(result)[1].scale == panels.panels(result)[1].limits


def test_databases_that_hold_the_same_table_share_a_line():
    from flightmech import terms

    leaf = terms.make([1.0, 2.0], {"mach": [0.2, 0.6]})
    other = terms.make([1.0, 2.5], {"mach": [0.2, 0.6]})
    narrower = terms.make([1.0, 2.0], {"mach": [0.2, 0.6]}, stderr=0.1)
    assert database_comparison._shared({"a": leaf, "b": other, "c": leaf.copy(), "d": narrower}) == {
        "a": ["a", "c"],
        "b": ["b"],
        "d": ["d"],
    }
