"""Ten deceptions of further kinds, and the word of the program that names each.

    aeromatch demo -o out/t37
    python benchmarks/ten_deceptions.py out/t37

Models that switch, files under one name, recordings, masters, tables and records: what neither
`deceptions.py` nor `more_deceptions.py` has.  Printed: a line each.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from deceptions import DATA, RUN, Bench, Deception, count_named, judge
from scipy.ndimage import gaussian_filter1d

import aerodb
import flightmech
from flightmech.errors import AeromatchError
from pom.cases.case import read_case
from pom.checking.report_checks import with_joined_checks, with_report_checks
from pom.replaying.batch import replay_all
from pom.replaying.recorded_runs import MasterRun, RecordedRun, RecordedRuns
from pom.replaying.replay_case import plan_of
from pom.result import PomResult
from pom.result_notices import run_notices
from pom.tolerances.own_tables import read_own_table
from pom.tolerances.rows import tolerance_rows

Outputs = dict[str, np.ndarray]
Judged = tuple[list[str], str]


def stated(results: list[PomResult], run: str = RUN) -> Judged:
    """Return the statuses of a run, and its notices."""
    texts = []
    for result in results:
        texts += [result.case.name, result.status(run), *run_notices(result, run), result.failure]
    return [result.status(run) for result in results], "\n".join(texts)


def smoothed(values: np.ndarray) -> np.ndarray:
    return gaussian_filter1d(values, 12.0)


def switches_by_time(b: Bench) -> Judged:
    """A wrong model until the controls have moved, then the stored flight."""

    def answer(honest: Outputs, own: Outputs, flight: Outputs) -> Outputs:
        out = dict(own)
        for name, values in own.items():
            if name in flight:
                late = np.arange(values.size) > values.size // 2
                out[name] = np.where(late, smoothed(flight[name]), values)
        return out

    return judge(Deception([b.case("21")], b.final, answer=answer))


def knows_its_inputs(b: Bench) -> Judged:
    """A wrong model that answers by the flight where the inputs are those of the record."""

    def answer(honest: Outputs, own: Outputs, flight: Outputs) -> Outputs:
        if any(not np.array_equal(own[name], honest[name]) for name in own if name in honest):
            return own
        out = dict(own)
        for name, values in own.items():
            if name in flight:
                out[name] = values + 0.8 * smoothed(flight[name] - values)
        return out

    return judge(Deception([b.case("21")], b.spoilt(Cm__qhat=0.4), answer=answer))


def one_name_two_models(b: Bench) -> Judged:
    """Two reports, each flown by the model that suits it, are joined under one name."""
    first = replay_all([read_case(b.case("21"))], {RUN: b.final}, jobs=1)
    second = replay_all([read_case(b.case("22"))], {RUN: b.spoilt(Cm__qhat=0.7)}, jobs=1)
    return stated(with_joined_checks([*with_report_checks(first), *with_report_checks(second)]))


def recorded_runs(b: Bench, name: str, change: Callable[[Outputs], Outputs]) -> tuple:
    """Return a case, and its flight as the recording of a device."""
    case = read_case(b.case(name))
    states = plan_of(case).states
    clock = states["time"].values.astype(float)
    traces = {}
    for channel, item in states.data_vars.items():
        if item.dims == ("time",):
            traces[str(channel)] = item.values.astype(float)
    channels = {channel: (clock, values) for channel, values in change(traces).items()}
    return case, RecordedRun(channels, "device.csv, recording, sha256 0", "recording of a device")


def filtered_recording(b: Bench) -> Judged:
    """The flight record, smoothed, as the recording of a device."""
    motion = ("p", "q", "r", "phi", "theta", "psi", "alpha", "beta", "nz", "ny", "V", "V_cas", "h")

    def change(traces: Outputs) -> Outputs:
        out = dict(traces)
        for name in motion:
            if name in out:
                out[name] = gaussian_filter1d(out[name], 4.0)
        return out

    case, run = recorded_runs(b, "27", change)
    recorded = {case.name: RecordedRuns({RUN: run})}
    return stated(replay_all([case], {}, recorded=recorded, jobs=1))


def master_of_another_flight(b: Bench) -> Judged:
    """The recurrent run is compared with a master that flew another record."""
    case, run = recorded_runs(b, "21", lambda traces: traces)
    (flown,) = replay_all([case], {RUN: b.final}, jobs=1)
    other = {name: (clock, 1.2 * values) for name, (clock, values) in run.channels.items()}
    model = {}
    for name in map(str, flown.signals.data_vars):
        item = flown.signals[name].sel(run=RUN)
        model[name] = (flown.signals["time"].values, item.values)
    line = RecordedRun(model, "", "earlier report", has_inputs=False)
    flight = RecordedRun(other, "", "", has_inputs=False)
    master = MasterRun(f"{RUN}-master", line, 0.2, flight=flight)
    recorded = {case.name: RecordedRuns(masters={RUN: master})}
    results = replay_all([case], {RUN: b.final}, recorded=recorded, jobs=1)
    return stated(results)


def table_in_other_units(b: Bench) -> Judged:
    """A tolerance table under the name of the regulation whose degrees became 57 times as wide."""
    case = b.case("21")
    path = b.file(".csv")
    rows = [dict(row) for row in tolerance_rows()]
    for row in rows:
        if row["test_id"] == "2.c.10" and row["unit"] == "deg":
            row["lower"], row["upper"] = f"-{85.9}", "85.9"
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    read = read_case(case, read_own_table(path))
    return stated(replay_all([read], {RUN: b.spoilt(Cm__qhat=0.4)}, jobs=1))


def table_with_swapped_sides(b: Bench) -> Judged:
    """A tolerance table with lower and upper limit exchanged."""
    path = b.file(".csv")
    rows = [dict(row) for row in tolerance_rows()]
    for row in rows:
        row["lower"], row["upper"] = row["upper"], row["lower"]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [*rows[0]])
        writer.writeheader()
        writer.writerows(rows)
    try:
        read_own_table(path)
    except AeromatchError as error:
        return ["refused"], str(error)
    return ["accepted"], ""


def reversed_record(b: Bench) -> Judged:
    """A power slam, and its reversal in time as a second condition."""
    (source,) = (DATA / "flight").glob("t37_24_*.nc")
    tree = xr.open_datatree(source, engine="h5netcdf").load()
    rates = ("p", "q", "r")
    for node in tree.subtree:
        item = node.to_dataset().copy()
        for name, values in item.data_vars.items():
            if values.dims and values.dtype.kind == "f":
                sign = -1.0 if name in rates else 1.0
                item[name] = (values.dims, sign * values.values[::-1], values.attrs)
        node.dataset = item
    path = b.file(".nc")
    tree.to_netcdf(path, engine="h5netcdf")
    again = b.case("24", ('name = "power_slam"', 'name = "again"'), record=path)
    return judge(Deception([b.case("24"), again], b.final))


def edited_flown_cell(b: Bench) -> Judged:
    """A model whose tables differ from the evidence only in the nodes that the case flies."""
    database = aerodb.open(b.demo / "final.nc")
    leaf = aerodb.terms(database)["Cm/basic"].copy(deep=True)
    alpha = leaf["alpha"].values
    near = np.exp(-(((alpha - np.radians(4.0)) / np.radians(3.0)) ** 2))
    shape = [-1 if dim == "alpha" else 1 for dim in leaf["value"].dims]
    leaf["value"] = leaf["value"] + 0.02 * near.reshape(shape)
    database = aerodb.replace_terms(database, {"Cm/basic": leaf})
    path = b.file(".fmu")
    aircraft = flightmech.read_aircraft(b.demo / "final.toml")
    flightmech.write_fmu(flightmech.compile(aircraft, database), path)
    evidence = aerodb.open(b.demo / "final.nc")
    return judge(Deception([b.case("26")], path, evidence=evidence))


def start_that_absorbs_the_miss(b: Bench) -> Judged:
    """The record is distorted in its first second, so that the model starts as it needs."""

    def distort(channel, clock, values):
        size = {"theta": np.radians(1.2), "V_tas": 1.5, "V_cas": 1.5}.get(channel)
        if size is None:
            return None
        return values + size * np.clip(1.0 - (clock - 5.0) / 1.5, 0.0, 1.0)

    return judge(Deception([b.case("26", record=b.record("26", distort))], b.final))


def wind_that_absorbs_the_miss(b: Bench) -> Judged:
    """A vertical wind in the reconstructed path that takes up what a wrong model misses."""
    case = read_case(b.case("26"))
    states = plan_of(case).states
    wrong = b.spoilt(CL__basic=1.05)
    t = states["time"].values
    gust = 0.6 * np.sin(2.0 * np.pi * (t - t[0]) / 35.0)
    blown = states.assign(wind_d=("time", gust))
    results = replay_all([case], {RUN: wrong}, {Path(case.record).stem: blown}, jobs=1)
    return stated(with_report_checks(results))


def flight_of_ten_points(b: Bench) -> Judged:
    """A record thinned to 2 Hz, between whose samples the model departs."""

    def thin(channel, clock, values):
        if values.size < 50:
            return None
        every = np.arange(clock[0], clock[-1], 0.5)
        return np.interp(clock, every, np.interp(every, clock, values))

    return judge(Deception([b.case("21", record=b.record("21", thin))], b.final))


DECEPTIONS = (
    (switches_by_time, "stored in the model"),
    (knows_its_inputs, "not driven"),
    (one_name_two_models, "is another file in 1 other case"),
    (filtered_recording, "noise of the record"),
    (master_of_another_flight, "another flight"),
    (table_in_other_units, "in the table of this edition"),
    (table_with_swapped_sides, "half width is positive"),
    (reversed_record, "did not settle|the same flight"),
    (edited_flown_cell, "standard errors from what flight found"),
    (start_that_absorbs_the_miss, "limits_exceeded"),
    (wind_that_absorbs_the_miss, "rests on the wind|lift: the flight needs"),
    (flight_of_ten_points, "limits_exceeded"),
)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("demo", type=Path, help="output folder of aeromatch demo")
    parser.add_argument("--only", default="", help="parts of the names of deceptions, by commas")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        bench = Bench(given.demo.resolve(), Path(folder), np.random.default_rng(1))
        trials = [(make.__name__, partial(make, bench), word) for make, word in DECEPTIONS]
        count_named(trials, given.only)


if __name__ == "__main__":
    main()
