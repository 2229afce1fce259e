"""What the code blocks of the pages must result in: a check for every block whose output the page
does not print.

A check gets the folder in which the commands ran and what the block printed.  Keys of `CHECKS` are
the page and the number of the block on it, from 0.  `tests/test_docs.py` calls the check behind the
block; `tests/test_docs_results.py` demands one for every block.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

import aerodb
import flightmech
import flighttest
import pom

ROOT = Path(__file__).parents[1]
Check = Callable[[Path, str], None]
_STEADY = 20  # samples of 0.02 s before the input, for the mean of what is recorded with noise
ALIVE = 0.01  # change of a rate by 0.1 rad of a control that counts as an effect [rad/s]


def effect(sim: flightmech.SimModel, control: str, rate: str) -> float:
    """Return the largest change of a rate in 4 s by a step of -0.1 rad of a control, from level
    flight at 100 m/s. [rad/s]
    """
    time = np.arange(0.0, 4.0, 0.02)
    start = {"init.V": 100.0, "init.h": 1500.0}
    deflections = (np.zeros(time.size), np.where(time > 1.0, -0.1, 0.0))
    still, moved = (
        flightmech.simulate(sim, xr.Dataset({control: ("time", d)}, {"time": time}), start)[
            rate
        ].values
        for d in deflections
    )
    return float(np.abs(moved - still).max())


def replayed_pitch_rate(
    sim: flightmech.SimModel, record: str, start: float, stop: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the pitch rate of a flight of the T-37, and that of a model that gets the recorded
    elevator from its trim on. [rad/s]
    """
    flight = flighttest.read(
        ROOT / "data" / "t37" / "flight" / f"{record}.nc", ROOT / "data" / "t37" / "names.toml"
    )
    time = np.arange(start, stop, 0.02)
    q, elevator = (
        np.interp(time, one["time"].values, one.values)
        for one in (flight["imu/q"], flight["controls/delta_e"])
    )
    inputs = xr.Dataset(
        {"delta_e": ("time", elevator - elevator[:_STEADY].mean())}, {"time": time - start}
    )
    begin = {
        "init.V": 100.0,
        "init.h": 1500.0,
        "mass.mass": 2110.0,
        "mass.z_cg_b": 0.2235,
    }  # of the record
    return q - q[:_STEADY].mean(), flightmech.simulate(sim, inputs, begin)["q"].values


def prior_of_own_aircraft(folder: Path, printed: str) -> None:
    terms = aerodb.terms(aerodb.open(folder / "prior.nc"))
    assert {"CL/basic", "CL/elevator", "Cm/elevator"} <= set(terms)
    assert "static_margin_fixed" in printed
    sim = flightmech.compile(
        flightmech.read_aircraft(folder / "aircraft.toml"), aerodb.open(folder / "prior.nc")
    )
    assert effect(sim, "delta_e", "q") > ALIVE


def project_of_own_aircraft(folder: Path, printed: str) -> None:
    names = tomllib.loads((folder / "mine" / "names.toml").read_text(encoding="utf-8"))
    assert "delta_e" in {
        channel for group in names.values() if isinstance(group, dict) for channel in group
    }
    manoeuvres = (folder / "mine" / "manoeuvres.csv").read_text(encoding="utf-8")
    assert "elevator" in manoeuvres


def fmu_of_own_aircraft(folder: Path, printed: str) -> None:
    assert (folder / "prior.fmu").stat().st_size > 10_000
    assert "delta_e" in printed


def control_law_database(folder: Path, printed: str) -> None:
    sim = flightmech.compile(
        flightmech.read_aircraft(folder / "data/t37/aircraft.toml"), aerodb.open(folder / "t37.nc")
    )
    assert effect(sim, "delta_e", "q") > ALIVE
    assert effect(sim, "delta_a", "p") > ALIVE


def gear_from_flight(folder: Path, printed: str) -> None:
    assert flightmech.read_aircraft(folder / "with_gear.toml").gear is not None


def one_pass(folder: Path, printed: str) -> None:
    assert "pass" in printed
    assert "FAIL" not in printed


def batch(folder: Path, printed: str) -> None:
    assert len(verdicts(folder / "report")) == 2
    # their records end before the windows of the rows do
    assert verdicts(folder / "report") == ["pass_with_departures"] * 2
    assert any((folder / "flights").iterdir())


def own_fmu(folder: Path, printed: str) -> None:
    assert verdicts(folder / "report") == ["pass_with_departures"]


def verdicts(report: Path) -> list[str]:
    """Return the status of the cases of a report with one model, in order."""
    return [
        result.status(run) for result in pom.read_archive(report).results for run in result.runs
    ]


def contains(*words: str) -> Check:
    """Return a check that the block prints all words."""

    def check(folder: Path, printed: str) -> None:
        missing = [word for word in words if word not in printed]
        assert not missing, f"{missing} not in {printed}"

    return check


def files(*names: str) -> Check:
    """Return a check that the block leaves files that are not empty."""

    def check(folder: Path, printed: str) -> None:
        for name in names:
            assert (folder / name).stat().st_size > 0, name

    return check


def empty_project_folder(folder: Path, printed: str) -> None:
    """The verb that serves the folder runs until it is interrupted: only the folder is made."""
    assert list((folder / "mine").iterdir()) == []


def log_findings(folder: Path, printed: str) -> None:
    assert "<html" in (folder / "quality.html").read_text(encoding="utf-8")
    assert len((folder / "manoeuvres.csv").read_text(encoding="utf-8").splitlines()) > 1
    assert (folder / "manoeuvres.png").read_bytes().startswith(b"\x89PNG")
    assert (
        sum(
            variable.size
            for node in flighttest.read(folder / "flight.nc").subtree
            for variable in node.data_vars.values()
        )
        > 1000
    )


def log_path(folder: Path, printed: str) -> None:
    states = xr.open_datatree(folder / "path.nc", engine="h5netcdf", decode_timedelta=False)
    found = [node["alpha"].values for node in states.subtree if "alpha" in node]
    assert found
    assert all(np.isfinite(alpha).all() for alpha in found)


def comparison_of_databases(folder: Path, printed: str) -> None:
    """Flight changed the pitch damping by many standard errors, and the figures are there."""
    assert "Cm/qhat" in printed
    assert (folder / "lift.svg").stat().st_size > 0
    assert any((folder / "folder").iterdir())


def manoeuvres_of_a_record(folder: Path, printed: str) -> None:
    table = (folder / "manoeuvres.csv").read_text(encoding="utf-8")
    assert "3211" in table
    assert (folder / "manoeuvres.png").read_bytes().startswith(b"\x89PNG")


def output_error_of_a_manoeuvre(folder: Path, printed: str) -> None:
    """The elevator is weaker and the lift slope smaller than those of DATCOM."""
    before, after = (
        aerodb.terms(aerodb.open(folder / name)) for name in ("out/t37/datcom.nc", "fitted.nc")
    )
    for term in ("CL/basic", "Cm/elevator"):
        assert np.abs(after[term]["value"]).max() < np.abs(before[term]["value"]).max(), term
    assert "<html" in (folder / "pitch.html").read_text(encoding="utf-8")


def linear_motion_of_a_manoeuvre(folder: Path, printed: str) -> None:
    """The pitching motion is stable and damped, and the elevator pitches the nose down."""
    with xr.open_datatree(folder / "short_period.nc", engine="h5netcdf") as tree:
        fit = next(node for node in tree.subtree if "estimate" in node)
        estimates = fit["estimate"].load()
    values = dict(zip(estimates[estimates.dims[0]].values, estimates.values))
    for name in ("M_alpha", "M_q", "M_delta_e"):
        assert values[name] < 0.0, name


def front_page(names: dict) -> None:
    """The elevator of the model acts, and it answers the elevator doublet of another record as that
    flight does.
    """
    terms = aerodb.terms(names["final"])
    for term in ("CL/elevator", "Cm/elevator", "CL/basic", "Cm/basic"):
        assert not np.array_equal(
            terms[term]["value"].values, aerodb.terms(names["prior"])[term]["value"].values
        ), f"{term} was not learnt"
    before, after = (
        flightmech.compile(names["aircraft"], names[one]) for one in ("prior", "final")
    )
    assert effect(after, "delta_e", "q") > ALIVE
    flown, answer = replayed_pitch_rate(after, *DOUBLET)
    _, handbook = replayed_pitch_rate(before, *DOUBLET)
    # rms of the difference over rms of the flight: 0.25 after, 2.2 before, whose pitch damping is a
    # third of that of the aeroplane
    size = np.sqrt(np.mean(flown**2))
    assert np.sqrt(np.mean((answer - flown) ** 2)) < 0.35 * size
    assert np.sqrt(np.mean((handbook - flown) ** 2)) > 1.5 * size
    assert Path("final.fmu").stat().st_size > 10_000


DOUBLET = ("t37_02_clean_cruise_5kft", 39.4, 46.0)  # doublet of 1.2 s each way
PYTHON: dict[tuple[str, int], Callable[[dict], None]] = {
    ("README.md", 1): front_page,
    ("docs/index.md", 1): front_page,
}
"""Blocks of Python that are executed as printed, in a folder with the checkout's ``data``; the
check gets the names that they leave.
"""

FOR_READING = {
    ("docs/index.md", 0): "printed by ./run demo; tests/aeromatch/test_demo.py compares it",
    ("docs/how-to/own-aircraft.md", 3): "a part of an aircraft file; "
    "tests/flighttest/reconstruction/test_deck_thrust.py has such decks",
    ("docs/how-to/fit-a-manoeuvre.md", 4): "a table of a plan; "
    "tests/flighttest/cli/test_fit.py runs such tables",
    ("docs/how-to/data-package.md", 2): "printed by package diff; "
    "tests/aeromatch/delivery/test_package.py compares the models",
    **dict.fromkeys(
        [("docs/tutorials/light-aircraft.md", number) for number in (4, 5, 10)],
        "parts of the finished files; tests/aeromatch/test_examples.py compares them",
    ),
}
"""Blocks that are not code."""

CHECKS: dict[tuple[str, int], Check] = {
    ("docs/how-to/data-package.md", 0): contains("hold"),
    ("docs/how-to/data-package.md", 1): contains("signed by the known key"),
    ("docs/how-to/own-aircraft.md", 1): prior_of_own_aircraft,
    ("docs/how-to/own-aircraft.md", 2): fmu_of_own_aircraft,
    ("docs/how-to/own-aircraft.md", 4): project_of_own_aircraft,
    ("docs/how-to/control-law.md", 0): control_law_database,
    ("docs/how-to/add-a-submodel.md", 0): gear_from_flight,
    ("docs/how-to/add-a-submodel.md", 1): one_pass,
    ("docs/how-to/batch-on-a-cluster.md", 0): files("scheduler.pid", "worker.pid"),
    ("docs/how-to/batch-on-a-cluster.md", 1): batch,
    ("docs/how-to/certify-a-report.md", 0): contains("all as it was"),
    ("docs/how-to/certify-a-report.md", 1): contains("all as it was"),
    ("docs/how-to/certify-a-report.md", 2): files("revision_b/manifest.json.sig"),
    ("docs/how-to/certify-a-report.md", 3): contains("signed by office", "all as it was"),
    ("docs/how-to/own-fmu.md", 0): contains("delta_e"),
    ("docs/how-to/own-fmu.md", 2): own_fmu,
    ("docs/how-to/check-a-record.md", 0): contains("sound: 0 errors"),
    ("docs/how-to/compare-databases.md", 0): comparison_of_databases,
    ("docs/how-to/compare-databases.md", 1): files(
        "figures/figure-12.svg", "figures-2/figure-12.pdf"
    ),
    ("docs/how-to/convert-datcom-files.md", 0): contains("is not the plot file of other.out"),
    ("docs/how-to/edit-a-database.md", 0): files("before.nc"),
    ("docs/how-to/edit-a-database.md", 2): files("flown.nc", "d.nc"),
    ("docs/how-to/fit-a-manoeuvre.md", 0): files("02.nc"),
    ("docs/how-to/fit-a-manoeuvre.md", 3): output_error_of_a_manoeuvre,
    ("docs/how-to/fit-a-manoeuvre.md", 5): linear_motion_of_a_manoeuvre,
    ("docs/how-to/fit-a-manoeuvre.md", 6): files("board.csv"),
    ("docs/how-to/workbench.md", 1): empty_project_folder,
    ("docs/how-to/reconstruct-a-flight.md", 0): files("record.png", "pitch.svg"),
    ("docs/how-to/reconstruct-a-flight.md", 1): manoeuvres_of_a_record,
    ("docs/how-to/split-and-run-decks.md", 2): files("results/flaps.out"),
    ("docs/how-to/split-and-run-decks.md", 4): contains("nothing was written"),
    ("docs/how-to/uav-log.md", 0): contains("Hz"),
    ("docs/how-to/uav-log.md", 2): log_findings,
    ("docs/how-to/uav-log.md", 3): log_path,
}

NOTEBOOK = """
assert set(result.runs) == {"datcom", "identified"}
assert result.status("identified") == "pass_with_departures"
remarks = result.verdict.query("run == 'identified'").remarks.explode()
departures = {remark.quantity: remark.values for remark in remarks if remark.kind == "departure"}
assert list(departures) == ["CL"]
assert 1.05 < departures["CL"]["slope"] < 1.07  # 1.054, as the text states
assert result.worst("identified")["worst_ratio"] < result.worst("datcom")["worst_ratio"]
for term in ("CL/basic", "Cm/basic", "Cm/elevator", "Cm/qhat"):
    assert updated[term].attrs["decision"] in ("replace", "correct"), term
"""
"""Code that runs behind the last cell of the notebook."""

UAV_NOTEBOOK = """
assert list(marks["manoeuvre"]) == ["3211", "doublet"]
assert marks.attrs["origin"] == "found"
assert moment.estimates.attrs["R2"] > 0.9
slopes = moment.to_dataframe()["estimate"]
assert slopes["alpha"] < 0.0 and slopes["qhat"] < 0.0 and slopes["delta_e"] < 0.0
"""
"""The same for the notebook of the log of a UAV."""

NOTEBOOK_WARNINGS = ("incompatible fits: CD",)
"""Warnings that the text of the notebook announces."""
