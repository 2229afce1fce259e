"""The Citation II flights of ../shared as the stations need them: records with mass, c.g. and
thrust; windows; a prior database.

What the recordings lack is computed from the data set's own sheets, by the plans of the evaluation
(``maps/evaluate_*.toml``): mass and c.g. from the loading sheet, the fuel-moment table and the
integral of the fuel flow; thrust from the fuel flow with the points of the engine deck.  Flaps were
not recorded: up.
"""

from functools import lru_cache
from pathlib import Path

import pandas as pd
import xarray as xr

import aerodb
import flightmech
import flighttest
from flightmech import terms
from flightmech.names import quantity_attributes
from flighttest.flight_programme.evaluation.mass_and_thrust import add_computed_mass
from flighttest.flight_programme.evaluation.plan import read_plan

HERE = Path(__file__).parent
FLIGHTS = HERE.parents[1] / ".." / "shared" / "data" / "flight" / "citation_phlab"
FILES = {2018: "20180312_1", 2019: "20190305_2", 2020: "20200310_2"}
RECORDS = {2018: "flight_20180312_1", 2019: "flight_20190305_2_partial", 2020: "flight_20200310_2"}
ABSENT = "the Citation II flights (../shared/data/flight/citation_phlab) are not here"
THRUST_ERROR = {
    "thrust": 0.05
}  # deck against the flown engines; the fit of the deck itself is good to 5 N
# In 150 s of recorded aileron and rudder every model rolls into a turn that the crew did not fly.
WINGS_HELD = """
[drive]
surfaces = "pilot"
engine = "thrust"
[[drive.pilot]]
control = "delta_a"
channel = "phi"
gain = "-0.3 deg/deg"
integral = "-0.03 deg/deg s"
limit = "5 deg"
[[drive.pilot]]
control = "delta_a"
channel = "p"
gain = "-0.15 deg s/deg"
limit = "3 deg"
"""

# What DATCOM does not give and the flights shall bring in, with the standard error of not knowing.
OPENED = {
    "CY/basic": ("", 0.01),
    "CY/rhat": ("rhat", 0.5),
    "CY/rudder": ("delta_r", 0.3),
    "Cl/basic": ("", 0.002),
    "Cl/rudder": ("delta_r", 0.05),
    "Cn/basic": ("", 0.002),
    "Cn/rudder": ("delta_r", 0.15),
}


@lru_cache
def aircraft():
    return flightmech.read_aircraft(HERE / "maps" / "citation.toml")


def names(year):
    return HERE / "maps" / f"citation_{year}.toml"


def start(year, motion):
    table = pd.read_csv(FLIGHTS / f"manoeuvres_{FILES[year]}.csv").set_index("motion")
    return float(table.loc[motion, "t_start_s"])


def plan(year):
    """Return the plan by which `flight report` evaluates a flight; mass, c.g. and thrust follow
    from its sheets.
    """
    return read_plan(HERE / "maps" / f"evaluate_{year}.toml")


@lru_cache
def record(year):
    """Return a record with mass and c.g., and thrust where temperature was recorded."""
    found = add_computed_mass(
        flighttest.read(FLIGHTS / f"{RECORDS[year]}.csv.gz", names(year)),
        aircraft(),
        plan(year).loading,
        plan(year).thrust,
    )
    data = found["computed"].to_dataset()
    up = xr.zeros_like(data["mass"]).assign_attrs(
        quantity_attributes("delta_f")
    )  # flaps up in all manoeuvres
    return found.assign({"computed": xr.DataTree(data.assign(delta_f=up))})


def stationary_windows(year, *series):
    """Return the 30 s before the stationary points of series (``clcd``, ``trim``); the crew changed
    power right after them.
    """
    points = pd.read_csv(FLIGHTS / f"stationary_{FILES[year]}.csv")
    times = sorted(points.loc[points["series"].isin(series), "t_s"].unique())
    return [(time - 30.0, time - 1.0) for time in times]


@lru_cache
def stationary(year):
    """Return the path through all stationary points; its constants are the prior of the
    manoeuvres.
    """
    return flighttest.reconstruct(
        record(year), aircraft(), windows=stationary_windows(year, "clcd", "trim"), rate=10.0
    )


@lru_cache
def path(year, motion, begin, end):
    """Return the path from `begin` to `end` seconds of a motion, at 50 Hz: a recording of 10 Hz
    still has slopes between its samples.
    """
    t = start(year, motion)
    return flighttest.reconstruct(
        record(year), aircraft(), windows=[(t + begin, t + end)], prior=stationary(year).biases
    )


@lru_cache
def coefficients(year, motion, begin, end):
    return flighttest.coefficients(path(year, motion, begin, end), aircraft(), errors=THRUST_ERROR)


@lru_cache
def stationary_parts(year, *series):
    data = flighttest.coefficients(stationary(year), aircraft(), errors=THRUST_ERROR)
    return [
        flighttest.select_time(data, *window)
        for window in stationary_windows(year, *(series or ("clcd", "trim")))
    ]


def fit(model, data, name=""):
    return flighttest.regress(flighttest.RegressionModel.parse(model), data, name=name)


@lru_cache
def fits_of(year):
    """Return the local models of one flight: lift and drag from rest points and short period, the
    rest from its motions.
    """
    rest, pitch = stationary_parts(year), coefficients(year, "short_period", -3.0, 14.0)
    lateral = [
        coefficients(year, "dutch_roll", -3.0, 16.0),
        coefficients(year, "aperiodic_roll", -3.0, 20.0),
    ]
    return [
        fit("CL = 1 + alpha + delta_e", [*rest, pitch], "rest points and short period"),
        fit("CD = 1 + CL**2", rest, "rest points"),
        fit("Cm = 1 + alpha + qhat + alphadothat + delta_e", [pitch], "short period"),
        fit("CY = 1 + beta + rhat + delta_r", lateral, "Dutch roll and roll"),
        fit("Cl = 1 + beta + phat + rhat + delta_a + delta_r", lateral, "Dutch roll and roll"),
        fit("Cn = 1 + beta + phat + rhat + delta_a + delta_r", lateral, "Dutch roll and roll"),
    ]


def similar(db):
    """Return a database of the CE-500 for the larger Citation II: the same coefficients, other
    reference lengths; new terms opened.
    """
    larger = db.copy()
    larger.attrs.update(
        S=aircraft().S, cbar=aircraft().cbar, b=aircraft().b, aircraft=aircraft().name
    )
    larger.attrs.update(zip(("x_ref", "y_ref", "z_ref"), aircraft().reference))
    opened = {
        name: terms.make_term(0.0, {}, word.split(), stderr=stderr, source="judgement")
        for name, (word, stderr) in OPENED.items()
    }
    return aerodb.replace_terms(
        larger, opened, note="geometrically similar; terms that DATCOM lacks opened"
    )
