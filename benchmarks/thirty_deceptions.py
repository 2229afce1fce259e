"""Thirty deceptions of an evaluator in what a report rests on, and the word that names each.

    aeromatch match data/c182/aeromatch.toml -o out/c182
    python benchmarks/thirty_deceptions.py out/c182

None of them is in `deceptions.py`, `more_deceptions.py` or `ten_deceptions.py`: tests without their
manoeuvre, facts and rows that are taken out, tables of names that correct an answer, records that
are forged or cut, evidence without its origin.  Ten on facts and conditions, ten on departures, ten
on models and records.  Printed: a line each, with the line of the report that names it.
"""

from __future__ import annotations

import argparse
import csv
import re
import tempfile
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import xarray as xr
from deceptions import RUN, Bench, Deception, count_named, judge
from ten_deceptions import stated

import aerodb
import flightmech
from flightmech.flown_samples import FLOWN_SAMPLES
from pom.cases.case import read_case
from pom.checking.report_checks import with_report_checks
from pom.replaying.batch import replay_all
from pom.replaying.recorded_runs import RecordedRun, RecordedRuns
from pom.replaying.replay_case import plan_of
from pom.tolerances.own_tables import read_own_table
from pom.tolerances.rows import tolerance_rows

DATA = Path(__file__).parents[1] / "data" / "c182"
CASES = DATA / "cases"
FLAPS = 'delta_f = "0 deg"'
TIME = "Time (s)"
NAMED = 'aircraft = "../aircraft.toml"'
MAPPED = 'names = "../names.toml"'

Judged = tuple[list[str], str]
Columns = dict[str, np.ndarray]


class LightBench(Bench):
    """Bench of the light aircraft: its cases, and its records as columns of a CSV file."""

    def case(
        self, name: str, *edits: tuple[str, str], more: str = "", record: Path | None = None
    ) -> Path:
        text = (CASES / f"{name}.toml").read_text(encoding="utf-8")
        if record is not None:
            text = re.sub(r"^record = .*$", f'record = "{record}"', text, flags=re.M)
        for old, new in edits:
            found = re.search(r"^window = .*$", text, re.M).group() if old == "window" else old
            if found not in text:
                raise ValueError(f"{old!r} is not in {name}.toml")
            text = text.replace(found, f"window = {new}" if old == "window" else new, 1)
        path = self.file(".toml")
        path.write_text(f"{text}\n{more}\n".replace('"../', f'"{DATA}/'), encoding="utf-8")
        return path

    def columns(self, name: str) -> Columns:
        with (DATA / "flight" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        numbers = np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])
        return {heading: numbers[:, k] for k, heading in enumerate(rows[0])}

    def written(self, columns: Columns) -> Path:
        path = self.file(".csv")
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            for row in np.column_stack([*columns.values()]):
                writer.writerow([f"{cell:.6g}" for cell in row])
        return path

    def text_of(self, name: str, *edits: tuple[str, str]) -> str:
        """Write a copy of a file of the project with texts replaced, and return its path."""
        text = (DATA / name).read_text(encoding="utf-8")
        for old, new in edits:
            if old not in text:
                raise ValueError(f"{old!r} is not in {name}")
            text = text.replace(old, new, 1)
        path = self.file(f"_{name}")
        path.write_text(text, encoding="utf-8")
        return str(path)


def one_case(b: LightBench, name: str, *edits: tuple[str, str], **options) -> Judged:
    """Judge one case with texts replaced, by the final model unless another one is given."""
    model, evidence = options.pop("model", b.final), options.pop("evidence", None)
    return judge(Deception([b.case(name, *edits, **options)], model, evidence))


# Facts and conditions


def short_period_without_input(b: LightBench) -> Judged:
    """The window of a short period ends before the elevator moves."""
    return one_case(b, "short_period", ("window", "[0.5, 4.3]"))


def roll_response_without_input(b: LightBench) -> Judged:
    """The window of a roll response ends before the ailerons move."""
    return one_case(b, "roll_response", ("window", "[0.5, 4.3]"))


def power_change_without_power(b: LightBench) -> Judged:
    """A record in which the lever rests shows a change of power."""
    record = DATA / "flight" / "check_phugoid.csv"
    return one_case(b, "power_change", record=record)


def gear_change_without_gear(b: LightBench) -> Judged:
    """A change of power shows a change of the gear."""
    return one_case(b, "power_change", ('id = "2.c.1"', 'id = "2.c.4"'))


def speedbrake_change_without_speedbrake(b: LightBench) -> Judged:
    """A change of power shows a change of the speed brake."""
    return one_case(b, "power_change", ('id = "2.c.1"', 'id = "2.c.3"'))


def rudder_response_without_rudder(b: LightBench) -> Judged:
    """A roll response shows a rudder response."""
    return one_case(b, "roll_response", ('id = "2.d.2"', 'id = "2.d.6"'))


def configuration_out_of_sight(b: LightBench) -> Judged:
    """Neither the record nor the case states the flaps."""
    return one_case(b, "dutch_roll", (FLAPS, ""))


def flaps_that_nobody_recorded(b: LightBench) -> Judged:
    """Flaps are stated, so that a flight in cruise shows the approach, too."""
    return one_case(b, "dutch_roll", (FLAPS, 'delta_f = "10 deg"'))


def row_without_its_parameter(b: LightBench) -> Judged:
    """The aircraft file states that the aeroplane has no load factor."""
    craft = b.text_of(
        "aircraft.toml", ("engines = 1", 'engines = 1\nwithout = ["normal_acceleration"]')
    )
    return one_case(b, "short_period", (NAMED, f'aircraft = "{craft}"'))


def forces_without_a_wheel(b: LightBench) -> Judged:
    """The aircraft file states that the aeroplane has no wheel, whose force row is not judged."""
    craft = b.text_of("aircraft.toml", ("engines = 1", 'engines = 1\nwithout = ["wheel_force"]'))
    return one_case(b, "roll_response", (NAMED, f'aircraft = "{craft}"'))


# Departures


def share_of_the_flight(b: LightBench) -> Judged:
    """A percentage of the flight value that is wider than the printed width."""
    more = f'[tolerance]\npitch_rate = {{ abs = "2 deg/s", percent = {b.draw(60, 90)} }}'
    return one_case(b, "short_period", more=more, model=b.spoilt(Cm__qhat=0.4))


def alternative_of_a_row(b: LightBench) -> Judged:
    """The load factor becomes an alternative of the pitch rate, with its printed width."""
    more = '[tolerance]\nnormal_acceleration = { abs = "0.1 g", group = "pitch" }'
    return one_case(b, "short_period", more=more, model=b.spoilt(CL__basic=0.6))


def wide_trim(b: LightBench) -> Judged:
    """Wide limits of the trim bias, which takes up a wrong drag."""
    more = 'trim = true\nlimits = { thrust = "20000 N", delta_e = "20 deg" }'
    return one_case(b, "power_change", ("trim = true", more), model=b.spoilt(CD__basic=1.1))


def without_a_trim(b: LightBench) -> Judged:
    """No trim: the model starts as recorded, and a wrong pitching moment is not seen there."""
    return one_case(b, "short_period", ("trim = true", "trim = false"))


def name_table_of_the_answer(b: LightBench) -> Judged:
    """A table of names scales the pitch rate of a model with too much of it."""
    names = b.file("_model.toml")
    names.write_text('[outputs]\nq = { variable = "q", scale = 0.8 }\n', encoding="utf-8")
    more = f'[models]\n{RUN} = "{names}"'
    return one_case(b, "short_period", more=more)


def name_map_of_the_elevator(b: LightBench) -> Judged:
    """A name map scales the recorded elevator."""
    names = b.text_of(
        "names.toml", ('delta_e = "Elevator"', 'delta_e = { column = "Elevator", scale = 1.15 }')
    )
    return one_case(b, "short_period", (MAPPED, f'names = "{names}"'))


def air_of_the_case(b: LightBench) -> Judged:
    """A warm day is stated against the recorded temperature."""
    return one_case(b, "short_period", (FLAPS, f"{FLAPS}\ndelta_T = {b.draw(18, 25)}"))


def share_of_an_engineering_simulator(b: LightBench) -> Judged:
    """The reference becomes a simulator, and the whole tolerance is applied."""
    more = 'reference = "engineering"\nfraction = 1.0\nwindow'
    text = re.search(r"^window", (CASES / "short_period.toml").read_text(), re.M).group()
    path = b.case("short_period")
    path.write_text(path.read_text().replace(f"\n{text} =", f"\n{more} =", 1), encoding="utf-8")
    return judge(Deception([path], b.final))


def row_taken_out_of_a_table(b: LightBench) -> Judged:
    """A tolerance table under the name of the regulation without the row that fails."""
    path = b.file(".csv")
    rows = []
    for row in tolerance_rows():
        if (row["test_id"], row["parameter"]) != ("2.c.10", "normal_acceleration"):
            rows.append(row)
    write_table(path, rows)
    read = read_case(b.case("short_period"), read_own_table(path))
    return stated(with_report_checks(replay_all([read], {RUN: b.spoilt(CL__basic=0.6)}, jobs=1)))


def window_of_a_table(b: LightBench) -> Judged:
    """A tolerance table under the name of the regulation that judges a part of the motion."""
    path = b.file(".csv")
    rows = [dict(row) for row in tolerance_rows()]
    for row in rows:
        if row["test_id"] == "2.c.1" and row["applies_to"]:
            row["applies_to"] = "change_end+3s"
    write_table(path, rows)
    read = read_case(b.case("power_change"), read_own_table(path))
    return stated(with_report_checks(replay_all([read], {RUN: b.final}, jobs=1)))


def write_table(path: Path, rows: list) -> None:
    lines = [",".join(rows[0])]
    for row in rows:
        cells = ['"' + str(value).replace('"', '""') + '"' for value in row.values()]
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


# Models and records


def _leaking_case(b: LightBench, record: Path | None = None) -> Path:
    """A short period from a record that identified the model."""
    record = record or DATA / "flight" / "cruise.csv"
    return b.case("short_period", ("window", "[4.0, 14.0]"), record=record)


def _compiled(b: LightBench, database: xr.DataTree) -> Path:
    path = b.file(".fmu")
    aircraft = flightmech.read_aircraft(b.demo / "final.toml")
    flightmech.write_fmu(flightmech.compile(aircraft, database), path)
    return path


def removed_samples(b: LightBench) -> Judged:
    """The samples that identified a database are removed from it before it is compiled."""
    database = aerodb.open(b.demo / "final.nc")
    del database.attrs[FLOWN_SAMPLES]
    return judge(Deception([_leaking_case(b)], _compiled(b, database)))


def removed_origin(b: LightBench) -> Judged:
    """The same, and the history that states the fits is removed, too."""
    database = aerodb.open(b.demo / "final.nc")
    for name in (FLOWN_SAMPLES, "history"):
        database.attrs.pop(name, None)
    return judge(Deception([_leaking_case(b)], _compiled(b, database)))


def slowed_record(b: LightBench) -> Judged:
    """A record that identified the model, on a clock that runs two percent slow."""
    columns = b.columns("cruise")
    columns[TIME] = 1.02 * columns[TIME]
    return judge(Deception([_leaking_case(b, b.written(columns))], b.final))


def uncertain_evidence(b: LightBench) -> Judged:
    """Evidence whose standard errors are thirty times as large."""
    evidence = aerodb.open(b.demo / "final.nc")
    leaves = {}
    for name, leaf in aerodb.terms(evidence).items():
        if "stderr" in leaf:
            leaves[name] = leaf.assign(stderr=30.0 * leaf["stderr"])
    evidence = aerodb.replace_terms(evidence, leaves)
    model = b.spoilt(Cm__qhat=0.8, Cm__elevator=0.95)
    return one_case(b, "short_period", model=model, evidence=evidence)


def evidence_without_the_term(b: LightBench) -> Judged:
    """Evidence from which the term is removed that is wrong in the model."""
    evidence = aerodb.delete_terms(aerodb.open(b.demo / "final.nc"), ["Cm/qhat"])
    return one_case(b, "short_period", model=b.spoilt(Cm__qhat=0.8), evidence=evidence)


def forged_channels(b: LightBench) -> Judged:
    """The judged channels of the record are those of a wrong model, with noise."""
    model = b.spoilt(Cm__qhat=0.4)
    (result,) = replay_all([read_case(b.case("short_period"))], {RUN: model}, jobs=1)
    answer, time = result.signals.sel(run=RUN), result.signals["time"].values
    columns = b.columns("check_short_period")
    clock = columns[TIME]
    inside = (clock >= time[0]) & (clock <= time[-1])
    for heading, name in {"Pitch Rate (deg/s)": "q", "Pitch (deg)": "theta"}.items():
        forged = np.degrees(np.interp(clock[inside], time, answer[name].values))
        columns[heading][inside] = forged + b.rng.normal(0.0, 0.03, int(inside.sum()))
    return one_case(b, "short_period", record=b.written(columns), model=model)


def late_rudder(b: LightBench) -> Judged:
    columns = b.columns("check_dutch_roll")
    late = b.sign() * b.draw(0.15, 0.25)
    columns["Rudder (deg)"] = np.interp(
        columns[TIME] - late, columns[TIME], columns["Rudder (deg)"]
    )
    return one_case(b, "dutch_roll", record=b.written(columns))


def wrong_ailerons(b: LightBench) -> Judged:
    columns = b.columns("check_roll")
    columns["Aileron (deg)"] *= b.draw(1.15, 1.22)
    return one_case(b, "roll_response", record=b.written(columns))


def cut_record(b: LightBench) -> Judged:
    """A part of the record is cut out, and the clock closed."""
    columns = b.columns("check_short_period")
    clock = columns[TIME]
    kept = (clock < 7.0) | (clock >= 7.6)
    columns = {name: values[kept] for name, values in columns.items()}
    columns[TIME] = np.where(columns[TIME] >= 7.6, columns[TIME] - 0.6, columns[TIME])
    return one_case(b, "short_period", ("window", "[4.0, 14.4]"), record=b.written(columns))


def device_with_other_inputs(b: LightBench) -> Judged:
    """A device that was flown by other controls than the flight."""
    case = read_case(b.case("short_period"))
    (flown,) = replay_all([case], {RUN: b.final}, jobs=1)
    time = flown.signals["time"].values
    channels = {}
    for name in map(str, flown.signals.data_vars):
        channels[name] = (time, flown.signals[name].sel(run=RUN).values)
    states = plan_of(case).states
    elevator = states["delta_e"].values
    channels["delta_e"] = (states["time"].values, 1.3 * (elevator - elevator[0]) + elevator[0])
    line = RecordedRun(channels, "device.csv, recording, sha256 0", "recording of a device")
    recorded = {case.name: RecordedRuns({RUN: line})}
    return stated(replay_all([case], {}, recorded=recorded, jobs=1))


# kind, deception, word
DECEPTIONS = (
    (1, short_period_without_input, "does not move"),
    (1, roll_response_without_input, "does not move"),
    (1, power_change_without_power, "does not move"),
    (1, gear_change_without_gear, "the record has no gear"),
    (1, speedbrake_change_without_speedbrake, "the record has no speedbrake"),
    (1, rudder_response_without_rudder, "the rudder moves by|does not move"),
    (1, configuration_out_of_sight, "the record has no delta_f"),
    (1, flaps_that_nobody_recorded, "is held at 10 deg"),
    (1, row_without_its_parameter, "facts.without"),
    (1, forces_without_a_wheel, "facts.without"),
    (2, share_of_the_flight, "departure: tolerance"),
    (2, alternative_of_a_row, "is an alternative of"),
    (2, wide_trim, "limits_exceeded|departure: trim|allowed"),
    (2, without_a_trim, "trim"),
    (2, name_table_of_the_answer, "not driven by its tables|leave the scale out"),
    (2, name_map_of_the_elevator, "times the recorded size"),
    (2, air_of_the_case, "delta_T"),
    (2, share_of_an_engineering_simulator, "of the tolerance is applied"),
    (2, row_taken_out_of_a_table, "in the table of this edition"),
    (2, window_of_a_table, "in the table of this edition"),
    (3, removed_samples, "has no samples of it"),
    (3, removed_origin, "has no samples of it"),
    (3, slowed_record, "leak"),
    (3, uncertain_evidence, "edited after the identification"),
    (3, evidence_without_the_term, "the evidence is without"),
    (3, forged_channels, "error of the flight record|record:"),
    (3, late_rudder, "earlier|later|lag"),
    (3, wrong_ailerons, "times the recorded size"),
    (3, cut_record, "error of the flight record|record:"),
    (3, device_with_other_inputs, "inputs of the device are not"),
)


def judge_made(make: Callable[[LightBench], Judged], bench: LightBench) -> Judged:
    try:
        return make(bench)
    except flightmech.errors.AeromatchError as error:
        return ["refused"], str(error)


def run_deceptions(
    about: str, deceptions: Sequence[tuple[str, Callable[[LightBench], Judged], str]]
) -> None:
    """Run deceptions of the light aircraft by the options of the command line.

    Parameters
    ----------
    about : str
        Text of the help.
    deceptions : sequence of (str, callable, str)
        Name, function of the bench, and pattern of the line that names the deception.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("match", type=Path, help="output folder of aeromatch match")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="parts of the names of deceptions, by commas")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    with tempfile.TemporaryDirectory() as folder:
        bench = LightBench(given.match.resolve(), Path(folder), np.random.default_rng(given.seed))
        trials = []
        for name, make, word in deceptions:
            trials.append((name, partial(judge_made, make, bench), word))
        count_named(trials, given.only)


if __name__ == "__main__":
    run_deceptions(
        __doc__, [(f"{kind} {make.__name__}", make, word) for kind, make, word in DECEPTIONS]
    )
