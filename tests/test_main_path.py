"""The main path as a newcomer calls it: listing, database, record, states, regression, new
database, FMU, replay, report.

T-37, clean, cruise: the terms in pitch are identified from an elevator 3-2-1-1 and proven on the
doublet that follows.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import aerodb
import datcom_io
import flightmech
import flighttest
import pom
from flightmech.errors import AeromatchWarning

pytestmark = pytest.mark.slow

DATA = Path(__file__).parents[1] / "data" / "t37"
RECORD = DATA / "flight" / "t37_02_clean_cruise_5kft.nc"
IDENTIFIED = (9.0, 21.7)  # 3-2-1-1, from the list of manoeuvres in the record
PROVEN = (38.9, 48.9)  # doublet; its input starts at 39.9 s
CASE = f"""
[case]
id = "2.c.10"
name = "doublet"
title = "Short period, clean, cruise"
record = "{RECORD}"
names = "{DATA / "names.toml"}"
window = [{PROVEN[0]}, {PROVEN[1]}]
"""


@pytest.fixture(scope="module")
def aircraft():
    return flightmech.read_aircraft(DATA / "aircraft.toml")


@pytest.fixture(scope="module")
def prior(aircraft):
    clean = datcom_io.read(DATA / "datcom" / "t37_clean.out")
    elevator = datcom_io.read(DATA / "datcom" / "t37_elevator_one_by_one.pdas.out")
    return aerodb.from_datcom(aircraft, clean=clean, elevator=elevator)


@pytest.fixture(scope="module")
def path(aircraft):
    record = flighttest.read(RECORD, DATA / "names.toml")
    flown = flighttest.records.marked_manoeuvres(record)
    assert (flown["start"] == IDENTIFIED[0]).any()
    assert (
        (flown["manoeuvre"] == "doublet") & (flown["start"] - PROVEN[0]).between(0.0, 1.0)
    ).any()
    return flighttest.reconstruct(record, aircraft, windows=[(8.0, 22.0), (38.0, 49.0)])


@pytest.fixture(scope="module")
def fits(path, aircraft):
    data = flighttest.select_time(flighttest.coefficients(path, aircraft, cutoff=4.0), *IDENTIFIED)
    models = (
        "CL = 1 + alpha + qhat + delta_e",
        "CD = 1 + alpha + alpha**2",
        "Cm = 1 + alpha + qhat + delta_e",
    )
    return [
        flighttest.regress(flighttest.RegressionModel.parse(model), data, name="3211")
        for model in models
    ]


@pytest.fixture(scope="module")
def final(fits, prior):
    # DATCOM gives the drag of a smooth aeroplane.
    with pytest.warns(AeromatchWarning, match="incompatible fits: CD"):
        tables = aerodb.tabulate(fits, prior, held=["CL/altitude", "CD/altitude", "Cm/altitude"])
    return aerodb.replace_terms(prior, tables)


def CL_alpha(db, data):
    """Return the lift-curve slope of a database in the middle of the flown range. [1/rad]"""
    at = {name: float(data[name].mean()) for name in ("mach", "h", "delta_e")}
    low, high = np.quantile(data["alpha"], [0.1, 0.9])
    zero = dict.fromkeys(("qhat", "alphadothat"), 0.0)
    CL = aerodb.evaluate(db, "CL", alpha=np.array([low, high]), **at, **zero)
    return float(np.diff(CL)[0] / (high - low))


def test_flight_moves_the_lift_slope(prior, final, fits):
    fit = fits[0]
    local = float(fit.estimates["estimate"].sel(term="alpha"))
    datcom, identified = CL_alpha(prior, fit.data), CL_alpha(final, fit.data)
    assert 3.5 < local < 6.0  # a straight wing of aspect ratio 6.3 [1/rad]
    assert abs(identified - local) < 0.3 * abs(datcom - local)


def test_flight_narrows_what_it_has_seen(prior, final, fits):
    """Standard errors shrink at the nodes that were flown; terms no model looks at stay as they
    were.
    """
    flown = {"mach": 0.3, "alpha": np.radians(2.0)}
    before, after = (
        aerodb.terms(db)["CL/basic"]["stderr"].sel(flown, method="nearest") for db in (prior, final)
    )
    assert float(after) < 0.5 * float(before)
    changed = aerodb.compare(prior, final)
    assert (changed.loc[["Cl/beta", "CY/beta", "Cn/rhat"], "max_difference"] == 0.0).all()
    assert changed.loc["Cm/elevator", "max_difference"] != 0.0


def test_replay_proves_the_final_model(prior, final, aircraft, path, tmp_path):
    (tmp_path / "case.toml").write_text(CASE)
    case = pom.read_case(tmp_path / "case.toml")
    runs = {
        name: flightmech.write_fmu(flightmech.compile(aircraft, db), tmp_path / f"{name}.fmu")
        for name, db in (("datcom", prior), ("final", final))
    }
    result = pom.replay(case, runs, path)
    assert result.failure == ""
    # every row is within its tolerance; the lateral terms are still those of DATCOM, so the trim
    # leaves accelerations
    assert set(result.groups("final").values()) == {"pass"}
    assert result.status("final") == "limits_exceeded"
    assert not result.passed("datcom")
    worst = result.verdict.groupby("run")["worst_ratio"].max()
    assert worst["final"] < 0.5 * worst["datcom"]
    report = pom.write_report([result], tmp_path / "report", title="T-37")
    numbers = json.loads((report.parent / "results.json").read_text())
    assert numbers["results"][0]["status"]["final"] == "limits_exceeded"
    assert "Short period, clean, cruise" in report.read_text(encoding="utf-8")
