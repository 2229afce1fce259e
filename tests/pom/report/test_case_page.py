"""The page of a case: outcomes, remarks, texts of the case, modes, trim, inputs."""

import json
from dataclasses import replace

import numpy as np
import pytest
import report_fixture as fixture
from report_pages import html, page, parcels, set_rows, texts, write

from pom.judging.measures.modal import mode_table
from pom.report.case import page as case
from pom.report.case import page as case_data
from pom.report.case import panels, remarks, start
from pom.report.case import panels as cross_plots
from pom.report.case import remarks as modal
from pom.report.presentation import quantities, traces, verdict_text
from pom.tolerances.bands import RowRemark


def test_a_sweep_is_drawn_force_over_position():
    result = fixture.column_sweep_result()
    (cross,) = cross_plots.make_cross_plots(result)
    data, body = case_data.plot_data(
        result, panels.make_case_panels(result), [cross], case.run_line_classes(result.runs)
    )
    (drawn,) = data["crosses"]
    assert (drawn["abscissa"]["channel"], drawn["ordinate"]["unit"]) == ("column", "lbf")
    assert [row["run"] for row in drawn["verdicts"]] == list(fixture.RUNS)
    inside = slice(50, 951)  # the window of the row, 1 to 19 s
    force = result.signals["F_column"].sel(run="flight").values[inside] / 4.4482216152605
    np.testing.assert_allclose(
        traces.restore_trace(drawn["y"]["flight"], body), force, atol=5.0 / 1000
    )
    np.testing.assert_allclose(
        traces.restore_trace(drawn["half"], body),
        np.maximum(5.0, 0.1 * np.abs(force)),
        atol=5.0 / 1000,
    )
    reach = np.ptp(traces.restore_trace(drawn["x"]["flight"], body))
    assert reach == pytest.approx(quantities.quantity_label("column").width(0.3), rel=2e-3)
    assert cross_plots.make_cross_plots(fixture.roll_result()) == []


def test_what_fails_without_a_number_is_named():
    result = fixture.roll_result()
    verdict = result.verdict.copy()
    remark = RowRemark("no_mode", "the model does not oscillate")
    set_rows(
        verdict,
        "run",
        "datcom",
        worst_ratio=np.nan,
        at=np.nan,
        remarks=(RowRemark("values", "flight 2.84 s"), remark),
    )
    (row, *_) = case.outcome_rows(
        replace(result, verdict=verdict), case.run_line_classes(result.runs)
    )
    assert (row["status"], row["criterion"], row["ratio_text"], row["why"]) == (
        "fail",
        "roll rate",
        "–",
        "the model does not oscillate",
    )


def test_an_invalid_run_states_why():
    result = fixture.roll_result()
    verdict = result.verdict.copy()
    beyond = (
        RowRemark(
            "trim",
            "trim.delta_e -3.44 deg is beyond 2 deg",
            "delta_e",
            {"found": -3.44, "limit": 2.0},
            "deg",
        ),
        RowRemark(
            "trim",
            "trim.thrust -852 N is beyond 107 N",
            "thrust",
            {"found": -852.0, "limit": 107.0},
            "N",
        ),
    )
    set_rows(
        verdict, "run", "datcom", worst_ratio=np.nan, at=np.nan, verdict="invalid", remarks=beyond
    )
    result = replace(result, verdict=verdict)
    (row, *_) = case.outcome_rows(result, case.run_line_classes(result.runs))
    assert (row["status"], row["why"]) == (
        "invalid",
        "elevator deflection biased by the trim: −3.44 deg, beyond 2 deg",
    )
    both = (
        "elevator deflection biased by the trim: −3.44 deg, beyond 2 deg",
        "net thrust biased by the trim: −852 N, beyond 107 N",
    )
    assert remarks.ReaderNote("datcom", both) in remarks.reader_notes(result)


def test_outcomes_are_those_of_the_result():
    for result in fixture.results():
        for row in case.outcome_rows(result, case.run_line_classes(result.runs)):
            assert row["status"] == result.status(row["run"])


def test_what_an_engineer_writes_is_printed():
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
    for words in (
        "Show the roll mode.",
        "Wheel left for five seconds.",
        "FT-12, page 7",
        "The gyro lags by 8 ms.",
        "Flown in smooth air.",
    ):
        assert words in html
    assert (
        "☒</span> sideslip trend: correct trend and magnitude, ticked by A. Smith, "
        "2026-11-20, trend agrees" in html
    )


def test_the_packed_page_of_a_case_holds_no_title_of_the_report():
    """The script of the report adds it, so that a new title requires no new pages."""
    files = html([fixture.roll_result()])["report.html"]
    assert 'data-report="T-37, revision A"' in files
    ((head, _),) = [parcel for name, parcel in parcels(files).items() if name.startswith("case-")]
    assert '<span class="of-report"></span>. Case ' in head["page"]
    assert "revision A" not in head["page"]


def test_order_of_the_page_of_a_case():
    before = fixture.roll_result()
    html = page([replace(before, case=replace(before.case, notes="Flown in smooth air."))])
    parts = (
        "<h1 id=",
        'class="plain outcome"',
        'class="glance"',
        "<dt>half width</dt>",
        'class="panels"',
        "<h2>Tolerances and verdicts</h2>",
        "<h2>Notes</h2>",
        "<h2>Rationale</h2>",
        "<h2>Signatures</h2>",
        "<h2>Initial condition and trim</h2>",
    )
    places = [html.index(part) for part in parts]
    assert places == sorted(places)


def test_a_criterion_named_after_a_signal_has_its_words():
    assert verdict_text.criterion_words("r") == "body yaw rate"
    # a name that is a word already stays
    assert verdict_text.criterion_words("distance") == "distance"
    assert verdict_text.criterion_words("angle_of_attack") == "angle of attack"
    # an event keeps its own name
    assert verdict_text.plain_words("gear") == "gear"


def test_an_engineering_reference_and_its_share_are_reported():
    before = fixture.roll_result()
    html = page([replace(before, case=replace(before.case, reference="engineering", fraction=0.2))])
    assert "20 % of the tolerance applied" in html
    assert (
        "The reference is an engineering simulator, not a flight; 20 % of the flight "
        "tolerance is applied." in html
    )


def test_what_the_case_sets_against_record_and_table_is_reported():
    before = fixture.roll_result()
    result = replace(
        before,
        case=replace(
            before.case, shortened="the record ends", conditions={"delta_f": np.radians(40.0)}
        ),
    )
    html = page([result])
    assert "The window is shorter than the table requires: the record ends." in html
    assert (
        "From the case file, not from the record: flap deflection 40\N{NO-BREAK SPACE}deg." in html
    )


def test_a_case_without_an_objective_states_what_its_entry_compares():
    result = fixture.roll_result()
    case_of = replace(result.case, objective="", description="Wheel left, then released.")
    text = remarks.case_objective(case_of)
    assert text.startswith("Roll response (rate): roll rate")
    assert text.endswith(
        f"of the models against flight, within the tolerances of {result.case.id}."
    )
    html = page([replace(result, case=case_of)])
    assert text in html
    assert "<strong>Manoeuvre.</strong> Wheel left, then released." in html
    assert html.index('class="plots"') < html.index(
        'class="facts"'
    )  # in print the figure follows the head of the case
    assert remarks.case_objective(replace(case_of, reference="footprint")).endswith(
        "of the device, kept for later comparison."
    )


def test_an_aeroplane_at_rest_has_no_flow_angles():
    result = fixture.roll_result()
    table = result.trim.copy()
    names = {row["label"].name for _, rows in start.trim_tables(result)["parts"] for row in rows}
    assert "alpha" in names
    table.loc["V"] = 0.5
    still = {
        row["label"].name
        for _, rows in start.trim_tables(replace(result, trim=table))["parts"]
        for row in rows
    }
    assert names - still == {"alpha"}


def test_longest_runs_outside_are_one_note_per_model():
    result = fixture.roll_result()
    verdict = result.verdict.copy()
    set_rows(
        verdict,
        "run",
        "datcom",
        remarks=(
            RowRemark("outside", "longest run outside 1.50 s", values={"longest": 1.5}, unit="s"),
        ),
    )
    notes = remarks.reader_notes(replace(result, verdict=verdict))
    (note,) = [note for note in notes if note.subject == "datcom, longest run outside"]
    assert note.line.count("1.50 s") == len(result.case.criteria)


def dutch_roll():
    """A case judged by its mode: the flight rings with 3 s and damping 0.08, one model lies close,
    one does not ring.
    """
    import xarray as xr

    base = fixture.roll_result()
    time = np.arange(0.0, 20.0, 0.02)
    window, wd = (1.0, 19.5), 2 * np.pi / 3.0

    def ring(zeta, amplitude=0.1):
        return amplitude * np.exp(-zeta * wd / np.sqrt(1 - zeta**2) * time) * np.cos(wd * time)

    runs = {
        "flight": ring(0.08),
        "datcom": ring(0.08, 0.0),
        "corrected": ring(0.06),
        "final": ring(0.081),
    }
    signals = xr.Dataset(
        {"r": (("run", "time"), np.stack(list(runs.values())))}, {"run": list(runs), "time": time}
    )
    period = fixture.criterion(
        "period", "r", "g1", window, fixture.Limit("percent", 10.0, "%"), provenance="memory"
    )
    criteria = (
        replace(period, measure="period"),
        replace(period, name="damping_ratio", measure="damping_ratio", group="g2"),
    )
    case_ = replace(
        base.case, id="2.d.7", window=(0.0, 19.98), events={"input_end": 1.0}, criteria=criteria
    )
    from pom.judging.verdict import judge_criterion, verdict_row
    from pom.result import make_verdict_table

    flights = {run: {"r": values} for run, values in runs.items()}
    rows = [
        verdict_row(run, c, judge_criterion(case_, c, time, flights["flight"], flights[run]))
        for run in ("datcom", "corrected", "final")
        for c in criteria
    ]
    inputs = xr.Dataset({"delta_r": ("time", 0.1 * (time < 1.0))}, {"time": time})
    tolerance = xr.Dataset(coords={"time": time})
    return replace(
        base,
        case=case_,
        signals=signals,
        tolerance=tolerance,
        inputs=inputs,
        verdict=make_verdict_table(rows),
    )


@pytest.mark.slow
def test_table_of_modes(tmp_path):
    result = dutch_roll()
    table = mode_table(result)
    found = table.set_index("run")
    assert list(found.index) == ["flight", "datcom", "corrected", "final"]
    np.testing.assert_allclose(
        found.loc["flight", ["period", "damping_ratio", "cycles"]].astype(float),
        [3.0, 0.08, 18.5 / 3.0],
        rtol=1e-3,
    )
    assert found.loc["corrected", "damping_ratio"] == pytest.approx(0.06, rel=1e-4)
    assert "hardly oscillates" in found.loc["datcom", "note"]
    (block,) = modal.mode_blocks(result, table, case.run_line_classes(result.runs))
    assert [row["period"] for row in block["rows"]] == ["3.00", "–", "3.00", "3.00"]
    html = texts(write(tmp_path, results=[result], diagnoses={}).read_text(encoding="utf-8"))
    document = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert document["modes"]["roll_response_clean"][2]["damping_ratio"] == pytest.approx(
        0.06, rel=1e-4
    )
    assert "<h2>Modes</h2>" in html
    assert (
        "zeta 0.0" not in html[html.index("<h2>Notes</h2>") : html.index("<h2>Modes</h2>")]
    )  # printed in the table, not again in the notes
    assert html.count("from memory") >= 2


def test_biases_of_the_trim_are_marked_beyond_their_limit():
    table = fixture.trim(("datcom",))
    table.loc["trim.delta_e", "datcom"] = np.radians(-1.2)
    table.loc["trim.throttle"] = [np.nan, 0.0]
    parts = dict(start.trim_tables(replace(fixture.short_period_result(), trim=table))["parts"])
    found = [
        (row["label"].name, row["cells"], row["limit"]) for row in parts["Biases found by the trim"]
    ]
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
    shown = [(panel.channel, panel.kind) for panel in panels.make_case_panels(result)]
    assert ("engine1.thrust", "input") in shown
    assert "engine1.thrust_drive" not in dict(shown)


def test_a_control_that_a_pilot_moves_is_shown_with_the_models():
    result = fixture.roll_result()
    aileron = result.inputs["delta_a"].values
    result.signals["delta_a"] = (
        ("run", "time"),
        np.stack([aileron, 1.1 * aileron, aileron, aileron]),
    )
    panel = next(panel for panel in panels.make_case_panels(result) if panel.channel == "delta_a")
    assert panel.kind == "input"
    assert list(panel.traces) == ["flight", *fixture.RUNS]
