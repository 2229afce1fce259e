"""The stall rows of 2016 are judged end to end: flown records, replay by the final model of the
T-37, verdict.

The records are those of `fly_rows`. The model has no stall: it comes to the warning, not to the
stall, and 2.c.8.a is invalid. The aeroplane has neither stick pusher nor buffet.
"""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from flightmech.units import DEGREE, KNOT
from pom.cases.case import read_case
from pom.checking.report_checks import with_report_checks
from pom.judging.conditions.row_conditions import condition_remarks
from pom.judging.signals import RunSignals
from pom.replaying.batch import replay_all

CASES = {file.stem: file for file in (Path(__file__).parent / "stall_rows").glob("*.toml")}
NO_NUMBER = "the number of this row was not read in this edition"


def texts(row):
    return "; ".join(item.text for item in row["remarks"])


def test_the_approach_to_stall_is_entered_as_the_row_asks():
    case = read_case(CASES["2.c.8.b"])
    with xr.open_dataset(case.record) as record:
        time, alpha = record["time"].values, record["alpha"].values
        speed = record["V"].values * np.sqrt(record["p_static"].values / 101325.0)
    flight = {"alpha": alpha, "V_cas": speed}
    flight |= {name: np.zeros(time.size) for name in ("phi", "gear", "delta_f")}
    departures = []
    for remark in condition_remarks(case, RunSignals(flight, time)):
        if remark.kind == "departure":
            departures.append(remark.text)
    assert departures == []
    # the warning comes before the break of this aeroplane, at 14.9 deg, and the stall does not
    warning = float(np.interp(case.events["stall_warning"], time, alpha))
    assert warning / DEGREE == pytest.approx(12.5, abs=0.1)
    assert alpha.max() / DEGREE == pytest.approx(14.8, abs=0.1)
    before = (time > 14.0) & (time < 24.0)
    assert -np.polyfit(time[before], speed[before], 1)[0] / KNOT == pytest.approx(1.05, abs=0.1)


@pytest.mark.slow
def test_the_stall_rows_are_judged(demo):
    folder, _ = demo
    order = ("2.a.10", "2.c.8.a", "2.c.8.b", "3.f.5")
    assert set(order) == set(CASES)
    cases = [read_case(CASES[name]) for name in order]
    results = with_report_checks(replay_all(cases, {"final": folder / "final.fmu"}))
    found = dict(zip(order, results, strict=True))
    status = {name: result.status("final") for name, result in found.items()}
    assert status == {
        "2.a.10": "not_tested",
        "2.c.8.a": "invalid",
        "2.c.8.b": "pass",
        "3.f.5": "not_tested",
    }
    for name in ("2.a.10", "3.f.5"):
        (row,) = found[name].rows
        assert NO_NUMBER in texts(row)
    verdicts = {row["criterion"]: row["verdict"] for row in found["2.c.8.b"].rows}
    assert verdicts == {"stall_warning_speed": "pass", "bank_angle": "pass"}
    full = {row["criterion"]: row for row in found["2.c.8.a"].rows}
    assert full["stall_warning_speed"]["verdict"] == "pass"
    assert full["stall_speed"]["verdict"] == "invalid"
    assert "does not come to stall" in texts(full["stall_speed"])
